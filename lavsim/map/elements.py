"""Elements of an OpenDRIVE file: attributes checked, ids numbered, counts bounded, each mistake with its line."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from lxml import etree

from lavsim.errors import MapError
from lavsim.map.records import Polynomial

MAX_LANES = 20_000  # lane pieces of a file; Town04 has 924
MAX_LANE_SUMS = 500_000  # squares of the number of lanes, over all sections
MAX_CURVES = 10_000  # spirals and cubics of a file
MAX_THINGS = 50_000  # signals, references and objects of a file
MAX_RECORDS = 1_000_000  # polynomials and marks of a file
UNKNOWN_ID = 2**30  # numbers from here on stand for names of things that the file lacks
_QUIET = {"userData", "dataQuality"}  # notes of drawing tools, which mean nothing to others


class Elements:
    """What every part of a file is read with.

    Args:
        source: What messages call the file.

    Attributes:
        source: As given.
        skipped: Elements that are not read, by what they are.
        repairs: What was mended, in sentences.
        numbers: Of ids by kind and text.
        budget: What a file may still hold.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self.skipped: Counter[str] = Counter()
        self.repairs: list[str] = []
        self.numbers: dict[str, dict[str, int]] = {}
        self.budget = {"lanes": MAX_LANES, "lane sums": MAX_LANE_SUMS, "things": MAX_THINGS, "records": MAX_RECORDS}
        self.budget["curves"] = MAX_CURVES

    def fail(self, element: etree._Element | None, message: str) -> MapError:
        """The error that says a mistake and its line."""
        line = f", line {element.sourceline}" if element is not None and element.sourceline else ""
        return MapError(f"{self.source}{line}: {message}.")

    def number_ids(self, root: etree._Element) -> None:
        """Gives every id that is no whole number one of its own, past those of its kind that are numbers."""
        for kind, path in (("road", "road"), ("junction", "junction"), ("signal", "road/signals/signal"),
                           ("controller", "controller")):  # fmt: skip
            texts = [e.get("id") or "" for e in root.iterfind(path)]
            if kind == "signal":
                texts += [e.get("id") or "" for e in root.iterfind("road/signals/signalReference")]
            numbers = {text: plain_number(text, 0 if kind == "junction" else -(2**31)) for text in texts}
            following = max([n for n in numbers.values() if n is not None], default=0) + 1
            named = [text for text, number in numbers.items() if number is None and text]
            for text in named:
                numbers[text] = following
                following += 1
            self.numbers[kind] = {text: number for text, number in numbers.items() if number is not None}
            if named:
                listed = ", ".join(f"{text[:40]!r} is {numbers[text]}" for text in named[:12])
                more = f" and {len(named) - 12} more" if len(named) > 12 else ""
                self.repairs.append(f"{kind} ids that are no whole numbers were numbered: {listed}{more}")

    def id(self, element: etree._Element, name: str, kind: str) -> int:
        """The number of the `kind` that an attribute names."""
        text = element.get(name)
        if text is None or text == "":
            raise self.fail(element, f"<{element.tag}> lacks {name!r}")
        number = self.numbers[kind].get(text)
        if number is None:
            number = plain_number(text, -(2**31))
        if number is None:  # names something that the file does not have
            number = self.numbers[kind][text] = UNKNOWN_ID + len(self.numbers[kind])
        return number

    def spend(self, element: etree._Element, what: str, count: int = 1) -> None:
        """Counts against a bound on the size of maps."""
        self.budget[what] -= count
        if self.budget[what] < 0:
            words = {
                "lanes": f"more than {MAX_LANES} lane pieces",
                "lane sums": "too many sections with too many lanes each",
                "curves": f"more than {MAX_CURVES} spirals and cubics",
                "things": f"more than {MAX_THINGS} signals and objects",
                "records": f"more than {MAX_RECORDS} widths, marks and profiles",
            }
            raise self.fail(element, f"{words[what]}; that is no town")

    def unique(self, root: etree._Element, kind: str, ids: list[int]) -> None:
        """Refuses ids that are used twice."""
        twice = [i for i, count in Counter(ids).items() if count > 1]
        if twice:
            raise self.fail(root, f"{kind} id {twice[0]} is used {Counter(ids)[twice[0]]} times")

    def skip(self, element: etree._Element, known: set[str]) -> None:
        """Notes children that are not read."""
        if len(element) > MAX_RECORDS:
            raise self.fail(element, f"<{element.tag}> holds {len(element)} elements; that is no town")
        for child in element:
            if isinstance(child.tag, str) and child.tag not in known and child.tag not in _QUIET:
                self.skipped[f"<{child.tag[:60]}> in <{element.tag}>"] += 1

    def number(self, element: etree._Element, name: str, default: float | None = None) -> float:
        """An attribute that is a finite number; `default` where it is missing."""
        text = element.get(name)
        if text is None or text == "":
            if default is None:
                raise self.fail(element, f"<{element.tag}> lacks {name!r}")
            return default
        try:
            value = float(text)
        except ValueError:
            raise self.fail(element, f"<{element.tag}> {name} must be a number, got {text[:40]!r}") from None
        if not math.isfinite(value) or abs(value) > 1e9:
            raise self.fail(element, f"<{element.tag}> {name} must be a finite number, got {text[:40]!r}")
        return value

    def whole(self, element: etree._Element, name: str, default: int | None = None) -> int:
        """An attribute that is a whole number; `default` where it is missing."""
        text = element.get(name)
        if text is None:
            if default is None:
                raise self.fail(element, f"<{element.tag}> lacks {name!r}")
            return default
        try:
            value = int(text)
        except ValueError:
            raise self.fail(element, f"<{element.tag}> {name} must be a whole number, got {text[:40]!r}") from None
        if abs(value) >= 2**31:
            raise self.fail(element, f"<{element.tag}> {name} is out of range: {text[:40]}")
        return value

    def polynomial(self, element: etree._Element, key: str = "s") -> Polynomial:
        """A cubic that begins at the attribute `key`."""
        self.spend(element, "records")
        return Polynomial(
            self.number(element, key),
            self.number(element, "a"),
            self.number(element, "b", 0.0),
            self.number(element, "c", 0.0),
            self.number(element, "d", 0.0),
        )

    def polynomials(self, elements: Iterator[etree._Element], key: str = "s") -> tuple[Polynomial, ...]:
        """Cubics in the order in which they begin."""
        return tuple(sorted((self.polynomial(e, key) for e in elements), key=lambda r: r.s))


def plain_number(text: str, least: int) -> int | None:
    """The whole number in `text`, if it is one from `least` on that fits 32 bits."""
    try:
        value = int(text)
    except ValueError:
        return None
    return value if least <= value < 2**31 else None
