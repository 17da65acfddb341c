"""Passing what stands in the lane and will not move.

Where the room in the lane does not do, over a broken centre line, when the oncoming lane is free for long enough.
Where there is a second lane in the same direction, a lane change does it (`lavsim.traffic.lane_change`).
"""

from __future__ import annotations

import math

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import cos_sin
from lavsim.traffic.fleet import FROM, HOLD, LEAD_IN, LEAD_OUT, TO, Fleet, reset_plan
from lavsim.traffic.following import SAMPLE
from lavsim.traffic.guests import Guests
from lavsim.traffic.near import Near
from lavsim.traffic.network import Lanes, lane_point, point_row, project
from lavsim.traffic.obstacles import Boxes, Grid, obstacle_at

STAND_OFF = 6.0  # [m] kept before what stands, so that there is room to swing out
_CLOSE = 25.0  # [m] from which a driver thinks of passing
_TOO_CLOSE = 4.5  # [m] nearer it could not swing out without touching
_LONGEST = 60.0  # [m] of obstacles in a row that are passed at once
_BESIDE = 0.6  # [m] kept free beside them
_SWING = 9.0  # [m] in which a driver swings out and back at least
_SWING_TIME = 2.0  # [s]
_PASSING_SPEED = 5.0  # [m/s] expected while passing
_SPARE_TIME, _SPARE_ROOM = 2.0, 15.0  # [s], [m] that oncoming traffic must be away in the end
_BEFORE_END = 10.0  # [m] of the lane's end at which it must be over
_OVER_THE_EDGE = 0.1  # [m] that a vehicle may reach over the edge of its lane without asking for the other one
_FARTHER = 0.3  # [m] to the left of the oncoming lane's centre
_SEEN = 150.0  # [m] of the oncoming lane
_QUEUE_GAP = 15.0  # [m] to who stands ahead, or to a junction: a guest that stands there is waiting, not broken down
_AT_REST = 0.5  # [m/s]


@kernel
def consider_passing(
    lanes: Lanes, fleet: Fleet, boxes: Boxes, grid: Grid, near: Near, i: int, gap: float, tick: int
) -> None:
    """Lets vehicle `i` swing out around what stands `gap` ahead, if that is allowed and free."""
    lane = fleet.lane[i]
    opposite = lanes.opposite[lane]
    if not _TOO_CLOSE < gap < _CLOSE or fleet.plan[i, LEAD_IN] > 0.0:
        return
    row = fleet.row[i]
    half, speed = boxes.half[row, 0], max(boxes.forward[row], 0.0)
    swing = max(_SWING, _SWING_TIME * speed)
    end, left = _extent(lanes, fleet, boxes, grid, i, gap)
    if left <= 0.0 or end - fleet.u[i] > _LONGEST + _CLOSE or end + half + swing > lanes.length[lane] - _BEFORE_END:
        return
    shift = left + boxes.half[row, 1] + _BESIDE
    length = end + half + 1.0 - fleet.u[i]
    if shift > 0.5 * lanes.width[lane] - boxes.half[row, 1] + _OVER_THE_EDGE:
        if opposite < 0 or shift > 0.5 * (lanes.width[lane] + lanes.width[opposite]) + _FARTHER:
            return
        if not _is_oncoming_lane_free(lanes, boxes, near, opposite, lane, fleet.u[i], length + swing):
            return
    if not _is_way_free(lanes, fleet, boxes, grid, i, shift, length):
        return
    reset_plan(fleet, i)
    fleet.plan[i, FROM], fleet.plan[i, TO] = 0.0, -shift
    fleet.plan[i, LEAD_IN] = min(swing, max(gap + half, 0.5 * _SWING))
    fleet.plan[i, HOLD], fleet.plan[i, LEAD_OUT] = max(length, fleet.plan[i, LEAD_IN]), swing
    fleet.changed[i] = tick


@kernel
def stands_in_queue(lanes: Lanes, guests: Guests, boxes: Boxes, near: Near, row: int) -> bool:
    """Whether the guest in `row` waits before a junction or behind a background vehicle that stands."""
    for g in range(guests.number[0]):
        if guests.row[g] != row or guests.lane[g] < 0:
            continue
        lane, front = guests.lane[g], guests.u[g] + boxes.half[row, 0]
        left = lanes.length[lane] - front
        entry = near.head[lane]
        while entry >= 0:
            if near.u[entry] > front and _holds_up(boxes, near, entry, near.u[entry] - front):
                return True
            entry = near.after[entry]
        for s in range(lanes.succ_first[lane], lanes.succ_first[lane + 1]):
            beyond = lanes.succ[s]
            if lanes.junction[beyond] >= 0 and left < _QUEUE_GAP:
                return True
            entry = near.head[beyond]
            if entry >= 0 and _holds_up(boxes, near, entry, left + near.u[entry]):
                return True
    return False


@kernel
def _holds_up(boxes: Boxes, near: Near, entry: int, distance: float) -> bool:
    row = near.row[entry]
    stands = boxes.is_fleet[row] and abs(boxes.forward[row]) < _AT_REST
    return bool(stands and distance - boxes.half[row, 0] < _QUEUE_GAP)


@kernel
def _extent(lanes: Lanes, fleet: Fleet, boxes: Boxes, grid: Grid, i: int, gap: float) -> tuple[float, float]:
    """How far along its lane vehicle `i` is blocked, and how far to the left of the centre boxes reach there [m]."""
    row, lane = fleet.row[i], fleet.lane[i]
    half, margin = boxes.half[row, 0], boxes.half[row, 1] + _BESIDE
    u = fleet.u[i] + half + max(gap, 0.0)
    end, left, free = u, 0.0, 0.0
    while free < 2.0 * half + STAND_OFF + 2.0 and u < lanes.length[lane] and u - fleet.u[i] < _LONGEST + _CLOSE:
        p = point_row(lanes, lane, u)
        x, y, yaw = lanes.points[p, 0], lanes.points[p, 1], lanes.points[p, 3]
        _gap, _speed, who = obstacle_at(grid, boxes, row, (x, y, yaw), 0.0, margin)
        if who >= 0:
            free = 0.0
            cos, sin = cos_sin(boxes.pose[who, 2] - yaw)
            _u, offset, _yaw = project(lanes, lane, u, boxes.pose[who, 0], boxes.pose[who, 1])
            left = max(left, abs(sin) * boxes.half[who, 0] + abs(cos) * boxes.half[who, 1] - offset)
            end = max(end, _u + abs(cos) * boxes.half[who, 0] + abs(sin) * boxes.half[who, 1])
        else:
            free += SAMPLE
        u += SAMPLE
    return end, left


@kernel
def _is_way_free(lanes: Lanes, fleet: Fleet, boxes: Boxes, grid: Grid, i: int, shift: float, length: float) -> bool:
    """Whether nothing stands or comes `shift` to the left of the lane of vehicle `i` over the next `length` metres."""
    row, lane = fleet.row[i], fleet.lane[i]
    ahead = _SWING
    while ahead < length + _SPARE_ROOM:
        x, y, yaw, _bend = lane_point(lanes, lane, fleet.u[i] + ahead)
        cos, sin = cos_sin(yaw)
        place = (x + shift * sin, y - shift * cos, yaw)
        _gap, _speed, who = obstacle_at(grid, boxes, row, place, 0.0, boxes.half[row, 1] + 0.2)
        if who >= 0:
            return False
        ahead += SAMPLE
    return True


@kernel
def _is_oncoming_lane_free(
    lanes: Lanes, boxes: Boxes, near: Near, opposite: int, lane: int, u: float, length: float
) -> bool:
    """Whether nobody comes along the opposite lane while a vehicle at `u` passes over `length` metres."""
    time = length / _PASSING_SPEED + _SPARE_TIME
    scale = lanes.length[opposite] / lanes.length[lane]
    begin, end = lanes.length[opposite] - (u + length) * scale, lanes.length[opposite] - (u - 5.0) * scale
    entry = near.head[opposite]
    while entry >= 0:
        if near.u[entry] < end and not _stays_away(boxes, near, entry, begin - near.u[entry], time):
            return False
        entry = near.after[entry]
    for p in range(lanes.pred_first[opposite], lanes.pred_first[opposite + 1]):
        before = lanes.pred[p]
        if not _is_lane_behind_free(lanes, boxes, near, before, begin, time):
            return False
        if begin + lanes.length[before] < _SEEN:
            for q in range(lanes.pred_first[before], lanes.pred_first[before + 1]):
                if not _is_lane_behind_free(lanes, boxes, near, lanes.pred[q], begin + lanes.length[before], time):
                    return False
    return True


@kernel
def _is_lane_behind_free(lanes: Lanes, boxes: Boxes, near: Near, lane: int, beyond: float, time: float) -> bool:
    entry = near.head[lane]
    while entry >= 0:
        if not _stays_away(boxes, near, entry, beyond + lanes.length[lane] - near.u[entry], time):
            return False
        entry = near.after[entry]
    return True


@kernel
def _stays_away(boxes: Boxes, near: Near, entry: int, distance: float, time: float) -> bool:
    row = near.row[entry]
    speed = max(boxes.forward[row], 3.0)
    return bool(distance - boxes.half[row, 0] > speed * time + _SPARE_ROOM and not math.isinf(distance))
