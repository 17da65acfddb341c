"""Which boxes have to be looked for point by point, and which can't be in anybody's way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.corridor import Corridor, comes_in_the_way, is_in_the_way
from lavsim.traffic.fleet import LEAD_IN, Fleet
from lavsim.traffic.network import Lanes
from lavsim.traffic.obstacles import MOVING, OUT, STANDING, Boxes, Grid, enter_moving, enter_standing
from lavsim.world.motion import DRIVEN, RESTING, WALKING

_ON_CENTRE = 0.4  # [m] off the lane's centre: a vehicle within that keeps to its lane
_CLEAR_OF_MEETING = 3.0  # [m] from where lanes cross or join
_GRID_MARGIN = 1.9  # [m] half the widest driver and its side margin


class Sorting(NamedTuple):
    """What is known about each row of the world.

    Attributes:
        slot: (N,) slot in the fleet, -1.
        how: (N,) `OUT`, `STANDING` or `MOVING`.
        pose: (N, 3) of boxes that stand, when they were sorted.
        is_guest: (N,) driven, but not by the fleet.
    """

    slot: NDArray[np.int32]
    how: NDArray[np.uint8]
    pose: NDArray[np.float64]
    is_guest: NDArray[np.bool_]


def make_sorting(rows: int) -> Sorting:
    return Sorting(
        np.full(rows, -1, np.int32),
        np.zeros(rows, np.uint8),
        np.full((rows, 3), np.nan),
        np.zeros(rows, np.bool_),
    )


@kernel
def sort_boxes(
    lanes: Lanes,
    fleet: Fleet,
    corridor: Corridor,
    boxes: Boxes,
    motion: NDArray[np.uint8],
    sorting: Sorting,
    grid: Grid,
) -> None:
    """Sorts all boxes and enters those that may be in the way into the grid.

    Args:
        lanes: The road network.
        fleet: All drivers, with their offsets of this tick.
        corridor: Where driving lanes are.
        boxes: All boxes.
        motion: (N,) as `lavsim.world.motion` has it.
        sorting: Updated.
        grid: Filled.
    """
    sorting.slot[:] = -1
    boxes.is_fleet[:] = False
    for i in range(len(fleet.row)):
        if fleet.row[i] >= 0:
            sorting.slot[fleet.row[i]] = i
            boxes.is_fleet[fleet.row[i]] = True
    has_changed = False
    for row in range(len(motion)):
        slot = sorting.slot[row]
        before = sorting.how[row]
        sorting.is_guest[row] = slot < 0 and boxes.present[row] and motion[row] == DRIVEN
        if not boxes.present[row]:
            sorting.how[row] = OUT
        elif slot >= 0:
            sorting.how[row] = MOVING if _is_about(lanes, fleet, boxes, slot) else OUT
        elif motion[row] == RESTING:
            if _has_moved(sorting, boxes, row):
                sorting.how[row] = STANDING if is_in_the_way(corridor, boxes, row) else OUT
                has_changed = True
        elif motion[row] == WALKING:
            sorting.how[row] = MOVING if comes_in_the_way(corridor, boxes, row) else OUT
        else:
            sorting.how[row] = MOVING
        if (before == STANDING) != (sorting.how[row] == STANDING):
            has_changed = True
    if has_changed:
        enter_standing(grid, boxes, sorting.how, _GRID_MARGIN)
    enter_moving(grid, boxes, sorting.how, _GRID_MARGIN)


@kernel
def _is_about(lanes: Lanes, fleet: Fleet, boxes: Boxes, slot: int) -> bool:
    """Whether a vehicle may be in the way of others than those behind it on its lane."""
    lane, u = fleet.lane[slot], fleet.u[slot]
    if lanes.junction[lane] >= 0 or abs(fleet.offset[slot]) > _ON_CENTRE or fleet.plan[slot, LEAD_IN] > 0.0:
        return True
    half = boxes.half[fleet.row[slot], 0]
    if lanes.meets_start[lane] and u < half + _CLEAR_OF_MEETING:
        return True
    return bool(lanes.meets_end[lane] and u + half + 0.5 > lanes.length[lane])


@kernel
def _has_moved(sorting: Sorting, boxes: Boxes, row: int) -> bool:
    """Whether a box that stands is elsewhere than it was; notes where it is."""
    has_moved = False
    for k in range(3):
        if sorting.pose[row, k] != boxes.pose[row, k]:
            sorting.pose[row, k] = boxes.pose[row, k]
            has_moved = True
    return has_moved
