"""Lane changes: because the lane ends, or because another is better and not too bad for who follows there.

The choice is MOBIL (Kesting, Treiber & Helbing 2007, Transportation Research Record 1999, 86).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.drivers import MIN_GAP, POLITENESS, SPEED_FACTOR
from lavsim.traffic.fleet import FROM, HOLD, LEAD_IN, PATH_LANES, Fleet, reset_plan, turn_into
from lavsim.traffic.following import idm_acceleration
from lavsim.traffic.junctions import is_near_junction
from lavsim.traffic.near import Near, enter_order
from lavsim.traffic.network import Lanes, settle_beside
from lavsim.traffic.obstacles import Boxes

_TIME = 3.5  # [s] that a lane change takes
_SHORTEST, _SHORTEST_BLOCKED = 18.0, 9.0  # [m] that it takes at least; from close behind something that stands
_BEFORE_JUNCTION = 25.0  # [m] before which it must be over
_PAUSE = 200  # ticks between two
_LOOK_EVERY = 10  # ticks
_LANE_END = 150.0  # [m] before which a driver thinks of the end of its lane
_SAFE, _SAFE_AT_THE_END = 2.0, 4.0  # [m/s²] that a follower may be made to brake
_WORTH = 0.3  # [m/s²] that a change must be better
_KEEP_RIGHT = 0.25  # [m/s²] bonus for the right lane on fast roads
_FAST_ROAD = 16.0  # [m/s]
_GUEST_TIME = 1.0  # [s] to a follower that is no background driver


@kernel
def lane_ends_within(lanes: Lanes, fleet: Fleet, i: int, distance: float) -> bool:
    """Whether the way of vehicle `i` ends within `distance` of its centre."""
    ahead = lanes.length[fleet.lane[i]] - fleet.u[i]
    for k in range(PATH_LANES):
        if ahead > distance:
            return False
        lane = fleet.path[i, k]
        if lane < 0:
            return True
        ahead += lanes.length[lane]
    return False


@kernel
def consider_change(
    lanes: Lanes,
    fleet: Fleet,
    boxes: Boxes,
    near: Near,
    slots: NDArray[np.int32],
    i: int,
    allowed: float,
    acceleration: float,
    is_blocked: bool,
    must_go_right: bool,
    tick: int,
) -> None:
    """Lets vehicle `i` begin to change lanes if it wants to and may.

    Args:
        lanes: The road network.
        fleet: All drivers.
        boxes: All boxes.
        near: This tick's order along the lanes.
        slots: (N,) slot in the fleet of each row.
        i: The vehicle.
        allowed: Speed that bends and limits allow it [m/s].
        acceleration: What it does if it stays [m/s²].
        is_blocked: Something that will not move stands ahead.
        must_go_right: Somebody on call wants to pass.
        tick: Now.
    """
    lane = fleet.lane[i]
    if (tick + i) % _LOOK_EVERY != 0 or fleet.plan[i, LEAD_IN] > 0.0 or lanes.junction[lane] >= 0:
        return
    if lanes.left[lane] < 0 and lanes.right[lane] < 0:
        return
    speed = max(boxes.forward[fleet.row[i]], 0.0)
    length = max(_TIME * speed, _SHORTEST_BLOCKED if is_blocked else _SHORTEST)
    is_forced = lane_ends_within(lanes, fleet, i, _LANE_END)
    if not (is_forced or is_blocked) and (
        tick - fleet.changed[i] < _PAUSE or speed < 2.0 or is_near_junction(lanes, fleet, i, length + _BEFORE_JUNCTION)
    ):
        return
    if is_near_junction(lanes, fleet, i, length) and not is_forced:
        return
    safe = _SAFE_AT_THE_END if is_forced else _SAFE
    best, choice = _WORTH, -1
    for side in range(2):
        target = lanes.right[lane] if side == 0 else lanes.left[lane]
        if target < 0 or (must_go_right and side == 1):
            continue
        gain = _gain(lanes, fleet, boxes, near, slots, i, target, allowed, acceleration, safe)
        if gain <= -50.0:
            continue
        if is_forced or (must_go_right and side == 0):
            gain += 20.0
        elif lanes.speed_limit[lane] > _FAST_ROAD:
            gain += _KEEP_RIGHT if side == 0 else -_KEEP_RIGHT
        if gain > best:
            best, choice = gain, target
    if choice >= 0:
        _begin(lanes, fleet, boxes, near, i, choice, length, tick)


@kernel
def _begin(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, i: int, target: int, length: float, tick: int) -> None:
    row, lane = fleet.row[i], fleet.lane[i]
    u, offset, _yaw = settle_beside(lanes, lane, fleet.u[i], target, boxes.pose[row, 0], boxes.pose[row, 1])
    reset_plan(fleet, i)
    fleet.plan[i, FROM], fleet.plan[i, LEAD_IN], fleet.plan[i, HOLD] = offset, length, np.inf
    fleet.aside[i], fleet.changed[i] = lane, tick
    fleet.offset[i] = offset
    turn_into(lanes, fleet, i, target, max(u, 0.0))
    enter_order(near, len(fleet.row) + i, target, u, row)  # nobody else takes the gap in this tick


@kernel
def _gain(
    lanes: Lanes,
    fleet: Fleet,
    boxes: Boxes,
    near: Near,
    slots: NDArray[np.int32],
    i: int,
    target: int,
    allowed: float,
    acceleration: float,
    safe: float,
) -> float:
    """What a change to lane `target` is worth to vehicle `i` and its followers [m/s²]; -100 when it is not safe."""
    row = fleet.row[i]
    half, speed = boxes.half[row, 0], max(boxes.forward[row], 0.0)
    x, y = boxes.pose[row, 0], boxes.pose[row, 1]
    u, _offset, _yaw = settle_beside(lanes, fleet.lane[i], fleet.u[i], target, x, y)
    gap, pace = _front(lanes, boxes, near, target, u, half)
    back, follower = _rear(lanes, boxes, near, target, u, half)
    if gap < fleet.driver[i, MIN_GAP] or back < fleet.driver[i, MIN_GAP]:
        return -100.0
    after = idm_acceleration(speed, allowed, gap, speed - pace, fleet.driver[i])
    if after < -safe:
        return -100.0
    cost = 0.0
    if follower >= 0:
        theirs = max(boxes.forward[follower], 0.0)
        slot = slots[follower]
        if slot < 0 and back < _GUEST_TIME * theirs + 2.0 * max(theirs - speed, 0.0) + fleet.driver[i, MIN_GAP]:
            return -100.0
        driver = fleet.driver[slot] if slot >= 0 else fleet.driver[i]
        wanted = max(theirs, lanes.speed_limit[target] * driver[SPEED_FACTOR])
        with_me = idm_acceleration(theirs, wanted, back, theirs - speed, driver)
        if with_me < -safe:
            return -100.0
        without = idm_acceleration(theirs, wanted, back + 2.0 * half + gap, theirs - pace, driver)
        cost = with_me - without
    return after - acceleration + fleet.driver[i, POLITENESS] * cost


@kernel
def _front(lanes: Lanes, boxes: Boxes, near: Near, lane: int, u: float, half: float) -> tuple[float, float]:
    """Gap to who would be the leader on `lane` [m] and its speed [m/s]; inf for nobody."""
    entry = near.head[lane]
    while entry >= 0 and near.u[entry] < u:
        entry = near.after[entry]
    if entry >= 0:
        other = near.row[entry]
        return near.u[entry] - u - half - boxes.half[other, 0], max(boxes.forward[other], 0.0)
    gap, pace = np.inf, 0.0
    for s in range(lanes.succ_first[lane], lanes.succ_first[lane + 1]):
        entry = near.head[lanes.succ[s]]
        if entry >= 0:
            other = near.row[entry]
            room = lanes.length[lane] - u + near.u[entry] - half - boxes.half[other, 0]
            if room < gap:
                gap, pace = room, max(boxes.forward[other], 0.0)
    return gap, pace


@kernel
def _rear(lanes: Lanes, boxes: Boxes, near: Near, lane: int, u: float, half: float) -> tuple[float, int]:
    """Gap to who would be the follower on `lane` [m] and its row; (inf, -1) for nobody."""
    last = -1
    entry = near.head[lane]
    while entry >= 0 and near.u[entry] < u:
        last = entry
        entry = near.after[entry]
    if last >= 0:
        other = near.row[last]
        return u - near.u[last] - half - boxes.half[other, 0], other
    gap, follower = np.inf, -1
    for p in range(lanes.pred_first[lane], lanes.pred_first[lane + 1]):
        before = lanes.pred[p]
        entry = near.head[before]
        while entry >= 0:
            last = entry
            entry = near.after[entry]
        if near.head[before] >= 0:
            other = near.row[last]
            room = u + lanes.length[before] - near.u[last] - half - boxes.half[other, 0]
            if room < gap:
                gap, follower = room, other
    return gap, follower
