"""OpenDRIVE records of a sketched town: its streets' roads, and the ways, lights and signs of its nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from lavsim.map.records import (
    ConnectionRecord,
    ControllerRecord,
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
from lavsim.towns.layout import (
    CROSSWALK,
    ON,
    ROUNDABOUT_LANE,
    ROUNDABOUT_SPREAD,
    Arm,
    Layout,
    Node,
    RampNode,
    Roundabout,
    Street,
)
from lavsim.towns.pen import Pen, Place, shifted, wrap
from lavsim.towns.section import CURB, LINE, NO_MARK, CrossSection, centre_marks, eased, side_lanes

STOP_BEHIND_CROSSWALK = 5.5  # [m] before the junction: middle of the painted stop line
STOP_BARE = 3.0  # [m] the same without a crosswalk
STOP_WIDTH = 0.4  # [m]
POLE_SETBACK = 1.0  # [m] before the junction: past the crosswalk, so that who waits at the line sees the lamps
POLE_BESIDE = 0.5  # [m] from the kerb
FAR_POLE_BESIDE = 0.9  # [m] from the kerb, of the post of a mast arm
SIGN_SETBACK = 8.0  # [m] of speed signs after the junction
CIRCLE_SPEED = 30  # [km/h] in roundabouts
CIRCLE_SIGN = 20.0  # [m] before a roundabout: where its speed is shown
GORE_SIGN = 28.0  # [m] of speed signs after a ramp's junction: where the ramp has left
SIGN_EVERY = 450.0  # [m] between speed signs on a long street
FILL = 3.4  # [m] of pavement to the left of turns at a wide crossing
REFERENCE_S = 0.1  # [m] of signal references on connecting roads
SIGNS = {"stop": ("Sign_Stop", "206"), "all stop": ("Sign_Stop", "206"), "yield": ("Sign_Yield", "205")}
RING = CrossSection(lane=ROUNDABOUT_LANE, sidewalk=2.5, back=0)


def draw_network(layout: Layout) -> Network:
    """The town as OpenDRIVE records."""
    return _Builder(layout).build()


@dataclass(frozen=True)
class _Mouth:
    """One side of a road's end: where ways begin or end.

    Attributes:
        road: Its id.
        contact: Which end of it.
        section: Its strips.
        side: Of the lanes in question.
        place: The centre line's end, heading as traffic does.
        name: Of the street.
    """

    road: int
    contact: str
    section: CrossSection
    side: int
    place: Place
    name: str

    @property
    def lanes(self) -> int:
        return self.section.count(self.side)

    def inner(self, lane: int) -> float:
        """Centre line to the left edge of the `lane`-th lane [m]."""
        median = self.section.median if self.lanes else 0.0
        return median + lane * self.section.lane

    def at(self, offset: float) -> Place:
        """The end's place moved to the right."""
        return shifted(self.place, 0.0, -offset)

    def lane_id(self, kind: str, number: int = 0) -> int | None:
        return self.section.lane_id(self.side, kind, number)


def _mouth_in(arm: Arm) -> _Mouth:
    street = arm.street
    return _Mouth(
        street.id, "start" if arm.at_start else "end", arm.section, arm.inward, arm.mouth, street.name
    )  # fmt: skip


def _mouth_out(arm: Arm) -> _Mouth:
    x, y, heading = arm.mouth
    return replace(_mouth_in(arm), side=-arm.inward, place=(x, y, heading + math.pi))


class _Builder:
    """Numbers and collects the records."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.ids: Iterator[int] = iter(range(1, 1_000_000))
        self.junction_ids: dict[tuple[int, bool], int] = {}  # by street (its id()) and end
        self.roads: dict[int, RoadRecord] = {}
        self.connecting: dict[int, RoadRecord] = {}
        self.junctions: list[JunctionRecord] = []
        self.controllers: list[ControllerRecord] = []

    def build(self) -> Network:
        layout = self.layout
        for street in layout.streets:
            street.id = next(self.ids)
        layout.trace()
        for node in layout.nodes.values():
            shared = None if isinstance(node, Roundabout) else next(self.ids)
            for street, at_start in node.ends:
                self.junction_ids[id(street), at_start] = next(self.ids) if shared is None else shared
        for street in layout.streets:
            self.roads[street.id] = self._street(street)
        for node in layout.nodes.values():
            if isinstance(node, Roundabout):
                self._roundabout(node)
            elif isinstance(node, RampNode):
                self._ramps(node)
            else:
                self._crossing(node)
        roads = (*self.roads.values(), *self.connecting.values())
        return Network(roads, tuple(self.junctions), tuple(self.controllers), name=layout.name)

    # Streets

    def _link(self, street: Street, at_start: bool) -> RoadLink | None:
        return RoadLink("junction", self.junction_ids[id(street), at_start]) if street.node(at_start) else None

    def _street(self, street: Street) -> RoadRecord:
        section, length = street.section, street.length
        joins = (street.start is not None, street.end is not None)
        first, last = (STOP_BEHIND_CROSSWALK if n and n.crosswalks else 0.0 for n in (street.start, street.end))
        bare = (first, last)
        lanes = (
            *reversed(side_lanes(section, 1, length, joins, bare)),
            LaneRecord(0, "none", (), centre_marks(section, length, joins, bare)),
            *side_lanes(section, -1, length, joins, bare),
        )
        return RoadRecord(
            street.id,
            length,
            street.geometry,
            (SectionRecord(0.0, lanes),),
            name=street.name,
            predecessor=self._link(street, True),
            successor=self._link(street, False),
            speeds=(SpeedRecord(0.0, street.speed / 3.6),),
            objects=tuple(self._objects(street)),
        )

    def _objects(self, street: Street) -> list[ObjectRecord]:
        """Speed signs, crosswalks and stop lines of a street."""
        section, length = street.section, street.length
        things = []
        for side in (-1, 1):
            if not section.count(side):
                continue
            beside = section.edge(side) + POLE_BESIDE
            gore = isinstance(street.node(side < 0), RampNode) and not section.is_one_way
            first = min(GORE_SIGN, length / 2.0) if gore else SIGN_SETBACK
            limits = [(first + k * SIGN_EVERY, street.speed) for k in range(1 + int((length - first) / SIGN_EVERY))]
            if isinstance(street.node(side > 0), Roundabout) and street.speed > CIRCLE_SPEED:
                limits.append((length - CIRCLE_SIGN, CIRCLE_SPEED))
            for passed, limit in limits:
                s = passed if side < 0 else length - passed
                heading, orientation = (0.0, "-") if side < 0 else (math.pi, "+")
                things.append(
                    ObjectRecord(
                        next(self.ids), f"Speed_{limit}", s, side * beside, "-1",
                        heading=heading, orientation=orientation,
                    )
                )  # fmt: skip
        for at_start in (True, False):
            node = street.node(at_start)
            if node is None:
                continue
            arm = node.arm(street, at_start)
            if node.crosswalks:
                s = sum(CROSSWALK) / 2.0
                right, left = section.edge(-1), section.edge(1)
                things.append(
                    _slab(
                        next(self.ids), "SimpleCrosswalk", s if at_start else length - s, (left - right) / 2.0,
                        CROSSWALK[1] - CROSSWALK[0], left + right, "crosswalk", "+", closed=True,
                    )
                )  # fmt: skip
            if node.has_line(arm):
                inward = arm.inward
                back = STOP_BEHIND_CROSSWALK if node.crosswalks else STOP_BARE
                width = section.count(inward) * section.lane
                things.append(
                    _slab(
                        next(self.ids), "StopLine", back if at_start else length - back,
                        inward * (section.median + width / 2.0), STOP_WIDTH, width - 0.2, "-1",
                        "-" if inward < 0 else "+",
                    )
                )  # fmt: skip
        return things

    # Nodes

    def _crossing(self, node: Node) -> None:
        arms = node.arms()
        signals = {i: next(self.ids) for i, arm in enumerate(arms) if node.halts(arm)}
        junction = _Junction(self, node.name, self.junction_ids[id(arms[0].street), arms[0].at_start])
        moves, setbacks = _movements(arms), node.setbacks(self.layout.corner_radius)
        kerbs: dict[int, int] = {}  # arm -> the way along the kerb to the next one
        for i, source in enumerate(arms):
            for k in range(1, len(arms)):
                j = (i + k) % len(arms)
                a, b = _mouth_in(source), _mouth_out(arms[j])
                for lane, target in moves.get((i, j), []):
                    # The next arm counter-clockwise is reached along the kerb.
                    along_kerb = k == 1 and lane == a.lanes - 1 and target == b.lanes - 1
                    pen = None
                    if setbacks[i] == setbacks[j] and a.inner(lane) == b.inner(target) == 0.0:
                        pen = _turn(node, setbacks[i], source.heading + math.pi, arms[j].heading)
                    fill = _fill(source, arms[j], lane)
                    road = junction.way(
                        a, b, lane, target, kerb=along_kerb, fill=fill, signal=signals.get(i), pen=pen
                    )  # fmt: skip
                    if along_kerb:
                        kerbs[i] = road
                if k == 1 and i not in kerbs and len(arms) > 2:
                    kerbs[i] = junction.kerb(a, b)
        controllers = []
        for i, signal in signals.items():
            if node.control == "lights":
                controllers.append(
                    ControllerRecord(next(self.ids), (signal,), f"{node.name}: {arms[i].street.name}")
                )  # fmt: skip
            self._post(node, arms, i, signal, kerbs)
        self.controllers += controllers
        junction.close(tuple(c.id for c in controllers))

    def _post(self, node: Node, arms: Sequence[Arm], i: int, signal: int, kerbs: dict[int, int]) -> None:
        """Sets up the light or sign of arm `i`: at the arm's right, or beyond the crossing."""
        arm = arms[i]
        street, side = arm.street, arm.inward
        if node.control == "lights" and node.across:
            host, s, t, heading = self._beyond(arms, i, kerbs)
            turn = wrap(arm.mouth[2] - heading)
            record = SignalRecord(
                signal, "Signal_3Light_MastArm", s, t, "1000001", h_offset=turn, orientation="+", dynamic=True,
                height=1.1, width=0.4, validity=((0, 0),),
            )  # fmt: skip
        else:
            host = street.id
            lights = node.control == "lights"
            name, kind = ("Signal_3Light_Post01", "1000001") if lights else SIGNS[node.control]
            back = POLE_SETBACK if lights else STOP_BARE if not node.crosswalks else STOP_BEHIND_CROSSWALK
            record = SignalRecord(
                signal, name, back if arm.at_start else street.length - back,
                side * (street.section.edge(side) + POLE_BESIDE), kind,
                z_offset=0.0 if lights else 2.0, h_offset=math.pi if arm.at_start else 0.0,
                orientation="+" if arm.at_start else "-", dynamic=lights,
                height=1.1 if lights else 0.75, width=0.4 if lights else 0.75, validity=((0, 0),),
            )  # fmt: skip
        table = self.roads if host in self.roads else self.connecting
        table[host] = replace(table[host], signals=(*table[host].signals, record))

    def _beyond(self, arms: Sequence[Arm], i: int, kerbs: dict[int, int]) -> tuple[int, float, float, float]:
        """Road, s, t and the road's heading where the mast for arm `i` stands: behind the far right corner."""
        arm = arms[i]
        ahead = arm.mouth[2]
        bends = [abs(wrap(other.heading - ahead)) for other in arms]
        j = min((k for k in range(len(arms)) if k != i), key=lambda k: bends[k])
        if bends[j] < ON:
            far, side = arms[j], -arms[j].inward
            edge = far.section.edge(side)
            s = POLE_SETBACK if far.at_start else far.street.length - POLE_SETBACK
            heading = arms[j].mouth[2] + (math.pi if far.at_start else 0.0)
            return far.street.id, s, side * (edge + FAR_POLE_BESIDE), heading
        # At the stem of a T: beside the way along the far kerb, a little to the right of who drives in.
        right = (i + 1) % len(arms)
        road = self.connecting[kerbs[right]]
        width = sum(lane.widths[0].a for lane in road.sections[0].lanes if lane.kind in ("driving", "shoulder"))
        shift = arm.section.edge(arm.inward)
        x, y, h = shifted(arm.mouth, 0.0, -shift)
        s = _nearest_s(road, x, y, h)
        place = _pose(road, s)
        return road.id, s, -(width + FAR_POLE_BESIDE), place[2]

    def _ramps(self, node: RampNode) -> None:
        arms = node.arms()
        junction = _Junction(self, node.name, self.junction_ids[id(arms[0].street), arms[0].at_start])
        ramps = [arm for arm in arms if arm.section.is_one_way]
        first, second = node.main()
        for before, behind in ((first, second), (second, first)):
            here = [arm for arm in ramps if node.beside(arm.street, arm.at_start)[0].street is before.street]
            leaving, entering = ([arm for arm in here if arm.at_start is exits] for exits in (True, False))
            a, b = _mouth_in(before), _mouth_out(behind)
            through = min(a.lanes, b.lanes)
            widens, narrows = b.lanes > a.lanes, a.lanes > b.lanes
            keeps_kerb = not here and not widens and not narrows
            junction.way(a, b, 0, 0, count=through, kerb=keeps_kerb or bool(entering and not widens), median=True)
            if widens and not entering:
                junction.way(a, b, a.lanes - 1, b.lanes - 1, kerb=True)
            if narrows and not leaving:
                junction.way(a, b, a.lanes - 1, b.lanes - 1, kerb=True)
            for arm in leaving:
                junction.way(a, _mouth_out(arm), a.lanes - 1, 0, kerb=True)
            for arm in entering:
                junction.way(_mouth_in(arm), b, 0, b.lanes - 1, kerb=widens)
        junction.close(())

    def _roundabout(self, node: Roundabout) -> None:
        arms = node.arms()
        spread, radius = ROUNDABOUT_SPREAD, node.inner
        places = [arm.heading for arm in arms]

        def on_ring(angle: float) -> Place:
            x, y = node.x + radius * math.cos(angle), node.y + radius * math.sin(angle)
            return x, y, angle + math.pi / 2.0

        rings: list[tuple[int, float]] = []  # road behind each arm, and its length
        for i, begin in enumerate(places):
            sweep = (places[(i + 1) % len(arms)] - begin) % (2.0 * math.pi) - 2.0 * spread
            if sweep < 0.1:
                raise ValueError(f"roundabout {node.name}: {arms[i].street.name} is too near to the next street")
            number = next(self.ids)
            pen = Pen(*on_ring(begin + spread))
            pen.arc(radius * sweep, 1.0 / radius)
            joins = (True, True)
            lanes = (
                *reversed(side_lanes(replace(RING, sidewalk=0.0), 1, pen.s, joins)),
                LaneRecord(0, "none", (), (NO_MARK,)),
                *side_lanes(RING, -1, pen.s, joins),
            )
            following = arms[(i + 1) % len(arms)]
            self.roads[number] = RoadRecord(
                number, pen.s, tuple(pen.pieces), (SectionRecord(0.0, lanes),), name=f"{node.name} {i + 1}",
                predecessor=self._link(arms[i].street, arms[i].at_start),
                successor=self._link(following.street, following.at_start),
                speeds=(SpeedRecord(0.0, CIRCLE_SPEED / 3.6),),
            )  # fmt: skip
            rings.append((number, pen.s))
        for i, arm in enumerate(arms):
            signal = next(self.ids)
            junction = _Junction(
                self, f"{node.name}: {arm.street.name}", self.junction_ids[id(arm.street), arm.at_start]
            )  # fmt: skip
            coming = _Mouth(rings[i - 1][0], "end", RING, -1, on_ring(places[i] - spread), node.name)
            going = _Mouth(rings[i][0], "start", RING, -1, on_ring(places[i] + spread), node.name)
            pen = Pen(*coming.place)
            pen.arc(2.0 * spread * radius, 1.0 / radius)
            junction.way(coming, going, 0, 0, pen=pen, island=True)
            if arm.ways_out:
                junction.way(coming, _mouth_out(arm), 0, 0, kerb=True)
            if arm.ways_in:
                junction.way(_mouth_in(arm), going, 0, 0, kerb=True, signal=signal)
                self._post(node, arms, i, signal, {})
            junction.close(())


class _Junction:
    """The connecting roads of one junction on their way into the records."""

    def __init__(self, builder: _Builder, name: str, number: int) -> None:
        self.builder, self.name, self.id = builder, name, number
        self.connections: list[ConnectionRecord] = []

    def way(
        self,
        a: _Mouth,
        b: _Mouth,
        lane: int,
        target: int,
        count: int = 1,
        kerb: bool = False,
        median: bool = False,
        island: bool = False,
        fill: float = 0.0,
        signal: int | None = None,
        pen: Pen | None = None,
    ) -> int:
        """A connecting road from the `lane`-th lane of `a` and the next `count` - 1 to those of `b`; its id.

        Args:
            a, b: Where it comes from and leads to.
            lane, target: First lane of each, from the left.
            count: How many lanes side by side.
            kerb: Whether gutter and sidewalk go with it.
            median: Whether the strip to its left does.
            island: Whether a kerb bounds it to the left.
            fill: Width of bare ground to its left that is paved though no way leads over it [m].
            signal: Light or sign that governs it.
            pen: Its reference line, if it is not just the smoothest.
        """
        pen = pen or _draw(a, b, lane, target)
        lanes: list[LaneRecord] = []
        for k in range(count):
            marks: tuple[RoadMark, ...] = (NO_MARK,)
            if not a.section.kerb and (k < count - 1 or kerb):
                kind, change = ("broken", "both") if k < count - 1 else ("solid", "none")
                marks = (RoadMark(0.0, kind, "white", LINE, change),)
            lanes.append(
                LaneRecord(
                    -k - 1, "driving", eased(a.section.lane, b.section.lane, pen.s), marks,
                    a.lane_id("driving", lane + k), b.lane_id("driving", target + k),
                )
            )  # fmt: skip
        if kerb:
            lanes += _kerb_lanes(a, b, -count - 1, pen.s)
        left = []
        centre = NO_MARK
        if median and a.section.median and b.section.median:
            width = eased(a.section.median, b.section.median, pen.s)
            line = RoadMark(0.0, "solid", a.section.centre, LINE, "none")
            left = [LaneRecord(1, "median", width, (NO_MARK,))]
            centre = CURB if a.section.kerb else line
        elif island:
            left = [LaneRecord(1, "shoulder", (Polynomial(0.0, a.section.gutter),), (CURB,))]
        elif fill:
            left = [LaneRecord(1, "stop", (Polynomial(0.0, fill),), (NO_MARK,))]
        return self._add(a, b, pen, (*left, LaneRecord(0, "none", (), (centre,)), *lanes), signal, count)

    def kerb(self, a: _Mouth, b: _Mouth) -> int:
        """Gutter, sidewalk and the pavement inside them round a corner that no traffic follows."""
        pen = Pen(*a.at(a.section.edge(a.side) - a.section.gutter))
        pen.reach(*b.at(b.section.edge(b.side) - b.section.gutter))
        lanes = _kerb_lanes(a, b, -1, pen.s)
        paved = LaneRecord(1, "stop", (Polynomial(0.0, FILL),), (NO_MARK,))
        return self._add(a, b, pen, (paved, LaneRecord(0, "none", (), (NO_MARK,)), *lanes), None, 0)

    def _add(
        self, a: _Mouth, b: _Mouth, pen: Pen, lanes: tuple[LaneRecord, ...], signal: int | None, count: int
    ) -> int:
        number = next(self.builder.ids)
        reference = () if signal is None else (SignalReference(signal, REFERENCE_S, 0.0, "-", ((-count, -1),)),)
        self.builder.connecting[number] = RoadRecord(
            number, pen.s, tuple(pen.pieces), (SectionRecord(0.0, lanes),), name=f"{self.name}: {a.name} to {b.name}",
            junction=self.id, predecessor=RoadLink("road", a.road, a.contact),
            successor=RoadLink("road", b.road, b.contact), references=reference,
        )  # fmt: skip
        links = tuple((lane.predecessor, lane.id) for lane in lanes if lane.id < 0 and lane.predecessor is not None)
        self.connections.append(ConnectionRecord(len(self.connections), a.road, number, "start", links))
        return number

    def close(self, controllers: tuple[int, ...]) -> None:
        """Files the junction."""
        self.builder.junctions.append(JunctionRecord(self.id, tuple(self.connections), controllers, self.name))


def _draw(a: _Mouth, b: _Mouth, lane: int, target: int) -> Pen:
    """The left edge of a way."""
    begin, finish = a.at(a.inner(lane)), b.at(b.inner(target))
    return Pen(*begin).reach(*finish)


def _turn(node: Node, setback: float, heading: float, onward: float) -> Pen:
    """The way between two streets that end equally far from their node: one arc, or a line."""
    bend = wrap(onward - heading)
    pen = Pen(node.x - setback * math.cos(heading), node.y - setback * math.sin(heading), heading)
    if abs(bend) < 1e-6:
        return pen.line(2.0 * setback)
    radius = setback / math.tan(abs(bend) / 2.0)
    return pen.arc(radius * abs(bend), math.copysign(1.0 / radius, bend))


def _fill(a: Arm, b: Arm, lane: int) -> float:
    """Pavement to the left of a way that no other way may cover: at wide crossings turns leave gaps between them."""
    one_way = [arm.section.lanes for arm in (a, b) if arm.section.is_one_way]
    if one_way:  # to the left of a left turn there is a kerb
        turns_right = wrap(b.heading - a.heading - math.pi) < -ON
        return FILL if turns_right and min(one_way) > 1 else 0.0
    if a.section.is_plain and b.section.is_plain:
        return 0.0
    if abs(wrap(b.heading - a.heading - math.pi)) < ON:
        beside = 2.0 * min(a.section.median, b.section.median) if lane == 0 else 0.0
        return beside if a.ways_in == b.ways_out else FILL
    return FILL


def _kerb_lanes(a: _Mouth, b: _Mouth, first: int, length: float) -> list[LaneRecord]:
    """Gutter and sidewalk of a way; a sidewalk that only one of the streets has fades away."""
    lanes: list[LaneRecord] = []
    for kind in ("shoulder", "sidewalk"):
        ours, theirs = a.lane_id(kind), b.lane_id(kind)
        if ours is None and theirs is None:
            continue
        widths = eased(
            a.section.width(kind) if ours is not None else 0.0,
            b.section.width(kind) if theirs is not None else 0.0,
            length,
        )
        mark = CURB if kind == "shoulder" and (a.section.kerb or b.section.kerb) else NO_MARK
        lanes.append(LaneRecord(first - len(lanes), kind, widths, (mark,), ours, theirs))
    return lanes


def _movements(arms: Sequence[Arm]) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Lane pairs, counted from the left, for each pair of arms (in, out): left turns from the left lane, right turns
    from the right one, straight on from all; no lane is left without a way on or in.
    """
    moves: dict[tuple[int, int], list[tuple[int, int]]] = {}
    number = len(arms)
    for i, arm in enumerate(arms):
        ahead = [(i + k) % number for k in range(1, number)]
        for j in ahead:
            there = arms[j].ways_out
            if not arm.ways_in or not there:
                continue
            bend = wrap(arms[j].heading - arm.heading - math.pi)
            here = arm.ways_in
            if abs(bend) < ON:
                both = min(here, there)
                moves[i, j] = [(here - both + k, there - both + k) for k in range(both)]
            else:
                moves[i, j] = [(0, 0)] if bend > 0.0 else [(here - 1, there - 1)]
        targets = [j for j in ahead if (i, j) in moves]
        for lane in range(arm.ways_in if targets else 0):
            if not any(lane == pair[0] for j in targets for pair in moves[i, j]):
                j = min(targets, key=lambda j: abs(wrap(arms[j].heading - arm.heading - math.pi)))
                moves[i, j].append((lane, min(lane, arms[j].ways_out - 1)))
    for j, arm in enumerate(arms):
        sources = [i for i in range(number) if (i, j) in moves]
        for lane in range(arm.ways_out if sources else 0):
            if not any(lane == pair[1] for i in sources for pair in moves[i, j]):
                i = min(sources, key=lambda i: abs(wrap(arm.heading - arms[i].heading - math.pi)))
                moves[i, j].append((min(lane, arms[i].ways_in - 1), lane))
    return {key: sorted(set(pairs)) for key, pairs in moves.items()}


def _slab(
    number: int, name: str, s: float, t: float, along: float, across: float, kind: str, orientation: str,
    closed: bool = False,
) -> ObjectRecord:  # fmt: skip
    """A painted rectangle."""
    a, v = along / 2.0, across / 2.0
    corners = ((a, v, 0.0), (a, -v, 0.0), (-a, -v, 0.0), (-a, v, 0.0))
    return ObjectRecord(
        number, name, s, t, kind, orientation=orientation, length=2.0 * a, width=2.0 * v,
        outline=(*corners, corners[0]) if closed else corners,
    )  # fmt: skip


def _pose(road: RoadRecord, s: float) -> Place:
    """Place of a road's reference line."""
    g = next(g for g in reversed(road.geometry) if g.s <= s + 1e-9)
    pen = Pen(g.x, g.y, g.heading)
    pen.arc(s - g.s, g.curvature)
    return pen.x, pen.y, pen.heading


def _nearest_s(road: RoadRecord, x: float, y: float, heading: float) -> float:
    """Where a road crosses the ray from (x, y), to a tenth of a metre."""
    places = [0.1 * k for k in range(1, int(road.length * 10.0))]

    def aside(s: float) -> float:
        px, py, _ = _pose(road, s)
        return abs((py - y) * math.cos(heading) - (px - x) * math.sin(heading))

    return min(places, key=aside)
