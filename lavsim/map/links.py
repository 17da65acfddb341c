"""Which lane follows which: the file's links, checked, mended where they can be and dropped where not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lavsim.map.records import LaneRecord, Network, RoadLink, RoadRecord

DRIVEN = ("driving", "bidirectional", "entry", "exit", "offRamp", "onRamp")  # whose links are looked after
FARTHEST = 10.0  # [m] a link over a wider gap is a mistake
MOST_SENTENCES = 12  # of one kind in a report


class Piece(Protocol):
    """A lane piece with its records and its centre points in the direction of travel."""

    @property
    def road(self) -> RoadRecord: ...
    @property
    def section(self) -> int: ...
    @property
    def lane(self) -> LaneRecord: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def forward(self) -> bool: ...


class Report:
    """Sentences about what was wrong, by kind; long lists are cut."""

    def __init__(self) -> None:
        self._kinds: dict[str, list[str]] = {}
        self._more: dict[str, int] = {}

    def add(self, kind: str, sentence: str) -> None:
        told = self._kinds.setdefault(kind, [])
        if len(told) < MOST_SENTENCES:
            told.append(sentence)
        else:
            self._more[kind] = self._more.get(kind, 0) + 1

    def sentences(self) -> tuple[str, ...]:
        found: list[str] = []
        for kind, told in self._kinds.items():
            found += told
            if kind in self._more:
                found.append(f"{self._more[kind]} more of: {kind}.")
        return tuple(found)


@dataclass(frozen=True)
class _Connection:
    """A way out of a road's lane through a junction."""

    road: int
    contact: str
    lane: int


def _exit_end(forward: bool) -> str:
    return "end" if forward else "start"


def _entry_end(forward: bool) -> str:
    return "start" if forward else "end"


class LaneLinks:
    """Finds the pairs (lane, next lane) in the direction of travel.

    A pair counts when the lane that is left names the lane that is entered (as in CARLA's map builder), or the other
    way round; the second is reported as mended.
    """

    def __init__(
        self,
        network: Network,
        pieces: Sequence[Piece],
        index: Mapping[tuple[int, int, int], int],
        ends: Mapping[int, NDArray[np.float64]],
        report: Report,
    ) -> None:
        """`ends` holds the start and end (2, 2) of each road's reference line."""
        self.network, self.pieces, self.index, self.ends, self.report = network, pieces, index, ends, report
        self.roads = {road.id: road for road in network.roads}
        self.sections: dict[int, list[int]] = {}
        for piece in pieces:
            known = self.sections.setdefault(piece.road.id, [])
            if not known or known[-1] != piece.section:
                known.append(piece.section)
        self.place = {(road, section): k for road, known in self.sections.items() for k, section in enumerate(known)}
        self.connections = self._connections()
        self._said: set[tuple[int, str]] = set()

    def pairs(self) -> list[tuple[int, int]]:
        """All of them; a lane's followers in the order of the file, mended ones last."""
        found = dict.fromkeys(self._half(leaving=True))
        for second, first in self._half(leaving=False):
            if (first, second) not in found and self.pieces[second].lane.kind in DRIVEN:
                found[(first, second)] = None
                self.report.add(
                    "a link that only one side names",
                    f"{self._name(second)} names {self._name(first)} before it, which does not name it; linked.",
                )
        return [pair for pair in found if self._is_near(*pair)]

    def _name(self, number: int) -> str:
        piece = self.pieces[number]
        section = f" (section {piece.section})" if len(piece.road.sections) > 1 else ""
        return f"lane {piece.lane.id} of road {piece.road.id}{section}"

    def _is_near(self, first: int, second: int) -> bool:
        gap = float(np.hypot(*(self.pieces[first].points[-1, :2] - self.pieces[second].points[0, :2])))
        if gap > FARTHEST:
            self.report.add(
                "a link over a gap",
                f"{self._name(first)} is linked to {self._name(second)}, {gap:.1f} m away; dropped.",
            )
        return gap <= FARTHEST

    def _connections(self) -> dict[tuple[int, int, int], list[_Connection]]:
        """Ways on by (junction, road, lane)."""
        found: dict[tuple[int, int, int], list[_Connection]] = {}
        for junction in self.network.junctions:
            for c in junction.connections:
                lost = [r for r in (c.incoming, c.connecting) if r not in self.roads]
                if lost:
                    self.report.add(
                        "a connection of a missing road",
                        f"junction {junction.id}: connection {c.id} names road {lost[0]}, which is missing; dropped.",
                    )
                    continue
                if not c.links:
                    self.report.add(
                        "a connection without lanes",
                        f"junction {junction.id}: connection {c.id} from road {c.incoming} links no lanes.",
                    )
                side = self._side_at(self.roads[c.incoming], junction.id)
                contact = c.contact or self._nearest_end(c.incoming, side, c.connecting)
                for source, target in c.links:
                    found.setdefault((junction.id, c.incoming, source), []).append(
                        _Connection(c.connecting, contact, target)
                    )
                    if junction.direct:
                        found.setdefault((junction.id, c.connecting, target), []).append(
                            _Connection(c.incoming, side, source)
                        )
        return found

    def _side_at(self, road: RoadRecord, junction: int) -> str:
        """The end of a road that touches a junction."""
        link = road.successor
        return "end" if link is not None and link.kind == "junction" and link.id == junction else "start"

    def _nearest_end(self, road: int, side: str, other: int) -> str:
        here = self.ends[road][1 if side == "end" else 0]
        start, end = (float(np.hypot(*(place - here))) for place in self.ends[other])
        return "start" if start <= end else "end"

    def _missing(self, number: int, side: str, sentence: str) -> None:
        if (number, side) not in self._said and self.pieces[number].lane.kind in DRIVEN:
            self._said.add((number, side))
            self.report.add("a link to nothing", f"{self._name(number)} {sentence}; dropped.")

    def _half(self, leaving: bool) -> Iterator[tuple[int, int]]:
        """(lane, the lane it names) at the end where traffic leaves it, or where traffic enters it."""
        for number, piece in enumerate(self.pieces):
            side = _exit_end(piece.forward) if leaving else _entry_end(piece.forward)
            named = piece.lane.successor if side == "end" else piece.lane.predecessor
            known = self.sections[piece.road.id]
            place = self.place[piece.road.id, piece.section] + (1 if side == "end" else -1)
            if 0 <= place < len(known):
                if named:
                    yield from self._join(number, side, piece.road.id, known[place], named, None, leaving)
                continue
            link = piece.road.successor if side == "end" else piece.road.predecessor
            if link is None:
                continue
            if link.kind == "junction":
                if leaving:
                    for c in self.connections.get((link.id, piece.road.id, piece.lane.id), []):
                        yield from self._enter(number, side, c.road, c.contact, c.lane, True)
            elif named:
                contact = link.contact
                if link.id in self.roads and not contact:
                    contact = self._nearest_end(piece.road.id, side, link.id)
                    self._tell_contact(piece.road, link, side, contact)
                yield from self._enter(number, side, link.id, contact, named, leaving)

    def _tell_contact(self, road: RoadRecord, link: RoadLink, side: str, contact: str) -> None:
        key = (-1 - road.id, side)
        if key not in self._said:
            self._said.add(key)
            self.report.add(
                "a link without contactPoint",
                f"road {road.id} does not say with which end road {link.id} touches its {side}; "
                f"the {contact} is nearer and was taken.",
            )

    def _enter(
        self, number: int, side: str, road: int, contact: str, lane: int, leaving: bool
    ) -> Iterator[tuple[int, int]]:
        if road not in self.sections:
            if road not in self.roads:
                self._missing(number, side, f"leads to road {road}, which is missing")
            return
        if lane:
            section = self.sections[road][0 if contact == "start" else -1]
            yield from self._join(number, side, road, section, lane, contact, leaving)

    def _join(
        self, number: int, side: str, road: int, section: int, lane: int, contact: str | None, leaving: bool
    ) -> Iterator[tuple[int, int]]:
        other = self.index.get((road, section, lane))
        if other is None:
            self._missing(number, side, f"is linked to lane {lane} of road {road}, which is missing there")
            return
        forward = self.pieces[other].forward
        fits = (
            forward == self.pieces[number].forward
            if contact is None
            else contact == (_entry_end(forward) if leaving else _exit_end(forward))
        )
        if not fits:
            self._missing(number, side, f"is linked to lane {lane} of road {road}, whose traffic runs the other way")
        elif other != number:
            yield number, other
