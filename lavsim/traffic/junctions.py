"""Where to stop before a junction: lights, stop signs, others who go first, no room behind."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.fleet import NOBODY, PATH_LANES, RED_LIGHT, Fleet
from lavsim.traffic.guests import Guests
from lavsim.traffic.near import Near, view_before_junction
from lavsim.traffic.network import STOPS, Lanes
from lavsim.traffic.obstacles import Boxes
from lavsim.traffic.right_of_way import has_room, whom_to_wait_for
from lavsim.types import LightState

LINE_GAP = 1.0  # [m] between the bumper and a stop line
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
    if lanes.junction[last] >= 0:
        return np.inf, NOBODY
    ahead = lanes.length[last] - fleet.u[i] - half
    target = -1
    for k in range(PATH_LANES):
        if ahead > _LIGHT_RANGE:
            return np.inf, NOBODY
        lane = fleet.path[i, k]
        if lane < 0:
            return ahead, NOBODY  # the road ends
        if lanes.junction[lane] >= 0:
            target = lane
            break
        ahead += lanes.length[lane]
        last = lane
    if target < 0:
        return np.inf, NOBODY
    light = lanes.light[target]
    state = _GREEN if light < 0 else int(lights[light])
    if fleet.committed[i] == target and (state != _RED or ahead < 0.0):
        return np.inf, NOBODY
    gap = ahead - lanes.setback[last] - LINE_GAP
    if state == _RED or (state == _YELLOW and gap > 0.0 and speed * speed < 2.0 * _YELLOW_BRAKE * gap):
        fleet.committed[i] = -1
        return max(gap, 0.0), RED_LIGHT
    if ahead > view_before_junction(speed):
        return np.inf, NOBODY
    if light < 0 and lanes.rank[target] == STOPS and fleet.halted[i] != target:
        if speed < 0.1 and gap < 1.0:
            fleet.halted[i] = target
        return max(gap, 0.0), NOBODY
    if holds or not has_room(lanes, fleet, boxes, near, i, target):
        return max(gap, 0.0), NOBODY
    who = whom_to_wait_for(lanes, fleet, guests, boxes, near, lights, vehicle_lights, i, target, ahead, tick)
    if who != NOBODY:
        return max(gap, 0.0), who
    if gap < max(2.0, 0.5 * speed * speed / _YELLOW_BRAKE):
        fleet.committed[i] = target  # too late to stop comfortably: goes
    return np.inf, NOBODY


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
