"""Where to stop before a junction: lights, stop signs, others who go first, no room behind."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.fleet import NOBODY, PATH_LANES, RED_LIGHT, Fleet
from lavsim.traffic.guests import Guests
from lavsim.traffic.near import Near, exit_of, view_before_junction
from lavsim.traffic.network import STOPS, Lanes
from lavsim.traffic.obstacles import Boxes
from lavsim.traffic.right_of_way import has_room, whom_to_wait_for
from lavsim.types import LightState

LINE_GAP = 1.0  # [m] between the bumper and a stop line
_EDGE_GAP = 2.5  # [m] the same where the line lies at the junction's edge, so that who turns has room
_OVER_THE_LINE = 0.3  # [m] who has its bumper that far over the line stops at the junction's edge, or goes on
_LIGHT_RANGE = 80.0  # [m] at which a light is seen
_YELLOW_BRAKE = 3.5  # [m/s²] a driver stops at yellow if that much suffices

_RED, _YELLOW, _GREEN = int(LightState.RED), int(LightState.YELLOW), int(LightState.GREEN)


@kernel
def line_ahead(
    lanes: Lanes,
    fleet: Fleet,
    guests: Guests,
    boxes: Boxes,
    near: Near,
    lights: NDArray[np.uint8],
    vehicle_lights: NDArray[np.int32],
    i: int,
    speed: float,
    holds: bool,
    tick: int,
) -> tuple[float, int]:
    """Distance from the front of vehicle `i` to the line it has to stop at [m], and who is to blame; inf if it may go.

    Args:
        lanes: The road network.
        fleet: All drivers; what `i` decides is noted.
        guests: Vehicles that are not the fleet's.
        boxes: All boxes.
        near: This tick's approaches.
        lights: (L,) `LightState`.
        vehicle_lights: (N,) `VehicleLight`.
        i: The vehicle.
        speed: Its own [m/s].
        holds: It stays out of junctions, whoever has right of way (somebody on call is coming).
        tick: Now.
    """
    half = boxes.half[fleet.row[i], 0]
    last = fleet.lane[i]
    inside = lanes.junction[last]
    ahead = lanes.length[last] - fleet.u[i] - half
    target, at = -1, 0
    for k in range(PATH_LANES):
        if ahead > _LIGHT_RANGE:
            return np.inf, NOBODY
        lane = fleet.path[i, k]
        if lane < 0:
            return max(ahead, 0.0), NOBODY  # the road ends
        if lanes.junction[lane] >= 0 and lanes.junction[lane] != inside:
            target, at = lane, k
            break
        if lanes.junction[lane] < 0:
            inside = -1
        ahead += lanes.length[lane]
        last = lane
    if target < 0:
        return np.inf, NOBODY
    light = lanes.light[target]
    state = _GREEN if light < 0 else int(lights[light])
    gap = ahead - lanes.setback[last] - (LINE_GAP if lanes.setback[last] > LINE_GAP else _EDGE_GAP)
    if ahead - lanes.setback[last] < -_OVER_THE_LINE:
        gap = ahead - _OVER_THE_LINE
        if gap < 0.0 or (state == _RED and speed * speed > 2.0 * _YELLOW_BRAKE * gap):
            return np.inf, NOBODY
    if state == _RED or (state == _YELLOW and gap > 0.0 and speed * speed < 2.0 * _YELLOW_BRAKE * gap):
        fleet.committed[i] = -1
        return max(gap, 0.0), RED_LIGHT
    if fleet.committed[i] == target or ahead > view_before_junction(speed):
        return np.inf, NOBODY
    if light < 0 and lanes.rank[target] == STOPS and fleet.halted[i] != target:
        if speed < 0.1 and gap < 1.0:
            fleet.halted[i] = target
        return max(gap, 0.0), NOBODY
    if holds:
        return max(gap, 0.0), NOBODY
    if _is_caught_behind(lanes, fleet, boxes, lights, i, at):
        return max(gap, 0.0), RED_LIGHT
    if not has_room(lanes, fleet, boxes, near, i, target):
        return max(gap, 0.0), int(near.tail_row[exit_of(lanes, fleet, i, at)])
    who = whom_to_wait_for(lanes, fleet, guests, boxes, near, lights, vehicle_lights, i, target, ahead, tick)
    if who != NOBODY:
        return max(gap, 0.0), who
    if gap < max(2.0, 0.5 * speed * speed / _YELLOW_BRAKE):
        fleet.committed[i] = target  # too late to stop comfortably: goes
    return np.inf, NOBODY


@kernel
def _is_caught_behind(lanes: Lanes, fleet: Fleet, boxes: Boxes, lights: NDArray[np.uint8], i: int, at: int) -> bool:
    """Whether vehicle `i` would have to stop inside the junction at position `at` of its path.

    That is so where the link to the next junction is shorter than the vehicle and the light there is not green.
    """
    room = 0.0
    inside = lanes.junction[fleet.path[i, at]]
    for k in range(at + 1, PATH_LANES):
        lane = fleet.path[i, k]
        if lane < 0 or room > 2.0 * boxes.half[fleet.row[i], 0] + LINE_GAP:
            return False
        if lanes.junction[lane] < 0:
            inside = -1
            room += lanes.length[lane]
        elif lanes.junction[lane] != inside:
            return bool(lanes.light[lane] >= 0 and lights[lanes.light[lane]] != _GREEN)
    return False


@kernel
def is_near_junction(lanes: Lanes, fleet: Fleet, i: int, distance: float) -> bool:
    """Whether vehicle `i` is in a junction or comes to one within `distance` of its centre."""
    lane = fleet.lane[i]
    if lanes.junction[lane] >= 0:
        return True
    ahead = lanes.length[lane] - fleet.u[i]
    for k in range(PATH_LANES):
        if ahead > distance:
            return False
        lane = fleet.path[i, k]
        if lane < 0 or lanes.junction[lane] >= 0:
            return True
        ahead += lanes.length[lane]
    return not math.isinf(ahead) and ahead <= distance
