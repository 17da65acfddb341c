"""Lights, stop, yield and speed signs: where they stand, which lanes they govern, where to stop for them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.map.lane import LaneTable
from lavsim.map.records import SPEED_UNITS, JunctionRecord, Network, ObjectRecord, RoadRecord, SignalRecord, Validity
from lavsim.map.section import RoadShape
from lavsim.map.stop_lines import StopLine, painted_lines, point_on, stop_line, width_on
from lavsim.types import LaneType

LIGHT_TYPES = {"1000001", "1000002", "1000009", "1000010", "1000011", "1000012", "1000013"}
SPEED_TYPE = "274"
SIGN_TYPES = {"206": "stop", "205": "yield", SPEED_TYPE: "speed"}
LANDMARK_SHIFT = 0.25  # [m] CARLA moves the landmark of a light along its own forward axis (reference `carla.md` 3.2)
TRIGGER_HALF_LENGTH = 1.5  # [m]
TRIGGER_SETBACK = 3.0  # [m] centre of the trigger box before the reference point: half length plus a gap of 1.5
TRIGGER_WIDTH_SHARE = 0.25  # of the lane width, to either side
TRIGGER_HALF_HEIGHT = 1.0  # [m]
CUBE_SHARE = 0.45  # half side of the trigger cube of stop and yield signs, and of lights before 0.9.14, in lane widths
SPEED_CUBE_SHARE = 0.35  # the same of speed signs
STOP_STEP = 0.5  # [m] the leaderboard's walk to the stop waypoint
MOST_GOVERNED = 20_000  # signals times the lanes for which they count; Town04 has some 200
_SPEED_NAME = re.compile(r"[Ss]peed_(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class TriggerBox:
    """Ground on which a vehicle is "at" a light or sign, for one lane (reference `carla.md` 4.2, 4.3, 4.5).

    Attributes:
        lane: Lane on which its centre lies.
        u: Of its centre on the lane [m].
        x, y, z: Its centre [m].
        yaw: Direction of travel there [rad].
        half_length, half_width, half_height: Along the lane, across it, upwards [m].
    """

    lane: int
    u: float
    x: float
    y: float
    z: float
    yaw: float
    half_length: float
    half_width: float
    half_height: float


@dataclass(frozen=True)
class TrafficLight:
    """A three-lamp signal.

    Attributes:
        index: Its number in `TownMap.lights` and in snapshots.
        signal_id: Its id in the file.
        x, y, z: Where the signal stands, as the file says (foot of its post, or its head where it hangs) [m].
        yaw: Direction in which the lamps look, towards the traffic they govern [rad].
        junction: Index of its junction, or -1.
        trigger: x, y, yaw, half length (along the lane), half width of its trigger box [m, rad].
        lanes: Junction lanes it governs.
        approach: Driving lanes that lead into them.
        stop_lines: One for each approach lane.
        boxes: Trigger boxes of CARLA 0.9.14 and later, one for each approach lane.
        early_boxes: Those of 0.9.10 to 0.9.13, one for each place where the light counts; possibly in the junction.
    """

    index: int
    signal_id: int
    x: float
    y: float
    z: float
    yaw: float
    junction: int
    trigger: tuple[float, float, float, float, float]
    lanes: tuple[int, ...]
    approach: tuple[int, ...]
    stop_lines: tuple[StopLine, ...]
    boxes: tuple[TriggerBox, ...] = ()
    early_boxes: tuple[TriggerBox, ...] = ()


@dataclass(frozen=True)
class Sign:
    """A stop, yield or speed sign.

    Attributes:
        index: Its number in `TownMap.signs`, as in `LaneTable.sign`.
        kind: "stop", "yield" or "speed".
        signal_id: Its id in the file.
        x, y, z: Where it stands [m].
        yaw: Direction in which its face looks, towards the traffic it governs [rad].
        value: Speed limit [m/s]; 0 for stop and yield signs.
        junction: Index of the junction it guards, or -1.
        trigger: x, y, yaw, half length (along the lane), half width of the box over all its lanes [m, rad].
        lanes: Junction lanes on which traffic must stop or yield; of a speed sign the lanes where it stands.
        approach: Driving lanes that lead into them; none of a speed sign.
        stop_lines: One for each approach lane.
        boxes: Trigger boxes, one for each lane at each place where it counts.
    """

    index: int
    kind: str
    signal_id: int
    x: float
    y: float
    z: float
    yaw: float
    value: float
    junction: int
    trigger: tuple[float, float, float, float, float]
    lanes: tuple[int, ...]
    approach: tuple[int, ...]
    stop_lines: tuple[StopLine, ...]
    boxes: tuple[TriggerBox, ...]


@dataclass(frozen=True)
class LightGroup:
    """Lights of one junction that take turns: one phase after the other is green, in the order of the file."""

    junction: int
    phases: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class _Place:
    """A spot on a road where a light counts, and the lane ids there."""

    road: RoadRecord
    s: float
    ranges: Validity


def lane_ranges(validity: Validity, orientation: str) -> Validity:
    """Lane id ranges of a signal; without a validity record the orientation names the side, as CARLA reads it."""
    if validity:
        return tuple((min(a, b), max(a, b)) for a, b in validity if (a, b) != (0, 0))
    if orientation == "+":
        return ((1, 10_000),)
    if orientation == "-":
        return ((-10_000, -1),)
    return ((-10_000, 10_000),)


def speed_of(thing: ObjectRecord | SignalRecord) -> float | None:
    """Limit [m/s] on a speed sign in either encoding; None for anything else."""
    if isinstance(thing, ObjectRecord):
        match = _SPEED_NAME.match(thing.name)
        return float(match.group(1)) / 3.6 if match else None
    if thing.kind == SPEED_TYPE and thing.value > 0.0:
        return thing.value * SPEED_UNITS.get(thing.unit.strip().lower() or "km/h", 1.0 / 3.6)
    return None


def speed_signs(network: Network) -> dict[int, list[tuple[float, Validity, float]]]:
    """Speed signs by road id: (s, lane id ranges, limit [m/s]).

    Objects named `Speed_NN` as in CARLA's towns (km/h whatever the unit says) and signals of type 274.
    """
    found: dict[int, list[tuple[float, Validity, float]]] = {}
    for thing, _, places in _standing(network):
        limit = speed_of(thing)
        if limit is not None:
            for place in places:
                found.setdefault(place.road.id, []).append((place.s, place.ranges, limit))
    return found


def object_side(thing: ObjectRecord) -> str:
    """Side of the road where an object stands, "+" or "-"."""
    return thing.orientation if thing.orientation in ("+", "-") else ("+" if thing.t > 0.0 else "-")


def _standing(network: Network) -> list[tuple[SignalRecord | ObjectRecord, RoadRecord, list[_Place]]]:
    """Each signal, and each object that is a speed sign, with the places where it counts; in file order."""
    places: dict[int, list[_Place]] = {}
    for road in network.roads:
        for reference in road.references:
            ranges = lane_ranges(reference.validity, reference.orientation)
            known = places.setdefault(reference.id, [])
            if ranges:
                known.append(_Place(road, reference.s, ranges))
    found: list[tuple[SignalRecord | ObjectRecord, RoadRecord, list[_Place]]] = []
    for road in network.roads:
        for signal in road.signals:
            own = lane_ranges(signal.validity, signal.orientation)
            fallback = [_Place(road, signal.s, own)] if own else []
            found.append((signal, road, places.get(signal.id, fallback)))
        found += [
            (o, road, [_Place(road, o.s, lane_ranges((), object_side(o)))])
            for o in road.objects
            if _SPEED_NAME.match(o.name)
        ]
    return found


@dataclass
class _Governed:
    """What a signal means on the lanes.

    Attributes:
        lanes: Junction lanes it governs.
        approach: Lane -> how far beyond its end the nearest reference lies [m], negative before it.
        at: (lane, u) of each place where it counts.
    """

    lanes: list[int]
    approach: dict[int, float]
    at: list[tuple[int, float]]


class _Governing:
    """Finds the lanes of the places where signals count."""

    def __init__(self, lanes: LaneTable) -> None:
        self.lanes = lanes
        by_road: dict[int, list[int]] = {}
        for lane in lanes.where(int(LaneType.DRIVING)):
            by_road.setdefault(int(lanes.road_id[lane]), []).append(int(lane))
        self.arrays = {road: np.array(members) for road, members in by_road.items()}
        self.low, self.high = np.minimum(lanes.s_start, lanes.s_end), np.maximum(lanes.s_start, lanes.s_end)
        self.left = MOST_GOVERNED

    def at(self, places: Sequence[_Place]) -> list[tuple[int, float]]:
        """Driving lanes at `places`, and where on them [m]."""
        lanes, found = self.lanes, []
        for place in places:
            members = self.arrays.get(place.road.id)
            if members is None:
                continue
            there = (self.low[members] - 1e-6 <= place.s) & (place.s <= self.high[members] + 1e-6)
            for lane in members[there].tolist():
                if any(a <= lanes.lane_id[lane] <= b for a, b in place.ranges):
                    found.append((lane, lanes.u_of_s(lane, place.s)))
            self.left -= len(found)
            if self.left < 0:
                raise MapError(f"line {place.road.line}: too many signals over too many lanes; that is no town.")
        return found

    def __call__(self, places: Sequence[_Place]) -> _Governed:
        lanes, at = self.lanes, self.at(places)
        approach: dict[int, float] = {}
        governed: list[int] = []
        for lane, beyond in at:
            if lanes.junction[lane] >= 0:
                governed.append(lane)
                leading = [int(p) for p in lanes.predecessors(lane) if lanes.junction[p] < 0]
            else:  # a reference before the junction: it counts for all ways in
                beyond -= float(lanes.length[lane])
                leading = [lane]
                governed += [int(n) for n in lanes.successors(lane) if lanes.junction[n] >= 0]
            for before in leading:
                approach[before] = min(beyond, approach.get(before, np.inf))
        return _Governed(list(dict.fromkeys(governed)), approach, at)


def build_lights(
    network: Network, shapes: dict[int, RoadShape], lanes: LaneTable
) -> tuple[tuple[TrafficLight, ...], NDArray[np.int32]]:
    """The lights of a town, and the light of each lane."""
    govern = _Governing(lanes)
    paint = painted_lines(network, shapes)
    governing = np.full(len(lanes), -1, np.int32)
    lights: list[TrafficLight] = []
    for signal, road, places in _standing(network):
        if not isinstance(signal, SignalRecord) or signal.kind not in LIGHT_TYPES:
            continue
        governed = govern(places)
        for lane in governed.lanes:
            if governing[lane] < 0:
                governing[lane] = len(lights)
        lights.append(_light(len(lights), signal, shapes[road.id], lanes, governed, paint))
    return tuple(lights), governing


def build_signs(
    network: Network, shapes: dict[int, RoadShape], lanes: LaneTable
) -> tuple[tuple[Sign, ...], NDArray[np.int32]]:
    """The signs of a town, and the stop or yield sign of each junction lane (a stop sign where it has both)."""
    govern = _Governing(lanes)
    paint = painted_lines(network, shapes)
    governing = np.full(len(lanes), -1, np.int32)
    signs: list[Sign] = []
    for thing, road, places in _standing(network):
        limit = speed_of(thing)
        if limit is None and (isinstance(thing, ObjectRecord) or SIGN_TYPES.get(thing.kind) not in ("stop", "yield")):
            continue
        sign = _sign(len(signs), thing, limit, shapes[road.id], lanes, govern(places), paint)
        for lane in sign.lanes if limit is None else ():
            if governing[lane] < 0 or (sign.kind == "stop" and signs[governing[lane]].kind == "yield"):
                governing[lane] = sign.index
        signs.append(sign)
    return tuple(signs), governing


def _box(
    lanes: LaneTable, lane: int, u: float, half_length: float, half_width: float, half_height: float
) -> TriggerBox:
    x, y, z, yaw, _ = (float(v) for v in point_on(lanes, lane, u))
    return TriggerBox(lane, u, x, y, z, yaw, half_length, half_width, half_height)


def _cube(lanes: LaneTable, lane: int, u: float, share: float) -> TriggerBox:
    """The cube of half side `share` lane widths that ends at `u`, on the lane before where it does not fit."""
    half = share * width_on(lanes, lane, u)
    u -= half
    before = lanes.predecessors(lane)
    if u < 0.0 and len(before):
        lane = int(before[0])
        u += float(lanes.length[lane])
    return _box(lanes, lane, max(u, 0.0), half, half, half)


def _span(boxes: Sequence[TriggerBox]) -> tuple[float, float, float, float, float]:
    """One box over the boxes of lanes side by side; another approach's must not pull it into the junction."""
    first = boxes[0]
    beside = [b for b in boxes if np.cos(b.yaw - first.yaw) > 0.5]
    middle = np.mean([(b.x, b.y) for b in beside], axis=0)
    aside = np.array([-np.sin(first.yaw), np.cos(first.yaw)])
    across = (np.array([(b.x, b.y) for b in beside]) - middle) @ aside
    return (
        float(middle[0]),
        float(middle[1]),
        first.yaw,
        first.half_length,
        float(np.ptp(across)) / 2.0 + first.half_width,
    )


def _stops(lanes: LaneTable, approach: dict[int, float], paint: NDArray[np.float64]) -> list[tuple[float, StopLine]]:
    """Trigger centre and stop line of each approach lane."""
    found = []
    for lane, beyond in approach.items():
        length = float(lanes.length[lane])
        u = min(max(length - max(TRIGGER_SETBACK - beyond, 0.0), 0.0), length)
        last = u + STOP_STEP * np.floor((length - u) / STOP_STEP + 1e-9)
        found.append((u, stop_line(lanes, lane, float(last), paint)))
    return found


def _facing(boxes: Sequence[TriggerBox], yaw: float) -> float:
    """Direction that looks at the traffic in `boxes`; against `yaw` without any. In [-pi, pi)."""
    if boxes:
        yaw = float(np.arctan2(np.sin([b.yaw for b in boxes]).mean(), np.cos([b.yaw for b in boxes]).mean()))
    return float((yaw + np.pi + np.pi) % (2.0 * np.pi) - np.pi)


def _light(
    index: int,
    signal: SignalRecord,
    shape: RoadShape,
    lanes: LaneTable,
    governed: _Governed,
    paint: NDArray[np.float64],
) -> TrafficLight:
    x, y, z, yaw = shape.place(signal.s, signal.t)
    yaw -= signal.h_offset
    ahead = LANDMARK_SHIFT * float(np.cos(signal.pitch))
    x, y = x + ahead * float(np.cos(yaw)), y + ahead * float(np.sin(yaw))
    z += LANDMARK_SHIFT * float(np.sin(signal.pitch))
    stops = _stops(lanes, governed.approach, paint)
    boxes = tuple(
        _box(lanes, stop.lane, u, TRIGGER_HALF_LENGTH, TRIGGER_WIDTH_SHARE * stop.width, TRIGGER_HALF_HEIGHT)
        for u, stop in stops
    )
    return TrafficLight(
        index=index,
        signal_id=signal.id,
        x=float(x),
        y=float(y),
        z=z + signal.z_offset,
        yaw=_facing(boxes, yaw),
        junction=int(lanes.junction[governed.lanes[0]]) if governed.lanes else -1,
        trigger=_span(boxes) if boxes else (x, y, yaw, TRIGGER_HALF_LENGTH, 1.0),
        lanes=tuple(governed.lanes),
        approach=tuple(governed.approach),
        stop_lines=tuple(stop for _, stop in stops),
        boxes=boxes,
        early_boxes=tuple(_cube(lanes, lane, u, CUBE_SHARE) for lane, u in governed.at),
    )


def _sign(
    index: int,
    thing: SignalRecord | ObjectRecord,
    limit: float | None,
    shape: RoadShape,
    lanes: LaneTable,
    governed: _Governed,
    paint: NDArray[np.float64],
) -> Sign:
    x, y, z, yaw = (float(v) for v in shape.place(thing.s, thing.t))
    yaw -= thing.h_offset if isinstance(thing, SignalRecord) else thing.heading
    share = CUBE_SHARE if limit is None else SPEED_CUBE_SHARE
    boxes = tuple(_cube(lanes, lane, u, share) for lane, u in governed.at)
    kind = "speed" if limit is not None else SIGN_TYPES[thing.kind]
    ways = governed.lanes if limit is None else list(dict.fromkeys(lane for lane, _ in governed.at))
    inside = [int(lanes.junction[k]) for k in ways if lanes.junction[k] >= 0]
    return Sign(
        index=index,
        kind=kind,
        signal_id=thing.id,
        x=x,
        y=y,
        z=z + thing.z_offset,
        yaw=_facing(boxes, yaw),
        value=limit or 0.0,
        junction=inside[0] if inside else -1,
        trigger=_span(boxes) if boxes else (x, y, yaw, 1.0, 1.0),
        lanes=tuple(ways),
        approach=tuple(governed.approach) if limit is None else (),
        stop_lines=tuple(stop for _, stop in _stops(lanes, governed.approach, paint)) if limit is None else (),
        boxes=boxes,
    )


def build_groups(
    network: Network, junctions: Sequence[JunctionRecord], lights: Sequence[TrafficLight]
) -> tuple[LightGroup, ...]:
    """Which lights take turns. A light that no junction's controller holds is a group of its own."""
    by_signal = {light.signal_id: light.index for light in lights}
    controllers = {c.id: c for c in network.controllers}
    groups: list[LightGroup] = []
    taken: set[int] = set()
    for number, junction in enumerate(junctions):
        phases = []
        for controller in junction.controllers:
            signals = controllers[controller].signals if controller in controllers else ()
            phase = tuple(by_signal[s] for s in signals if s in by_signal and by_signal[s] not in taken)
            if phase:
                phases.append(phase)
                taken.update(phase)
        if phases:
            groups.append(LightGroup(number, tuple(phases)))
    groups += [LightGroup(light.junction, ((light.index,),)) for light in lights if light.index not in taken]
    return tuple(groups)
