"""Landmarks as CARLA names them: one for each place where a signal or a speed sign counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lavsim.map.records import ObjectRecord, RoadRecord, SignalRecord, SignalReference, Validity
from lavsim.map.signal import LANDMARK_SHIFT, LIGHT_TYPES, SPEED_TYPE, object_side, speed_of
from lavsim.types import LaneType

if TYPE_CHECKING:
    from lavsim.map.section import RoadShape
    from lavsim.map.town_map import TownMap
    from lavsim.map.waypoint import Waypoint

ORIENTATIONS = {"+": "Positive", "-": "Negative"}
MOST_STEPS = 10_000  # lanes looked at in one search
CLEARANCE = 0.7  # lane widths that a signal keeps from a lane's centre
SHIFT = 0.2  # lane widths by which it is moved at a time
MOST_SHIFTS = 10


@dataclass(frozen=True)
class Landmark:
    """A place on a road where a signal counts. Names and values are those of CARLA's `Landmark`.

    Attributes:
        id: Of the signal, as text.
        type, sub_type: As the file says: "1000001" light, "206" stop, "205" yield, "274" speed.
        value, unit: As the file says; of speed objects the number in their name, and "mph" (CARLA; it means km/h).
        is_dynamic: Whether it changes.
        orientation: "Positive", "Negative" or "Both".
        road_id, s, t: Where it counts, in the file's coordinates [m].
        z_offset, h_offset: Of the signal [m, rad].
        x, y, z, yaw: Where the signal stands and looks to [m, rad]; moved aside from lanes, as CARLA does.
        validities: Lane id ranges for which it counts.
        pitch, roll: Of the signal [rad].
        distance: Along the lanes from where the search began [m]; 0 in `TownMap.landmarks`.
        waypoint: Of the search, on the lane for which it counts; None in `TownMap.landmarks`.
    """

    id: str
    type: str
    sub_type: str
    name: str
    text: str
    value: float
    unit: str
    country: str
    is_dynamic: bool
    orientation: str
    road_id: int
    s: float
    t: float
    z_offset: float
    h_offset: float
    width: float
    height: float
    x: float
    y: float
    z: float
    yaw: float
    validities: Validity
    pitch: float = 0.0
    roll: float = 0.0
    distance: float = 0.0
    waypoint: Waypoint | None = field(default=None, compare=False, repr=False)


def build_landmarks(town: TownMap) -> tuple[Landmark, ...]:
    """All landmarks, in file order of the places where they count."""
    network, shapes = town.network, town.shapes
    moved: dict[tuple[float, float, float, float], tuple[float, float, float, float]] = {}
    signals = {signal.id: (signal, road) for road in network.roads for signal in road.signals}
    referred = {reference.id for road in network.roads for reference in road.references}
    found: list[Landmark] = []

    def add(thing: SignalRecord | ObjectRecord, stands: RoadRecord, counts: RoadRecord, place: SignalReference) -> None:
        ranges = _ranges(place.validity, place.orientation, counts, place.s)
        if ranges is not None:
            landmark = _landmark(thing, shapes[stands.id], counts, place, ranges)
            pose = (landmark.x, landmark.y, landmark.z, landmark.yaw)
            if pose not in moved:
                moved[pose] = _out_of_the_way(town, pose)
            x, y, z, yaw = moved[pose]
            found.append(replace(landmark, x=x, y=y, z=z, yaw=yaw))

    for road in network.roads:
        for reference in road.references:
            if reference.id in signals:
                add(*signals[reference.id], road, reference)
        for signal in road.signals:
            if signal.id not in referred:
                place = SignalReference(signal.id, signal.s, signal.t, signal.orientation, signal.validity)
                add(signal, road, road, place)
        for thing in road.objects:
            if speed_of(thing) is not None:
                add(thing, road, road, SignalReference(thing.id, thing.s, thing.t, object_side(thing)))
    return tuple(found)


def _out_of_the_way(town: TownMap, pose: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Where CARLA puts a signal that stands on or close to a lane: in steps to the side, turned along the lane.

    Source: LibCarla `MapBuilder::CheckSignalsOnRoads` (0.9.16).
    """
    x, y, z, yaw = pose
    for step in range(MOST_SHIFTS + 1):
        lane = town.carla_waypoint((x, y, z), types=LaneType.DRIVING | LaneType.SHOULDER)
        if lane is None or np.hypot(np.hypot(lane.x - x, lane.y - y), lane.z - z) >= CLEARANCE * lane.width:
            return x, y, z, yaw
        if step == MOST_SHIFTS:
            break
        is_open = [
            beside is not None and beside.lane_type == LaneType.DRIVING for beside in (lane.right(), lane.left())
        ]
        yaw = lane.yaw
        if all(is_open):
            return x, y, z, yaw
        aside = SHIFT * lane.width * (-1.0 if is_open[0] else 1.0)
        x, y = x - aside * float(np.sin(yaw)), y + aside * float(np.cos(yaw))
    return pose


def _ranges(validity: Validity, orientation: str, road: RoadRecord, s: float) -> Validity | None:
    """Lane id ranges at `s`; without records the side that the orientation names. None for no lane, by record."""
    if validity:
        return tuple((min(a, b), max(a, b)) for a, b in validity if (a, b) != (0, 0)) or None
    section = next((k for k in reversed(road.sections) if k.s <= s + 1e-9), road.sections[0])
    ids = [lane.id for lane in section.lanes]
    sides = ((1, max(ids)), (min(ids), -1))
    wanted = sides[:1] if orientation == "+" else sides[1:] if orientation == "-" else sides
    return tuple((a, b) for a, b in wanted if a <= b)


def _landmark(
    thing: SignalRecord | ObjectRecord, shape: RoadShape, counts: RoadRecord, place: SignalReference, ranges: Validity
) -> Landmark:
    x, y, z, yaw = (float(v) for v in shape.place(thing.s, thing.t))
    orientation = ORIENTATIONS.get(place.orientation, "Both")
    if isinstance(thing, ObjectRecord):
        limit = (speed_of(thing) or 0.0) * 3.6
        number = f"{limit:g}"
        return Landmark(
            str(thing.id), SPEED_TYPE, number, thing.name, number, round(limit, 6), "mph", "", False, orientation,
            counts.id, place.s, place.t, thing.z_offset, thing.heading, thing.width, thing.height,
            x, y, z + thing.z_offset, yaw - thing.heading, ranges,
        )  # fmt: skip
    yaw -= thing.h_offset
    if thing.kind in LIGHT_TYPES:
        ahead = LANDMARK_SHIFT * float(np.cos(thing.pitch))
        x, y = x + ahead * float(np.cos(yaw)), y + ahead * float(np.sin(yaw))
        z += LANDMARK_SHIFT * float(np.sin(thing.pitch))
    return Landmark(
        str(thing.id), thing.kind, thing.subtype, thing.name, thing.text, thing.value, thing.unit, thing.country,
        thing.dynamic, orientation, counts.id, place.s, place.t, thing.z_offset, thing.h_offset, thing.width,
        thing.height, x, y, z + thing.z_offset, yaw, ranges, thing.pitch, thing.roll,
    )  # fmt: skip


def landmarks_ahead(town: TownMap, start: Waypoint, distance: float, stop_at_junction: bool) -> list[Landmark]:
    """Landmarks within `distance` of s ahead on all branches, each once; see `Waypoint.landmarks`."""
    lanes = town.lanes
    found: dict[int, Landmark] = {}
    ways: list[tuple[int, float, float]] = [(start.lane, start.s, 0.0)]
    steps = 0
    while ways and steps < MOST_STEPS:
        steps += 1
        lane, s, before = ways.pop()
        border = float(lanes.s_end[lane])
        ahead = abs(border - s)
        reach = min(distance - before, ahead)
        sign = 1.0 if lanes.runs_forward(lane) else -1.0
        lane_id = int(lanes.lane_id[lane])
        for number, landmark in town.landmarks_of(int(lanes.road_id[lane])):
            along = sign * (landmark.s - s)
            counts = any(a <= lane_id <= b for a, b in landmark.validities)
            if counts and -1e-9 <= along <= reach + 1e-9 and number not in found:
                where = town.waypoint_at(lane, lanes.u_of_s(lane, landmark.s))
                found[number] = replace(landmark, distance=before + along, waypoint=where)
        if distance - before <= ahead:
            continue
        for following in reversed(_followers(town, lane, stop_at_junction)):
            ways.append((following, float(lanes.s_start[following]), before + ahead))
    return list(found.values())


def _followers(town: TownMap, lane: int, stop_at_junction: bool) -> Sequence[int]:
    following = [int(k) for k in town.lanes.successors(lane)]
    return [k for k in following if not (stop_at_junction and town.lanes.junction[k] >= 0)]
