"""Ranges of a hazard's parameters: given as `distance=10:40`, or found from the type's own defaults, units and bounds.

A point of the unit cube, one number a range, stands for values. Values carry four digits, so a route file holds them
without loss.
"""

from __future__ import annotations

import difflib
import math
import re
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

from lavsim.errors import ConfigError, LavsimError, ScenarioError
from lavsim.scenarios.base import SCENARIOS
from lavsim.scenarios.parameters import Interval, parse_parameters

TRIGGER = "trigger"  # shifts where the hazard is set off along the route [m]: every type has it
TRIGGER_RANGE = (-10.0, 10.0)
DIGITS = 4
_BELOW, _ABOVE = 0.5, 1.5  # of a default, where its type says no better
_AROUND_ZERO = {"deg": 30.0, "m": 1.0, "s": 2.0, "m/s": 2.0, "km/h": 10.0}
_SHRINK = 0.8  # of the way to the default that a bound goes while the type refuses it
_UNIT = re.compile(r"^\s+(\w+): .*\[([^\]]+)\]", re.MULTILINE)


@dataclass(frozen=True)
class Range:
    """What one parameter may be.

    Attributes:
        name: Of the parameter.
        low, high: Its smallest and largest value; without meaning where there are choices.
        whole: Whether it is an integer.
        choices: Words to choose from instead.
    """

    name: str
    low: float = 0.0
    high: float = 0.0
    whole: bool = False
    choices: tuple[str, ...] = ()

    def value(self, share: float) -> float | str:
        """The value at `share` [0 to 1] of the way from `low` to `high`."""
        share = min(max(share, 0.0), 1.0)
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        value = self.low + share * (self.high - self.low)
        return float(round(value)) if self.whole else rounded(value)

    def __str__(self) -> str:
        return f"{self.name}=" + ("|".join(self.choices) if self.choices else f"{self.low:g}:{self.high:g}")


def rounded(value: float) -> float:
    """`value` with `DIGITS` digits."""
    return float(f"{value:.{DIGITS}g}")


def parse_range(text: str, generation: str, kind: str) -> Range:
    """The range that "distance=10:40", "distance=12" or "direction=left|right" gives for a type's parameter.

    Raises:
        ConfigError: not such a text, the range does not rise, or the type refuses its ends.
        ScenarioError: the type has no such parameter, or not of numbers.
    """
    name, equals, given = (part.strip() for part in text.partition("="))
    if not equals or not name or not given:
        raise ConfigError(f"a range is NAME=LOW:HIGH or NAME=WORD|WORD, got {text!r}.")
    hints = _hints(generation, kind)
    if name != TRIGGER and name not in hints:
        near = difflib.get_close_matches(name, [*hints, TRIGGER], n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ScenarioError(f"{kind} has no parameter {name!r}.{hint} Known: {', '.join([*hints, TRIGGER])}.")
    hint_of = float if name == TRIGGER else _plain(hints[name])
    if hint_of is str:
        found = Range(name, choices=tuple(word.strip() for word in given.split("|")))
    elif hint_of in (float, int, Interval):
        found = _numbers(name, given, hint_of is int)
    else:
        raise ScenarioError(f"{name} of {kind} is no number: it can't be searched.")
    for value in found.choices or (found.low, found.high):
        reason = _refusal(generation, kind, name, value)
        if reason is not None:
            raise ConfigError(f"range {text!r}: {kind} refuses {value}: {reason}")
    return found


def _numbers(name: str, given: str, whole: bool) -> Range:
    low, colon, high = given.partition(":")
    try:
        first, last = float(low), float(high if colon else low)
    except ValueError:
        first = last = math.nan
    if not (math.isfinite(first) and math.isfinite(last)):
        raise ConfigError(f"range of {name}: two numbers like 10:40 expected, got {given!r}.")
    if first > last:
        raise ConfigError(f"range of {name}: {first:g} to {last:g} does not rise.")
    return Range(name, first, last, whole)


def default_ranges(generation: str, kind: str, given: Mapping[str, Any] | None = None) -> tuple[Range, ...]:
    """A range for each number among a type's parameters, in their order.

    A field may say its own by `field(metadata={"range": (low, high)})`. Else it is half to one and a half times the
    value, an interval's own ends (one number then stands for both), or a few units around 0; ends that the type
    refuses move towards the value. Types without numbers get `trigger`.

    Args:
        generation, kind: Of the hazard.
        given: Parameters of the route file; ranges lie around them.

    Raises:
        UnknownName: there is no such type.
    """
    config = SCENARIOS[generation, kind].Config
    hints, values = _hints(generation, kind), _values(generation, kind, given or {})
    units = _units(config)
    found = []
    for field in fields(config):
        hint, value = _plain(hints[field.name]), values.get(field.name)
        if hint not in (float, int, Interval) or value is None:
            continue
        said = field.metadata.get("range")
        low, high = said or _around(value, units.get(field.name, ""))
        low, high = (_accepted(generation, kind, field.name, end, value, given or {}) for end in (low, high))
        found.append(Range(field.name, low, high, hint is int))
    return tuple(found) or (Range(TRIGGER, *TRIGGER_RANGE),)


def ranges_of(
    generation: str, kind: str, texts: Sequence[str], given: Mapping[str, Any] | None = None
) -> tuple[Range, ...]:
    """The ranges of `texts`; the type's default ranges if there are none.

    Raises:
        LavsimError: as `parse_range`, or a parameter with two ranges.
    """
    found = [parse_range(text, generation, kind) for text in texts]
    names = [each.name for each in found]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"{name} has two ranges.")
    return tuple(found) or default_ranges(generation, kind, given)


def values_at(ranges: Sequence[Range], point: Sequence[float]) -> dict[str, float | str]:
    """The values that a point of the unit cube stands for."""
    return {each.name: each.value(float(share)) for each, share in zip(ranges, point, strict=True)}


def _hints(generation: str, kind: str) -> dict[str, Any]:
    config = SCENARIOS[generation, kind].Config
    hints = typing.get_type_hints(config)
    return {field.name: hints[field.name] for field in fields(config)}


def _plain(hint: Any) -> Any:
    """The type of a field, without "or None"."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return next(each for each in typing.get_args(hint) if each is not type(None))
    return hint


def _values(generation: str, kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Default values of a type's fields, with those that the route file gives."""
    config = SCENARIOS[generation, kind].Config
    values = {field.name: field.default for field in fields(config) if field.default is not MISSING}
    try:
        return {**values, **parse_parameters(config, given)}
    except ScenarioError:  # the route file itself says so in a better sentence
        return values


def _units(config: type[Any]) -> dict[str, str]:
    """Units by field, from the docstrings of a Config and of those that it extends."""
    found: dict[str, str] = {}
    for each in reversed(config.__mro__):
        found.update(_UNIT.findall(each.__doc__ or ""))
    return found


def _around(value: Any, unit: str) -> tuple[float, float]:
    if isinstance(value, Interval) and value.low < value.high:
        return value.low, value.high
    middle = float(value.low if isinstance(value, Interval) else value)
    if middle == 0.0:
        reach = _AROUND_ZERO.get(unit, 1.0)
        return -reach, reach
    low, high = sorted((_BELOW * middle, _ABOVE * middle))
    return low, high


def _accepted(generation: str, kind: str, name: str, end: float, value: Any, given: Mapping[str, Any]) -> float:
    """`end`, or the nearest to it on the way to `value` that the type takes."""
    middle = float(value.low + value.high) / 2.0 if isinstance(value, Interval) else float(value)
    for _ in range(30):
        if _refusal(generation, kind, name, rounded(end), given) is None:
            return rounded(end)
        end = middle + _SHRINK * (end - middle)
    return middle


def _refusal(
    generation: str, kind: str, name: str, value: float | str, given: Mapping[str, Any] | None = None
) -> str | None:
    """Why a type refuses a value; None when it takes it."""
    if name == TRIGGER:
        return None
    config = SCENARIOS[generation, kind].Config
    needed = {f.name for f in fields(config) if f.default is MISSING and f.default_factory is MISSING}
    if needed - {name, *(given or {})}:
        return None  # its places are asked for when the route is known
    try:
        config(**parse_parameters(config, {**(given or {}), name: value}))
    except LavsimError as error:
        return str(error)
    return None
