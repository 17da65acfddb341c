"""Who goes first at a junction, and whether somebody else still fits in before or behind.

Whoever is inside, or can't stop any more, goes first. With lights a left turn waits for oncoming traffic. Without, who
has no stop or yield sign goes before who has one; on a main road a left turn waits for oncoming traffic; else the
nearest goes first, ties by row. Others may still pass where the times at which the two are at the same place lie far
enough apart.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.drivers import ACCELERATION, CORNERING, GAP, SPEED_FACTOR
from lavsim.traffic.fleet import NOBODY, PATH_LANES, Fleet
from lavsim.traffic.guests import Guests
from lavsim.traffic.near import Near, exit_of
from lavsim.traffic.network import MAJOR, Lanes
from lavsim.traffic.obstacles import Boxes
from lavsim.types import LightState, RoadOption, VehicleLight

_RED, _LEFT = int(LightState.RED), int(RoadOption.LEFT)
_ON_CALL = int(VehicleLight.SPECIAL1)
CLEARANCE = 0.5  # [m] kept between two that cross
_PATIENCE = 80  # ticks after which nobody waits any longer for a guest that stands
_THEIR_ACCELERATION = 1.5  # [m/s²] expected of others
_GUEST_BRAKE = 4.0  # [m/s²] a guest that would need more to stop will not stop
_ROOM = 2.0  # [m] left free before and behind a vehicle that has crossed
_IMPATIENT = 600.0  # ticks at rest in which a driver comes down to
_LEAST_GAP = 0.4  # of the gap that it wants
_SLOW_CORNERING = 0.6  # of the ordinary lateral acceleration, of a careful driver
_BEHIND = 0.8  # [s] after somebody has left a place


@kernel
def travel_time(distance: float, speed: float, acceleration: float, top: float) -> float:
    """Time for `distance` from `speed`, accelerating up to `top` [s]; 0 for what lies behind."""
    if distance <= 0.0:
        return 0.0
    top = max(top, speed, 0.5)
    ramp = (top * top - speed * speed) / (2.0 * acceleration)
    if distance <= ramp:
        return (math.sqrt(speed * speed + 2.0 * acceleration * distance) - speed) / acceleration
    return (top - speed) / acceleration + (distance - ramp) / top


@kernel
def has_room(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, i: int, target: int) -> bool:
    """Whether vehicle `i` finds room behind junction lane `target`, beside those already in the junction."""
    k = 0
    while k < PATH_LANES and fleet.path[i, k] != target:
        k += 1
    exit_lane = exit_of(lanes, fleet, i, k)
    if exit_lane < 0 or math.isinf(near.tail[exit_lane]):
        return True
    room = min(near.tail[exit_lane], lanes.length[exit_lane]) - near.claimed[exit_lane]
    return room >= 2.0 * boxes.half[fleet.row[i], 0] + _ROOM


@kernel
def whom_to_wait_for(
    lanes: Lanes,
    fleet: Fleet,
    guests: Guests,
    boxes: Boxes,
    near: Near,
    lights: NDArray[np.uint8],
    vehicle_lights: NDArray[np.int32],
    i: int,
    target: int,
    distance: float,
    tick: int,
) -> int:
    """Row of somebody whom vehicle `i` has to let pass before it enters junction lane `target`; `NOBODY` if it may go.

    Args:
        lanes: The road network.
        fleet: All drivers.
        guests: Vehicles that are not the fleet's.
        boxes: All boxes.
        near: This tick's approaches.
        lights: (L,) `LightState`.
        vehicle_lights: (N,) `VehicleLight`.
        i: The vehicle.
        target: The junction lane.
        distance: From its front to that lane [m].
        tick: Now.
    """
    row = fleet.row[i]
    for e in range(lanes.conflict_first[target], lanes.conflict_first[target + 1]):
        k = near.first[lanes.conflict[e]]
        while k >= 0:
            if near.who[k] != row:
                inside = near.distance[k] < 0.0
                if (
                    inside
                    or _is_bound(lanes, fleet, boxes, near, lights, k)
                    or (
                        fleet.granted[i] < tick
                        and _goes_first(
                            lanes, fleet, guests, boxes, near, lights, vehicle_lights, k, row, target, distance
                        )
                    )
                ) and _is_in_time_with(lanes, fleet, boxes, near, i, target, distance, e, k):
                    return int(near.who[k])
            k = near.follow[k]
    return NOBODY


@kernel
def _is_bound(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, lights: NDArray[np.uint8], k: int) -> bool:
    """Whether approach `k` will enter, whatever others do."""
    lane, slot = near.target[k], near.slot[k]
    if slot >= 0:
        return bool(fleet.committed[slot] == lane)
    speed = max(boxes.forward[near.who[k]], 0.0)
    return speed > 2.0 and speed * speed > 2.0 * _GUEST_BRAKE * near.distance[k]


@kernel
def _goes_first(
    lanes: Lanes,
    fleet: Fleet,
    guests: Guests,
    boxes: Boxes,
    near: Near,
    lights: NDArray[np.uint8],
    vehicle_lights: NDArray[np.int32],
    k: int,
    row: int,
    target: int,
    distance: float,
) -> bool:
    """Whether approach `k` goes before the vehicle in `row` that is `distance` away from junction lane `target`."""
    lane, other = near.target[k], near.who[k]
    if vehicle_lights[other] & _ON_CALL and boxes.forward[other] > 1.0:
        return True
    if lanes.light[lane] >= 0 and lights[lanes.light[lane]] == _RED:
        return False
    turns_across = lanes.turn[target] == _LEFT and lanes.turn[lane] != _LEFT
    if lanes.light[target] >= 0:
        return turns_across and _is_ready(lanes, fleet, guests, boxes, near, k)
    if not _is_ready(lanes, fleet, guests, boxes, near, k):
        return False
    theirs, mine = lanes.rank[lane], lanes.rank[target]
    if (theirs == MAJOR) != (mine == MAJOR):
        return bool(theirs == MAJOR)
    if mine == MAJOR and lanes.has_minor[target]:
        if turns_across:
            return True
        if lanes.turn[lane] == _LEFT and lanes.turn[target] != _LEFT:
            return False
    return (near.distance[k], other) < (distance, row)


@kernel
def _is_ready(lanes: Lanes, fleet: Fleet, guests: Guests, boxes: Boxes, near: Near, k: int) -> bool:
    """Whether approach `k` could go: who can't leave its junction lane again, or stands there for no reason, can't."""
    slot = near.slot[k]
    if slot >= 0:
        return has_room(lanes, fleet, boxes, near, slot, near.target[k])
    return bool(guests.still[-1 - slot] < _PATIENCE)


@kernel
def _is_in_time_with(
    lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, i: int, target: int, distance: float, e: int, k: int
) -> bool:
    """Whether vehicle `i` would come too close to approach `k` where conflict `e` of its lane `target` lies."""
    row, other, lane = fleet.row[i], near.who[k], near.target[k]
    their_length = 2.0 * boxes.half[other, 0]
    their_speed = max(boxes.forward[other], 0.0)
    out = near.distance[k] + lanes.conflict_back[e, 1] + their_length + CLEARANCE
    if out <= 0.0:
        return False
    speed = max(boxes.forward[row], 0.0)
    top = max(lanes.speed_limit[target] * fleet.driver[i, SPEED_FACTOR], speed)
    top = min(top, max(math.sqrt(lanes.bend[lanes.first[target]] * fleet.driver[i, CORNERING]), speed))
    their_top = max(lanes.speed_limit[lane], their_speed)
    slowest = math.sqrt(_SLOW_CORNERING * lanes.bend[lanes.first[lane]])  # in their turn
    push = 0.8 * fleet.driver[i, ACCELERATION]
    patience = fleet.driver[i, GAP] * max(1.0 - fleet.still[i] / _IMPATIENT, _LEAST_GAP)
    if lanes.merges[e]:
        mine = travel_time(distance + lanes.length[target], speed, push, top)
        theirs = travel_time(near.distance[k] + lanes.length[lane], their_speed, _THEIR_ACCELERATION, their_top)
        if mine + 1.0 + patience + max(0.0, min(their_speed, their_top) - top) / 2.0 < theirs:
            return False
        is_ahead = near.distance[k] < 0.0 and their_speed > 2.0
        return not (is_ahead and (near.distance[k] + lanes.length[lane]) / their_speed + 1.0 < mine)
    end = distance + lanes.conflict_u[e, 1] + 2.0 * boxes.half[row, 0] + CLEARANCE
    begin = near.distance[k] + lanes.conflict_back[e, 0] - CLEARANCE
    if begin > 0.0:
        theirs = travel_time(begin, their_speed, _THEIR_ACCELERATION, their_top)
        if travel_time(end, speed, push, top) + patience < theirs:
            return False
    if their_speed < 1.0:
        return True
    mine = travel_time(distance + lanes.conflict_u[e, 0] - CLEARANCE, speed, push, top)
    return not (out / min(their_speed, slowest) + _BEHIND < mine)
