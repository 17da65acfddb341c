"""Who is where on the lanes, rebuilt every tick: the order along each lane, and who comes to each junction lane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.fleet import PATH_LANES, Fleet
from lavsim.traffic.guests import MOST, Guests, may_follow
from lavsim.traffic.network import Lanes, settle_beside
from lavsim.traffic.obstacles import Boxes

SLOW = 3.0  # [m/s] who is slower may stop behind a junction and leave no room
_SHORTEST_VIEW, _VIEW_TIME = 30.0, 4.5  # [m], [s] before a junction at which others are taken into account
_ON_LANE = 1.5  # [m] off the centre: guests within that are in the lane's order
_APPROACHES = 8  # junction lanes that a guest may enter


class Near(NamedTuple):
    """Scratch space of a tick. Entries of the order: slot i of the fleet, V + i on the lane it is leaving, then guests.

    Attributes:
        head: (L,) entry at the beginning of each lane, -1.
        after: (entries,) the next entry ahead on the same lane, -1.
        lane: (entries,) the lane of an entry, -1.
        u: (entries,) travelled length of its centre [m].
        row: (entries,) its row in the world.
        first: (L,) first approach to each junction lane, -1.
        follow: (approaches,) the next one to the same, -1.
        target: (approaches,) junction lane that somebody is on or comes to; of fleet slot i at i, -1 for none.
        distance: (approaches,) from its front to that lane [m]; negative once inside.
        who: (approaches,) row in the world.
        slot: (approaches,) slot in the fleet, or -1 - g for guest g.
        used: (1,) approaches.
        tail: (L,) travelled length at the rear of the last slow vehicle of each lane [m]; inf when free.
        tail_row: (L,) its row in the world, -1.
        claimed: (L,) length taken on each lane by vehicles inside the junction before it [m].
    """

    head: NDArray[np.int32]
    after: NDArray[np.int32]
    lane: NDArray[np.int32]
    u: NDArray[np.float64]
    row: NDArray[np.int64]
    first: NDArray[np.int32]
    follow: NDArray[np.int32]
    target: NDArray[np.int32]
    distance: NDArray[np.float64]
    who: NDArray[np.int64]
    slot: NDArray[np.int32]
    used: NDArray[np.int64]
    tail: NDArray[np.float64]
    tail_row: NDArray[np.int64]
    claimed: NDArray[np.float64]


def make_near(lanes: int, vehicles: int) -> Near:
    entries, approaches = 2 * vehicles + MOST, 2 * vehicles + _APPROACHES * MOST
    return Near(
        head=np.full(lanes, -1, np.int32),
        after=np.full(entries, -1, np.int32),
        lane=np.full(entries, -1, np.int32),
        u=np.zeros(entries),
        row=np.zeros(entries, np.int64),
        first=np.full(lanes, -1, np.int32),
        follow=np.full(approaches, -1, np.int32),
        target=np.full(approaches, -1, np.int32),
        distance=np.zeros(approaches),
        who=np.zeros(approaches, np.int64),
        slot=np.zeros(approaches, np.int32),
        used=np.zeros(1, np.int64),
        tail=np.full(lanes, np.inf),
        tail_row=np.full(lanes, -1, np.int64),
        claimed=np.zeros(lanes),
    )


@kernel
def survey(lanes: Lanes, fleet: Fleet, guests: Guests, boxes: Boxes, near: Near) -> None:
    """Fills `near` from where all vehicles are."""
    near.head[:] = -1
    near.first[:] = -1
    near.tail[:] = np.inf
    near.tail_row[:] = -1
    near.claimed[:] = 0.0
    near.lane[:] = -1
    count = len(fleet.row)
    near.used[0] = count
    for i in range(count):
        near.target[i] = -1
        row = fleet.row[i]
        if row < 0 or not boxes.present[row]:
            continue
        enter_order(near, i, fleet.lane[i], fleet.u[i], row)
        if fleet.aside[i] >= 0:
            lane = fleet.aside[i]
            x, y = boxes.pose[row, 0], boxes.pose[row, 1]
            u, _offset, _yaw = settle_beside(lanes, fleet.lane[i], fleet.u[i], lane, x, y)
            enter_order(near, count + i, lane, u, row)
        _note_tail(near, fleet.lane[i], fleet.u[i], boxes, row)
        _approach(lanes, fleet, boxes, near, i)
    for g in range(guests.number[0]):
        if guests.lane[g] >= 0:
            row = guests.row[g]
            if abs(guests.offset[g]) < _ON_LANE:
                enter_order(near, 2 * count + g, guests.lane[g], guests.u[g], row)
            _note_tail(near, guests.lane[g], guests.u[g], boxes, row)
            _approach_of_guest(lanes, guests, boxes, near, g)


@kernel
def enter_order(near: Near, entry: int, lane: int, u: float, row: int) -> None:
    """Enters a vehicle into the order along a lane."""
    near.lane[entry], near.u[entry], near.row[entry] = lane, u, row
    at = near.head[lane]
    if at < 0 or near.u[at] >= u:
        near.after[entry], near.head[lane] = at, entry
        return
    while near.after[at] >= 0 and near.u[near.after[at]] < u:
        at = near.after[at]
    near.after[entry], near.after[at] = near.after[at], entry


@kernel
def _note_tail(near: Near, lane: int, u: float, boxes: Boxes, row: int) -> None:
    rear = u - boxes.half[row, 0]
    if boxes.forward[row] < SLOW and rear < near.tail[lane]:
        near.tail[lane], near.tail_row[lane] = rear, row


@kernel
def _announce(near: Near, at: int, lane: int, distance: float, row: int, slot: int) -> None:
    near.target[at], near.distance[at], near.who[at], near.slot[at] = lane, distance, row, slot
    near.follow[at], near.first[lane] = near.first[lane], at


@kernel
def view_before_junction(speed: float) -> float:
    """How far before a junction a vehicle at `speed` counts as coming to it [m]."""
    return max(_SHORTEST_VIEW, _VIEW_TIME * speed)


@kernel
def _approach(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, i: int) -> None:
    """Announces vehicle `i` at the junction lane it is on or comes to, and at the next one after it."""
    row = fleet.row[i]
    half = boxes.half[row, 0]
    view = view_before_junction(boxes.forward[row])
    lane = fleet.lane[i]
    ahead = lanes.length[lane] - fleet.u[i] - half
    at = i
    if lanes.junction[lane] >= 0:
        _announce(near, i, lane, -fleet.u[i] - half, row, i)
        exit_lane = exit_of(lanes, fleet, i, -1)
        if exit_lane >= 0:
            near.claimed[exit_lane] += 2.0 * half + 2.0
        at = near.used[0]
    for k in range(PATH_LANES):
        lane = fleet.path[i, k]
        if lane < 0 or ahead > view:
            return
        if lanes.junction[lane] >= 0:
            _announce(near, at, lane, ahead, row, i)
            if at != i:
                near.used[0] += 1
            return
        ahead += lanes.length[lane]


@kernel
def _approach_of_guest(lanes: Lanes, guests: Guests, boxes: Boxes, near: Near, g: int) -> None:
    """Announces a guest at every junction lane that it may be on or enter next."""
    row = guests.row[g]
    half = boxes.half[row, 0]
    lane = guests.lane[g]
    free = _APPROACHES
    if lanes.junction[lane] >= 0:
        start = lanes.pred[lanes.pred_first[lane]] if lanes.pred_first[lane] < lanes.pred_first[lane + 1] else -1
        if start < 0:
            return
        for s in range(lanes.succ_first[start], lanes.succ_first[start + 1]):
            other = lanes.succ[s]
            u, fits = may_follow(lanes, guests, boxes, g, other)
            if (fits or other == lane) and free > 0:
                _announce(near, near.used[0], other, -max(u, 0.0) - half, row, -1 - g)
                near.used[0] += 1
                free -= 1
        return
    ahead = lanes.length[lane] - guests.u[g] - half
    view = view_before_junction(boxes.forward[row])
    for _ in range(3):
        if ahead > view or lanes.succ_first[lane] == lanes.succ_first[lane + 1]:
            return
        following = lanes.succ[lanes.succ_first[lane]]
        if lanes.junction[following] >= 0:
            for s in range(lanes.succ_first[lane], lanes.succ_first[lane + 1]):
                if free > 0:
                    _announce(near, near.used[0], lanes.succ[s], ahead, row, -1 - g)
                    near.used[0] += 1
                    free -= 1
            return
        lane = following
        ahead += lanes.length[lane]


@kernel
def exit_of(lanes: Lanes, fleet: Fleet, i: int, k: int) -> int:
    """The first lane of vehicle `i`'s path after position `k` that is outside junctions, -1."""
    for j in range(k + 1, PATH_LANES):
        lane = fleet.path[i, j]
        if lane < 0 or lanes.junction[lane] < 0:
            return lane
    return -1


@kernel
def leader_in_lane(
    lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Near, i: int, entry: int, horizon: float
) -> tuple[float, float, int]:
    """Which background vehicle is ahead on the path of vehicle `i`: gap [m], speed [m/s], row; (inf, 0, -1) for none.

    Args:
        lanes: The road network.
        fleet: All drivers.
        boxes: All boxes.
        near: This tick's order.
        i: The vehicle.
        entry: Its entry on its lane (then its path is followed), or on the one it is leaving.
        horizon: How far to look from its centre [m].
    """
    row = fleet.row[i]
    half = boxes.half[row, 0]
    other = _of_fleet(boxes, near, near.after[entry])
    if other >= 0:
        return _ahead(boxes, near, other, near.u[other] - near.u[entry] - half)
    if entry != i:
        return _leader_beyond(lanes, boxes, near, entry, half)
    distance = lanes.length[fleet.lane[i]] - fleet.u[i]
    for k in range(PATH_LANES):
        lane = fleet.path[i, k]
        if lane < 0 or distance > horizon:
            break
        other = _of_fleet(boxes, near, near.head[lane])
        if other >= 0:
            if near.row[other] == row:
                break
            return _ahead(boxes, near, other, distance + near.u[other] - half)
        distance += lanes.length[lane]
    return np.inf, 0.0, -1


@kernel
def _leader_beyond(lanes: Lanes, boxes: Boxes, near: Near, entry: int, half: float) -> tuple[float, float, int]:
    """As `leader_in_lane`, on the lanes outside junctions after that of `entry`."""
    gap, pace, who = np.inf, 0.0, -1
    ahead = lanes.length[near.lane[entry]] - near.u[entry] - half
    for s in range(lanes.succ_first[near.lane[entry]], lanes.succ_first[near.lane[entry] + 1]):
        other = _of_fleet(boxes, near, near.head[lanes.succ[s]])
        if other >= 0 and lanes.junction[lanes.succ[s]] < 0 and near.row[other] != near.row[entry]:
            room, speed, row = _ahead(boxes, near, other, ahead + near.u[other])
            if room < gap:
                gap, pace, who = room, speed, row
    return gap, pace, who


@kernel
def _ahead(boxes: Boxes, near: Near, entry: int, distance: float) -> tuple[float, float, int]:
    row = near.row[entry]
    return distance - boxes.half[row, 0], max(boxes.forward[row], 0.0), row


@kernel
def _of_fleet(boxes: Boxes, near: Near, entry: int) -> int:
    """The first entry from `entry` on that is a background vehicle; the others are seen as boxes."""
    while entry >= 0 and not boxes.is_fleet[near.row[entry]]:
        entry = near.after[entry]
    return entry
