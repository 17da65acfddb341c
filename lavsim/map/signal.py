"""Traffic lights and speed signs: where they stand, which lanes they govern, where to stop for them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.map.lane import LaneTable, RoadShape
from lavsim.map.opendrive import JunctionRecord, Network, ObjectRecord, RoadRecord, SignalRecord, Validity
from lavsim.types import LaneType

LIGHT_TYPES = {"1000001", "1000002", "1000009", "1000010", "1000011", "1000012", "1000013"}
SPEED_TYPE = "274"
LANDMARK_SHIFT = 0.25  # [m] CARLA moves the landmark of a light along its own forward axis (reference `carla.md` 3.2)
TRIGGER_HALF_LENGTH = 1.5  # [m]
TRIGGER_SETBACK = 3.0  # [m] centre of the trigger box before the reference point: half length plus a gap of 1.5
TRIGGER_WIDTH_SHARE = 0.25  # of the lane width, to either side
STOP_STEP = 0.5  # [m] the leaderboard's walk to the stop waypoint
PAINT_RANGE = 15.0  # [m] a painted stop line farther before the junction belongs to something else
STOP_LINE_NAMES = ("StopLine", "SolidSingleWhite")
_SPEED_NAME = re.compile(r"[Ss]peed_(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class StopLine:
    """Where a lane ends for a red light.

    Attributes:
        lane: Approach lane (index into the lane table).
        road_id: Its road in the file.
        lane_id: Its id in the file.
        u: Stop waypoint of the leaderboard, the last 0.5 m step before the junction, on the lane [m].
        x, y: The same point in the world [m].
        yaw: Direction of travel there [rad].
        width: Lane width there [m].
        paint_u: Painted stop line on the lane [m]; `u` where none is painted.
    """

    lane: int
    road_id: int
    lane_id: int
    u: float
    x: float
    y: float
    yaw: float
    width: float
    paint_u: float


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


def speed_signs(network: Network) -> dict[int, list[tuple[float, Validity, float]]]:
    """Speed signs by road id: (s, lane id ranges, limit [m/s]).

    Objects named `Speed_NN` as in CARLA's towns (km/h whatever the unit says) and signals of type 274.
    """
    found: dict[int, list[tuple[float, Validity, float]]] = {}
    for road in network.roads:
        for thing in road.objects:
            match = _SPEED_NAME.match(thing.name)
            if match:
                side = thing.orientation if thing.orientation in ("+", "-") else ("+" if thing.t > 0.0 else "-")
                found.setdefault(road.id, []).append((thing.s, lane_ranges((), side), float(match.group(1)) / 3.6))
        for signal in road.signals:
            if signal.kind == SPEED_TYPE and signal.value > 0.0:
                scale = 0.44704 if signal.unit == "mph" else 1.0 / 3.6
                ranges = lane_ranges(signal.validity, signal.orientation)
                found.setdefault(road.id, []).append((signal.s, ranges, signal.value * scale))
    return found


def _places(network: Network) -> list[tuple[SignalRecord, RoadRecord, list[_Place]]]:
    """Each light with the places where it counts, in file order."""
    places: dict[int, list[_Place]] = {}
    for road in network.roads:
        for reference in road.references:
            ranges = lane_ranges(reference.validity, reference.orientation)
            if ranges:
                places.setdefault(reference.id, []).append(_Place(road, reference.s, ranges))
    lights = []
    for road in network.roads:
        for signal in road.signals:
            if signal.kind in LIGHT_TYPES:
                own = lane_ranges(signal.validity, signal.orientation)
                fallback = [_Place(road, signal.s, own)] if own else []
                lights.append((signal, road, places.get(signal.id) or fallback))
    return lights


def build_lights(
    network: Network, shapes: dict[int, RoadShape], lanes: LaneTable
) -> tuple[tuple[TrafficLight, ...], NDArray[np.int32]]:
    """The lights of a town, and the light of each lane."""
    by_road: dict[int, list[int]] = {}
    for lane in lanes.where(int(LaneType.DRIVING)):
        by_road.setdefault(int(lanes.road_id[lane]), []).append(int(lane))
    paint = _painted_lines(network, shapes)
    governing = np.full(len(lanes), -1, np.int32)
    lights = []
    for index, (signal, road, places) in enumerate(_places(network)):
        approach: dict[int, float] = {}  # lane -> distance of the reference beyond its end
        governed: list[int] = []
        for place in places:
            for lane in by_road.get(place.road.id, ()):
                if not any(a <= lanes.lane_id[lane] <= b for a, b in place.ranges):
                    continue
                low, high = sorted((lanes.s_start[lane], lanes.s_end[lane]))
                if not low - 1e-6 <= place.s <= high + 1e-6:
                    continue
                if lanes.junction[lane] >= 0:
                    beyond = lanes.u_of_s(lane, place.s)
                    governed.append(lane)
                    leading = [int(p) for p in lanes.predecessors(lane) if lanes.junction[p] < 0]
                else:  # a reference before the junction: it counts for all ways in
                    beyond = lanes.u_of_s(lane, place.s) - float(lanes.length[lane])
                    leading = [lane]
                    governed += [int(n) for n in lanes.successors(lane) if lanes.junction[n] >= 0]
                for before in leading:
                    approach[before] = min(beyond, approach.get(before, np.inf))
        governed = list(dict.fromkeys(governed))
        for lane in governed:
            if governing[lane] < 0:
                governing[lane] = index
        lights.append(_light(index, signal, shapes[road.id], lanes, governed, approach, paint))
    return tuple(lights), governing


def _light(
    index: int,
    signal: SignalRecord,
    shape: RoadShape,
    lanes: LaneTable,
    governed: list[int],
    approach: dict[int, float],
    paint: NDArray[np.float64],
) -> TrafficLight:
    x, y, z, yaw = shape.place(signal.s, signal.t)
    yaw -= signal.h_offset
    x, y = x + LANDMARK_SHIFT * float(np.cos(yaw)), y + LANDMARK_SHIFT * float(np.sin(yaw))
    centres, stops = [], []
    for lane, beyond in approach.items():
        length = float(lanes.length[lane])
        u = min(max(length - max(TRIGGER_SETBACK - beyond, 0.0), 0.0), length)
        centres.append((lane, u))
        last = u + STOP_STEP * np.floor((length - u) / STOP_STEP + 1e-9)
        stops.append(_stop_line(lanes, lane, float(last), paint))
    trigger = (x, y, yaw, TRIGGER_HALF_LENGTH, 1.0)
    if centres:
        poses = np.array([point_on(lanes, lane, u) for lane, u in centres])
        along = np.arctan2(np.sin(poses[:, 3]).mean(), np.cos(poses[:, 3]).mean())
        # Lanes of one approach lie side by side; a second approach must not pull the box into the junction.
        beside = poses[np.cos(poses[:, 3] - poses[0, 3]) > 0.5]
        middle = beside[:, :2].mean(axis=0)
        across = (beside[:, :2] - middle) @ np.array([-np.sin(beside[0, 3]), np.cos(beside[0, 3])])
        half = float(np.ptp(across)) / 2.0 + TRIGGER_WIDTH_SHARE * stops[0].width
        trigger = (float(middle[0]), float(middle[1]), float(beside[0, 3]), TRIGGER_HALF_LENGTH, half)
        yaw = float(along)
    return TrafficLight(
        index=index,
        signal_id=signal.id,
        x=float(x),
        y=float(y),
        z=z + signal.z_offset,
        yaw=float((yaw + np.pi + np.pi) % (2.0 * np.pi) - np.pi),
        junction=int(lanes.junction[governed[0]]) if governed else -1,
        trigger=trigger,
        lanes=tuple(governed),
        approach=tuple(approach),
        stop_lines=tuple(stops),
    )


def point_on(lanes: LaneTable, lane: int, u: float) -> NDArray[np.float64]:
    """x, y, z, yaw, curvature of `lane` at `u`, linear between centre points."""
    points = lanes.centre_line(lane)
    position = min(max(u / float(lanes.step[lane]), 0.0), len(points) - 1.0)
    row = min(int(position), len(points) - 2)
    return points[row] + (position - row) * (points[row + 1] - points[row])


def _stop_line(lanes: LaneTable, lane: int, u: float, paint: NDArray[np.float64]) -> StopLine:
    x, y, _, yaw, _ = point_on(lanes, lane, u)
    rows = lanes.rows(lane)
    width = float(np.interp(u, np.arange(rows.stop - rows.start) * lanes.step[lane], lanes.width[rows]))
    painted = u
    if len(paint):
        points = lanes.centre_line(lane)[:, :2]
        near = int(np.ceil(PAINT_RANGE / float(lanes.step[lane]))) + 1
        tail = points[-near:]
        distance = np.hypot(paint[:, None, 0] - tail[None, :, 0], paint[:, None, 1] - tail[None, :, 1])
        line, point = np.unravel_index(int(np.argmin(distance)), distance.shape)
        if distance[line, point] < max(paint[line, 2] / 2.0, width / 2.0):
            painted = float((len(points) - len(tail) + int(point)) * lanes.step[lane])
    return StopLine(
        lane,
        int(lanes.road_id[lane]),
        int(lanes.lane_id[lane]),
        u,
        float(x),
        float(y),
        float(yaw),
        width,
        min(painted, u),
    )


def is_stop_line(thing: ObjectRecord) -> bool:
    """Whether an object is a painted stop line."""
    return thing.name in STOP_LINE_NAMES


def outline_in_world(thing: ObjectRecord, shape: RoadShape) -> NDArray[np.float64]:
    """Corners `(M, 2)` of an object's outline, or of its length x width box [m]."""
    corners: Sequence[Sequence[float]] = thing.outline
    if not corners:
        a, b = thing.length / 2.0, thing.width / 2.0
        corners = [(a, b), (a, -b), (-a, -b), (-a, b)]
    local = np.array([corner[:2] for corner in corners])
    x, y, _, yaw = shape.place(thing.s, thing.t)
    heading = -yaw + thing.heading  # OpenDRIVE's sense
    u, v = local[:, 0], local[:, 1]
    return np.stack(
        [x + u * np.cos(heading) - v * np.sin(heading), y - (u * np.sin(heading) + v * np.cos(heading))], axis=1
    )


def _painted_lines(network: Network, shapes: dict[int, RoadShape]) -> NDArray[np.float64]:
    """Centres and lengths `(K, 3)` of painted stop lines."""
    rows = []
    for road in network.roads:
        for thing in road.objects:
            if is_stop_line(thing):
                corners = outline_in_world(thing, shapes[road.id])
                extent = float(np.hypot(*(corners.max(axis=0) - corners.min(axis=0))))
                rows.append((*corners.mean(axis=0), extent))
    return np.array(rows).reshape(-1, 3)


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
