"""Streets and junctions from a short description: nodes, the streets between them, and what stands at their ends.

Coordinates are those of a map on paper, and of OpenDRIVE: x east, y north [m]. Every street has one lane a side, a
gutter and a sidewalk; it may bend (circular arcs between straight pieces) but reaches its junctions straight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from lavsim.map.opendrive import (
    ConnectionRecord,
    ControllerRecord,
    Geometry,
    JunctionRecord,
    LaneRecord,
    Network,
    ObjectRecord,
    Polynomial,
    RoadLink,
    RoadMark,
    RoadRecord,
    SectionRecord,
    SignalRecord,
    SignalReference,
    SpeedRecord,
)

NO_MARK = RoadMark(0.0, "none", "white", 0.0, "none")
CURB = RoadMark(0.0, "curb", "white", 0.15, "none")
SOLID_BEFORE_JUNCTION = 15.0  # [m] of unbroken centre line
CROSSWALK = (1.5, 4.5)  # [m] before the junction: near and far edge
STOP_BEHIND_CROSSWALK = 5.5  # [m] before the junction: middle of the painted stop line
STOP_BARE = 3.0  # [m] the same without a crosswalk
STOP_WIDTH = 0.4  # [m]
POLE_SETBACK = 1.0  # [m] before the junction: past the crosswalk, so that who waits at the line sees the lamps
POLE_BESIDE = 0.5  # [m] from the kerb
SIGN_SETBACK = 8.0  # [m] of speed signs after the junction
REFERENCE_S = 0.1  # [m] of signal references on connecting roads


class Pen:
    """Draws a reference line piece by piece; each piece starts where and as the last one ends."""

    def __init__(self, x: float, y: float, heading: float) -> None:
        self.x, self.y, self.heading, self.s = x, y, heading, 0.0
        self.pieces: list[Geometry] = []

    def line(self, length: float) -> Pen:
        """Straight on."""
        return self.arc(length, 0.0)

    def arc(self, length: float, curvature: float) -> Pen:
        """Around; positive `curvature` [1/m] to the left."""
        if length > 1e-9:
            self.pieces.append(Geometry(self.s, self.x, self.y, self.heading, length, curvature))
            half = 0.5 * curvature * length
            chord = length * (math.sin(half) / half if abs(half) > 1e-12 else 1.0)
            self.x += chord * math.cos(self.heading + half)
            self.y += chord * math.sin(self.heading + half)
            self.heading += 2.0 * half
            self.s += length
        return self


@dataclass(frozen=True)
class CrossSection:
    """Widths of one side of a street [m], from the centre line outward."""

    lane: float = 3.5
    gutter: float = 0.3
    sidewalk: float = 2.5

    @property
    def kerb(self) -> float:
        """Centre line to kerb [m]."""
        return self.lane + self.gutter


@dataclass
class Node:
    """A junction: where it is, and whether its approaches have lights and crosswalks."""

    name: str
    x: float
    y: float
    lights: bool = True
    crosswalks: bool = True
    arms: list[tuple[Street, bool]] = field(default_factory=list)  # street, and whether it starts here


@dataclass
class Street:
    """A road between two nodes; `end` may be None for a dead end at the last of `via`."""

    name: str
    start: Node | None
    end: Node | None
    points: tuple[tuple[float, float], ...]
    radii: tuple[float, ...]
    speed: int
    id: int = -1
    geometry: tuple[Geometry, ...] = ()
    length: float = 0.0


def _angle(a: tuple[float, float], b: tuple[float, float]) -> float:
    return math.atan2(b[1] - a[1], b[0] - a[0])


def _wrap(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


class Layout:
    """A town being drawn.

    Args:
        name: Of the town.
        section: Widths of every street.
        corner_radius: Smallest radius of the centre line in a right turn [m]; the lane itself turns half a lane
            width tighter.
    """

    def __init__(self, name: str, section: CrossSection | None = None, corner_radius: float = 11.0) -> None:
        self.name = name
        self.section = section or CrossSection()
        self.corner_radius = corner_radius
        self.nodes: dict[str, Node] = {}
        self.streets: list[Street] = []

    def junction(self, name: str, x: float, y: float, lights: bool = True, crosswalks: bool = True) -> None:
        """Places a junction at (x, y)."""
        self.nodes[name] = Node(name, x, y, lights, crosswalks)

    def street(
        self,
        name: str,
        start: str | tuple[float, float],
        end: str | tuple[float, float],
        via: Sequence[tuple[float, float, float]] = (),
        speed: int = 50,
    ) -> None:
        """Draws a street from one junction (or dead end) to another.

        Args:
            name: Of the street.
            start, end: Names of junctions, or points where the street just ends.
            via: Corners (x, y, radius) between them.
            speed: Limit [km/h].
        """
        first, last = (self.nodes[p] if isinstance(p, str) else None for p in (start, end))
        ends = [(n.x, n.y) if n is not None else p for n, p in ((first, start), (last, end))]
        points = (ends[0], *((x, y) for x, y, _ in via), ends[1])
        street = Street(name, first, last, points, tuple(r for *_, r in via), speed)  # type: ignore[arg-type]
        self.streets.append(street)
        if first is not None:
            first.arms.append((street, True))
        if last is not None:
            last.arms.append((street, False))

    def network(self) -> Network:
        """The town as OpenDRIVE records."""
        ids = iter(range(1, 1_000_000))
        for street in self.streets:
            street.id = next(ids)
        setbacks = {name: self._setback(node) for name, node in self.nodes.items()}
        junction_ids = {name: next(ids) for name in self.nodes}
        for street in self.streets:
            self._trace(street, setbacks)
        roads = {s.id: self._street_road(s, junction_ids, ids) for s in self.streets}
        junctions, controllers, connecting = [], [], []
        for node in self.nodes.values():
            record, ways, phases, signals = self._junction(node, junction_ids[node.name], ids)
            junctions.append(record)
            connecting += ways
            controllers += phases
            for road_id, signal in signals:
                roads[road_id] = replace(roads[road_id], signals=(*roads[road_id].signals, signal))
        return Network((*roads.values(), *connecting), tuple(junctions), tuple(controllers), name=self.name)

    # Streets

    def _direction(self, street: Street, at_start: bool) -> float:
        """Heading of a street away from its node."""
        a, b = (street.points[0], street.points[1]) if at_start else (street.points[-1], street.points[-2])
        return _angle(a, b)

    def _setback(self, node: Node) -> float:
        """Distance from the node at which its streets end, so that right turns get their radius."""
        headings = sorted(self._direction(street, at_start) for street, at_start in node.arms)
        if len(headings) < 2:
            raise ValueError(f"junction {node.name} has {len(headings)} streets; it needs two or more")
        needed = self.corner_radius
        for a, b in zip(headings, [*headings[1:], headings[0] + 2.0 * math.pi], strict=True):
            if b - a < math.radians(150.0):
                needed = max(needed, self.corner_radius / math.tan((b - a) / 2.0))
        return math.ceil(needed * 2.0 - 1e-6) / 2.0

    def _trace(self, street: Street, setbacks: dict[str, float]) -> None:
        """Rounds the corners of a street's polyline and cuts it back to its junctions' edges."""
        points, radii = street.points, street.radii
        legs = [math.dist(a, b) for a, b in pairwise(points)]
        headings = [_angle(a, b) for a, b in pairwise(points)]
        bends = [_wrap(b - a) for a, b in pairwise(headings)]
        tangents = [r * math.tan(abs(bend) / 2.0) for r, bend in zip(radii, bends, strict=True)]
        begin = setbacks[street.start.name] if street.start else 0.0
        finish = setbacks[street.end.name] if street.end else 0.0
        taken = [begin, *tangents, finish]
        pen = Pen(
            points[0][0] + begin * math.cos(headings[0]), points[0][1] + begin * math.sin(headings[0]), headings[0]
        )
        for k, leg in enumerate(legs):
            straight = leg - taken[k] - taken[k + 1]
            if straight < 0.0:
                raise ValueError(f"street {street.name}: no room for leg {k + 1}, {-straight:.1f} m too short")
            pen.line(straight)
            if k < len(bends):
                pen.arc(radii[k] * abs(bends[k]), math.copysign(1.0 / radii[k], bends[k]))
        street.geometry, street.length = tuple(pen.pieces), pen.s

    def _lanes(self, side: int, inward: int | None, outward: int | None) -> tuple[LaneRecord, ...]:
        """Driving lane, gutter and sidewalk of one side (-1 right, +1 left).

        Args:
            side: -1 right, +1 left.
            inward: Side of the road before, whose lanes lead in; None without.
            outward: Side of the road behind.
        """
        width = self.section
        return tuple(
            LaneRecord(
                side * k,
                kind,
                (Polynomial(0.0, size),),
                (mark,),
                None if inward is None else inward * k,
                None if outward is None else outward * k,
            )
            for k, kind, size, mark in (
                (1, "driving", width.lane, NO_MARK),
                (2, "shoulder", width.gutter, CURB),
                (3, "sidewalk", width.sidewalk, NO_MARK),
            )
        )

    def _street_road(self, street: Street, junction_ids: dict[str, int], ids: Iterator[int]) -> RoadRecord:
        def end(node: Node | None) -> RoadLink | None:
            return RoadLink("junction", junction_ids[node.name]) if node else None

        lanes = (
            *reversed(self._lanes(1, None, None)),
            LaneRecord(0, "none", (), self._centre_marks(street)),
            *self._lanes(-1, None, None),
        )
        return RoadRecord(
            street.id,
            street.length,
            street.geometry,
            (SectionRecord(0.0, lanes),),
            name=street.name,
            predecessor=end(street.start),
            successor=end(street.end),
            speeds=(SpeedRecord(0.0, street.speed / 3.6),),
            objects=tuple(self._objects(street, ids)),
        )

    def _centre_marks(self, street: Street) -> tuple[RoadMark, ...]:
        """Broken in the open, unbroken before junctions, none past the stop line."""
        marks = []
        bare, bare_end = ((STOP_BEHIND_CROSSWALK if n and n.crosswalks else 0.0) for n in (street.start, street.end))
        if bare:
            marks.append(NO_MARK)
        before, behind = (SOLID_BEFORE_JUNCTION if n else 0.0 for n in (street.start, street.end))
        is_short = street.length < before + behind + 10.0
        if is_short or street.start:
            marks.append(RoadMark(bare, "solid", "white", 0.12, "none"))
        if not is_short:
            marks.append(RoadMark(before, "broken", "white", 0.12, "none"))
            if street.end:
                marks.append(RoadMark(street.length - behind, "solid", "white", 0.12, "none"))
        if bare_end:
            marks.append(replace(NO_MARK, s=street.length - bare_end))
        return tuple(marks)

    def _objects(self, street: Street, ids: Iterator[int]) -> list[ObjectRecord]:
        """Speed signs, crosswalks and stop lines of a street."""
        things = []
        beside = self.section.kerb + POLE_BESIDE
        for side in (-1, 1):
            s = SIGN_SETBACK if side < 0 else street.length - SIGN_SETBACK
            things.append(
                ObjectRecord(
                    next(ids),
                    f"Speed_{street.speed}",
                    s,
                    side * beside,
                    "-1",
                    heading=0.0 if side < 0 else math.pi,
                    orientation="-" if side < 0 else "+",
                )
            )
        for node, at_start in ((street.start, True), (street.end, False)):
            if node is None:
                continue
            inward = 1 if at_start else -1  # side of the lane that leads into the junction

            def along(back: float, at_start: bool = at_start) -> float:
                return back if at_start else street.length - back

            if node.crosswalks:
                a, b, v = (CROSSWALK[1] - CROSSWALK[0]) / 2.0, 0.0, self.section.kerb
                corners = ((a, v, b), (a, -v, b), (-a, -v, b), (-a, v, b), (a, v, b))
                things.append(
                    ObjectRecord(
                        next(ids),
                        "SimpleCrosswalk",
                        along(sum(CROSSWALK) / 2.0),
                        0.0,
                        "crosswalk",
                        orientation="+",
                        length=2.0 * a,
                        width=2.0 * v,
                        outline=corners,
                    )
                )
            if node.lights:
                a, v = STOP_WIDTH / 2.0, self.section.lane / 2.0 - 0.1
                bar = ((a, v, 0.0), (a, -v, 0.0), (-a, -v, 0.0), (-a, v, 0.0))
                things.append(
                    ObjectRecord(
                        next(ids),
                        "StopLine",
                        along(STOP_BEHIND_CROSSWALK if node.crosswalks else STOP_BARE),
                        inward * self.section.lane / 2.0,
                        "-1",
                        orientation="-" if inward < 0 else "+",
                        length=2.0 * a,
                        width=2.0 * v,
                        outline=bar,
                    )
                )
        return things

    # Junctions

    def _junction(
        self, node: Node, junction_id: int, ids: Iterator[int]
    ) -> tuple[JunctionRecord, list[RoadRecord], list[ControllerRecord], list[tuple[int, SignalRecord]]]:
        arms = sorted(node.arms, key=lambda arm: self._direction(*arm))
        setback = self._setback(node)
        signal_ids = [next(ids) for _ in arms] if node.lights else []
        ways: list[RoadRecord] = []
        connections: list[ConnectionRecord] = []
        for i, (source, from_start) in enumerate(arms):
            for k in range(1, len(arms)):
                j = (i + k) % len(arms)
                target, to_start = arms[j]
                # Seen from above, the next arm counter-clockwise is the first street to the right of who drives in.
                outer = k == 1
                road_id = next(ids)
                inner = self._direction(source, from_start) + math.pi
                bend = _wrap(self._direction(target, to_start) - inner)
                pen = Pen(node.x - setback * math.cos(inner), node.y - setback * math.sin(inner), inner)
                if abs(bend) < 1e-6:
                    pen.line(2.0 * setback)
                else:
                    radius = setback / math.tan(abs(bend) / 2.0)
                    pen.arc(radius * abs(bend), math.copysign(1.0 / radius, bend))
                # A street that starts here leads in on its left side (+) and out on its right (-).
                lanes = self._lanes(-1, 1 if from_start else -1, -1 if to_start else 1)
                lanes = lanes if outer else (replace(lanes[0], marks=(NO_MARK,)),)
                links = tuple((int(lane.predecessor or 0), lane.id) for lane in lanes)
                reference = SignalReference(signal_ids[i], REFERENCE_S, 0.0, "-", ((-1, -1),)) if node.lights else None
                ways.append(
                    RoadRecord(
                        road_id,
                        pen.s,
                        tuple(pen.pieces),
                        (SectionRecord(0.0, (LaneRecord(0, "none", (), (NO_MARK,)), *lanes)),),
                        name=f"{node.name}: {source.name} to {target.name}",
                        junction=junction_id,
                        predecessor=RoadLink("road", source.id, "start" if from_start else "end"),
                        successor=RoadLink("road", target.id, "start" if to_start else "end"),
                        references=(reference,) if reference else (),
                    )
                )
                connections.append(ConnectionRecord(len(connections), source.id, road_id, "start", links))
        controllers, signals = [], []
        for signal_id, (street, at_start) in zip(signal_ids, arms, strict=False):
            controllers.append(ControllerRecord(next(ids), (signal_id,), f"{node.name}: {street.name}"))
            side = 1 if at_start else -1
            signals.append(
                (
                    street.id,
                    SignalRecord(
                        signal_id,
                        "Signal_3Light_Post01",
                        POLE_SETBACK if at_start else street.length - POLE_SETBACK,
                        side * (self.section.kerb + POLE_BESIDE),
                        "1000001",
                        h_offset=math.pi if at_start else 0.0,
                        orientation="+" if at_start else "-",
                        dynamic=True,
                        height=1.1,
                        width=0.4,
                        validity=((0, 0),),
                    ),
                )
            )
        record = JunctionRecord(junction_id, tuple(connections), tuple(c.id for c in controllers), node.name)
        return record, ways, controllers, signals
