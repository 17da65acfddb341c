"""Where vehicles appear when traffic follows the ego, as in leaderboard 2.x (reference `leaderboard.md` 6.4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.types import LaneType

LOOK_EVERY = 10  # ticks between two looks at who is missing
LEADING_DISTANCE = 10.0  # [m]
LEFT_BEHIND = 100.0  # [m] from the ego: farther vehicles are taken out
_ROAD_SPACING, _ROAD_CARS = 15.0, 2  # [m]; ahead and behind on each lane of the ego's direction
_OPPOSITE_SPACING, _OPPOSITE_RANGE = 40.0, 80.0  # [m]
_JUNCTION_RANGE, _JUNCTION_SPACING, _JUNCTION_CARS = 40.0, 15.0, 6
_ACTIVE = 0.8  # share of the entries of a junction from which somebody comes
_BUMPER = 6.0  # [m] from the end of an entry to the first car's centre

Place = tuple[int, float]


def places_around(town: TownMap, draws: Draws, lane: int, u: float) -> list[Place]:
    """Lane and travelled length [m] of the places where a vehicle belongs when the ego is on `lane` at `u`."""
    places = _on_the_road(town, lane, u) + _on_the_other_side(town, lane, u)
    return places + _at_the_junction(town, draws, lane, u)


def _walk(town: TownMap, lane: int, u: float, distance: float) -> Place | None:
    """The place `distance` metres on (negative: back) along the lanes, straight on where they fork."""
    lanes = town.lanes
    u += distance
    for _ in range(20):
        if 0.0 <= u <= lanes.length[lane]:
            return lane, float(u)
        following = lanes.successors(lane) if u > 0.0 else lanes.predecessors(lane)
        if not len(following):
            return None
        bend = [abs(float(lanes.centre_line(k)[-1, 3] - lanes.centre_line(k)[0, 3])) for k in following.tolist()]
        if u > 0.0:
            u -= float(lanes.length[lane])
            lane = int(following[int(np.argmin(bend))])
        else:
            lane = int(following[int(np.argmin(bend))])
            u += float(lanes.length[lane])
    return None


def _on_the_road(town: TownMap, lane: int, u: float) -> list[Place]:
    beside = [lane]
    for neighbours in (town.lanes.left, town.lanes.right):
        other = int(neighbours[lane])
        while other >= 0 and other not in beside:
            beside.append(other)
            other = int(neighbours[other])
    steps = [sign * _ROAD_SPACING * k for k in range(1, _ROAD_CARS + 1) for sign in (1.0, -1.0)]
    found = [_walk(town, k, u * _scale(town, lane, k), step) for k in beside for step in steps]
    return [place for place in found if place is not None and town.lanes.junction[place[0]] < 0]


def _on_the_other_side(town: TownMap, lane: int, u: float) -> list[Place]:
    lanes = town.lanes
    same_road = (lanes.road_id == lanes.road_id[lane]) & (lanes.section == lanes.section[lane])
    against = same_road & (np.sign(lanes.lane_id) != np.sign(lanes.lane_id[lane])) & (lanes.type == LaneType.DRIVING)
    places = []
    for other in np.flatnonzero(against & (lanes.junction < 0)).tolist():
        here = float(lanes.length[other]) - u * _scale(town, lane, other)
        for k in range(1, int(_OPPOSITE_RANGE / _OPPOSITE_SPACING) + 1):
            place = _walk(town, other, here, -k * _OPPOSITE_SPACING)
            if place is not None and lanes.junction[place[0]] < 0:
                places.append(place)
    return places


def _at_the_junction(town: TownMap, draws: Draws, lane: int, u: float) -> list[Place]:
    lanes = town.lanes
    ahead = float(lanes.length[lane]) - u
    following = lanes.successors(lane)
    if ahead > _JUNCTION_RANGE or not len(following) or lanes.junction[following[0]] < 0:
        return []
    inside = np.flatnonzero((lanes.junction == lanes.junction[following[0]]) & (lanes.type == LaneType.DRIVING))
    entries = sorted({int(p) for k in inside.tolist() for p in lanes.predecessors(k) if lanes.junction[p] < 0} - {lane})
    places = []
    for entry in entries:
        if draws.stream("entry", entry).uniform(0, 1)[0] < _ACTIVE:
            ends = float(lanes.length[entry]) - _BUMPER - _JUNCTION_SPACING * np.arange(_JUNCTION_CARS)
            places += [(entry, float(end)) for end in ends if end > _BUMPER]
    return places


def _scale(town: TownMap, lane: int, other: int) -> float:
    return float(town.lanes.length[other] / town.lanes.length[lane])


def left_behind(xy: NDArray[np.float64], ego: NDArray[np.float64], yaw: float) -> NDArray[np.bool_]:
    """Which of the points `(N, 2)` are so far from the ego, or behind it, that nobody is missed there."""
    dx, dy = xy[:, 0] - ego[0], xy[:, 1] - ego[1]
    distance = np.sqrt(dx * dx + dy * dy)
    behind = dx * float(np.cos(yaw)) + dy * float(np.sin(yaw)) < 0.0
    return np.asarray((distance > LEFT_BEHIND + 50.0) | (behind & (distance > LEFT_BEHIND)))
