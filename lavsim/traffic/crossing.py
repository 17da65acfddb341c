"""Inside a junction: who is first where two lanes meet drives on, the other stops short of that place."""

from __future__ import annotations

import numpy as np

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.fleet import NOBODY, Fleet
from lavsim.traffic.near import Near
from lavsim.traffic.network import Lanes
from lavsim.traffic.obstacles import Boxes
from lavsim.traffic.right_of_way import CLEARANCE, travel_time

_ACCELERATION = 1.5  # [m/s²] assumed of both
_HELD_UP = 40  # ticks at rest after which somebody no longer goes first


@kernel
def place_to_wait(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, i: int) -> tuple[float, int]:
    """Distance from the front of vehicle `i` to where it has to let another cross [m], and whom; inf if nobody."""
    target, at = near.target[i], near.distance[i]
    if target < 0 or at >= 0.0:
        return np.inf, NOBODY
    row = fleet.row[i]
    nearest, culprit = np.inf, NOBODY
    for e in range(lanes.conflict_first[target], lanes.conflict_first[target + 1]):
        begin = at + lanes.conflict_u[e, 0] - CLEARANCE
        if begin < 0.0 or begin > nearest:
            continue  # in the middle of it, past it, or not the first
        k = near.first[lanes.conflict[e]]
        while k >= 0:
            slot = near.slot[k]
            if near.distance[k] < 0.0 and slot >= 0 and slot != i:
                other = near.who[k]
                theirs = near.distance[k] + lanes.conflict_back[e, 0] - CLEARANCE
                over = near.distance[k] + lanes.conflict_back[e, 1] + 2.0 * boxes.half[other, 0] + CLEARANCE
                if over > 0.0 and (theirs < 0.0 or _is_first(lanes, fleet, boxes, slot, theirs, other, i, begin, row)):
                    nearest, culprit = begin, other
            k = near.follow[k]
    return nearest, culprit


@kernel
def _is_first(
    lanes: Lanes,
    fleet: Fleet,
    boxes: Boxes,
    slot: int,
    theirs: float,
    other: int,
    i: int,
    mine: float,
    row: int,
) -> bool:
    """Whether the vehicle in `other`, `theirs` metres away, goes before the one in `row`, `mine` metres away."""
    they_wait, i_wait = fleet.still[slot] > _HELD_UP, fleet.still[i] > _HELD_UP
    if they_wait != i_wait:
        return not they_wait
    if they_wait:
        return other < row
    first = travel_time(theirs, max(boxes.forward[other], 0.0), _ACCELERATION, lanes.speed_limit[fleet.lane[slot]])
    second = travel_time(mine, max(boxes.forward[row], 0.0), _ACCELERATION, lanes.speed_limit[fleet.lane[i]])
    return (first, other) < (second, row)
