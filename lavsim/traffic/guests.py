"""Vehicles that traffic does not drive (the ego, those of hazards): the lane each is on, kept up tick by tick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.map.town_map import TownMap
from lavsim.traffic.network import Lanes, settle, settle_beside
from lavsim.traffic.obstacles import Boxes

_BESIDE = 2.4  # [m] off its lane's centre: then another lane fits better, or none
_ASTRAY = math.radians(75.0)  # against its lane's direction: it is not on that lane
_FORK = 2.0  # [m] off the centre of a junction lane that it may still be following
_BROKEN_DOWN = 500  # ticks at rest: longer than a phase of a light lasts
MOST = 64  # guests that are looked after


class Guests(NamedTuple):
    """One slot each; slots beyond `number[0]` are empty.

    Attributes:
        number: (1,) of slots in use.
        row: (MOST,) row in the world.
        lane: (MOST,) the lane it is on, -1 where there is none.
        u: (MOST,) travelled length of it [m].
        offset: (MOST,) from its centre to the right [m].
        still: (MOST,) ticks at rest.
    """

    number: NDArray[np.int64]
    row: NDArray[np.int64]
    lane: NDArray[np.int32]
    u: NDArray[np.float64]
    offset: NDArray[np.float64]
    still: NDArray[np.int64]


def make_guests() -> Guests:
    return Guests(
        np.zeros(1, np.int64),
        np.full(MOST, -1, np.int64),
        np.full(MOST, -1, np.int32),
        np.zeros(MOST),
        np.zeros(MOST),
        np.zeros(MOST, np.int64),
    )


@kernel
def greet_guests(guests: Guests, is_guest: NDArray[np.bool_]) -> None:
    """Takes in guests that have come and drops those that have left; `is_guest` (N,) by row."""
    kept = 0
    last = -1
    for g in range(guests.number[0]):
        row = guests.row[g]
        if row < len(is_guest) and is_guest[row]:
            guests.row[kept], guests.lane[kept], guests.u[kept] = row, guests.lane[g], guests.u[g]
            guests.offset[kept], guests.still[kept] = guests.offset[g], guests.still[g]
            kept += 1
            last = max(last, row)
    for row in range(last + 1, len(is_guest)):
        if is_guest[row] and kept < MOST:
            guests.row[kept], guests.lane[kept], guests.u[kept] = row, -1, 0.0
            guests.offset[kept], guests.still[kept] = 0.0, 0
            kept += 1
    guests.number[0] = kept


@kernel
def track_guests(lanes: Lanes, guests: Guests, boxes: Boxes) -> None:
    """Moves every guest along its lane, into the lane that follows, or into the one beside it."""
    for g in range(guests.number[0]):
        row = guests.row[g]
        guests.still[g] = guests.still[g] + 1 if abs(boxes.forward[row]) < 0.15 else 0
        if guests.lane[g] >= 0:
            _track(lanes, guests, boxes, g)


@kernel
def _track(lanes: Lanes, guests: Guests, boxes: Boxes, g: int) -> None:
    row = guests.row[g]
    x, y = boxes.pose[row, 0], boxes.pose[row, 1]
    lane = guests.lane[g]
    u, offset, yaw = settle(lanes, lane, guests.u[g], x, y)
    best, best_lane, best_u, best_offset = np.inf, -1, u, offset
    if u > lanes.length[lane] or lanes.junction[lane] >= 0:
        start = lane
        if u <= lanes.length[lane] and lanes.pred_first[lane] < lanes.pred_first[lane + 1]:
            start = lanes.pred[lanes.pred_first[lane]]  # inside a junction: the lane may turn out to be a sibling
        past = u - lanes.length[lane] if start == lane else u
        for s in range(lanes.succ_first[start], lanes.succ_first[start + 1]):
            other = lanes.succ[s]
            at, aside, heading = settle(lanes, other, past, x, y)
            misfit = _misfit(boxes, row, aside, heading)
            if misfit < best and at <= lanes.length[other] + 1.0:
                best, best_lane, best_u, best_offset = misfit, other, at, aside
    else:
        best, best_lane = _misfit(boxes, row, offset, yaw), lane
        if abs(offset) > 1.2:
            other = lanes.right[lane] if offset > 0.0 else lanes.left[lane]
            if other >= 0:
                at, aside, heading = settle_beside(lanes, lane, u, other, x, y)
                if _misfit(boxes, row, aside, heading) < best:
                    best, best_lane, best_u, best_offset = 0.0, other, at, aside
    if best_lane < 0 or abs(best_offset) > _BESIDE or math.isinf(best):
        guests.lane[g] = -1
        return
    guests.lane[g], guests.u[g], guests.offset[g] = best_lane, max(best_u, 0.0), best_offset


@kernel
def _misfit(boxes: Boxes, row: int, offset: float, heading: float) -> float:
    """How badly a lane fits a vehicle; inf when it drives across or against it."""
    turn = boxes.pose[row, 2] - heading
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    return abs(offset) + 2.0 * abs(turn) if abs(turn) < _ASTRAY else np.inf


@kernel
def may_follow(lanes: Lanes, guests: Guests, boxes: Boxes, g: int, lane: int) -> tuple[float, bool]:
    """Travelled length of guest `g` on junction lane `lane`, and whether it may be following it."""
    row = guests.row[g]
    u, offset, _yaw = settle(lanes, lane, guests.u[g], boxes.pose[row, 0], boxes.pose[row, 1])
    return u, abs(offset) < _FORK and u <= lanes.length[lane]


@kernel
def has_stood(guests: Guests, row: int) -> bool:
    """Whether the guest in `row` has been at rest for so long that it may be passed."""
    for g in range(guests.number[0]):
        if guests.row[g] == row:
            return bool(guests.still[g] > _BROKEN_DOWN)
    return False


def find_lost(town: TownMap, guests: Guests, boxes: Boxes) -> None:
    """Looks for the lane of guests that have none, in the whole town."""
    count = int(guests.number[0])
    lost = np.flatnonzero(guests.lane[:count] < 0)
    if not len(lost):
        return
    rows = guests.row[lost]
    points = np.column_stack([boxes.pose[rows, :2], boxes.height[rows]])
    hits = town.nearest(points)
    turn = np.mod(boxes.pose[rows, 2] - hits.yaw + np.pi, 2.0 * np.pi) - np.pi
    found = (np.abs(hits.offset) < _BESIDE) & (np.abs(turn) < _ASTRAY) & (hits.distance < 2.0 * _BESIDE)
    slots = lost[found]
    guests.lane[slots], guests.u[slots], guests.offset[slots] = hits.lane[found], hits.u[found], hits.offset[found]
