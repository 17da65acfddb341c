"""What stands or moves in the way of a path: boxes in a hashed grid, asked point by point along a driver's path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import cos_sin

CELL = 8.0  # [m]
LOOKAHEAD_TIME = 2.0  # [s] how far ahead a crossing road user is expected to keep its velocity
CROSSING_SPEED = 0.6  # [m/s] across the path: below that an obstacle is where it is
LEVEL_GAP = 3.0  # [m] as in `lavsim.world.physics`
OUT, STANDING, MOVING = 0, 1, 2  # how a box is entered: not at all, until it is moved, anew in each tick
_CELLS_PER_BOX = 48


class Boxes(NamedTuple):
    """All that can be hit, one row an actor of the world.

    Attributes:
        present: (N,) whether the row is in the world.
        pose: (N, 3) x, y [m], yaw [rad].
        velocity: (N, 3) vx, vy [m/s], yaw rate.
        half: (N, 2) half length, half width [m].
        height: (N,) z of the ground below [m].
        forward: (N,) speed ahead [m/s].
        is_fleet: (N,) driven by the fleet: it keeps clear of crossing paths itself.
    """

    present: NDArray[np.bool_]
    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    half: NDArray[np.float64]
    height: NDArray[np.float64]
    forward: NDArray[np.float64]
    is_fleet: NDArray[np.bool_]


class Grid(NamedTuple):
    """Boxes by cell: a linked list per cell, those that stand at its end.

    Attributes:
        origin: (2,) lower corner [m].
        shape: (2,) columns (x) and rows (y).
        head: (cells,) first entry of each cell, -1 for none.
        standing: (cells,) the same for the boxes that stand alone.
        follow: (entries,) the entry after each, -1 at the end.
        box: (entries,) row of `Boxes`.
        cell: (entries,) where each is entered.
        used: (2,) entries of boxes that stand, and of all.
    """

    origin: NDArray[np.float64]
    shape: NDArray[np.int64]
    head: NDArray[np.int32]
    standing: NDArray[np.int32]
    follow: NDArray[np.int32]
    box: NDArray[np.int32]
    cell: NDArray[np.int32]
    used: NDArray[np.int64]


def make_grid(bounds: NDArray[np.float64], boxes: int) -> Grid:
    """An empty grid over `bounds` (x0, y0, x1, y1) for up to `boxes` boxes."""
    shape = np.maximum(np.ceil((bounds[2:] - bounds[:2]) / CELL).astype(np.int64) + 1, 1)
    entries = _CELLS_PER_BOX * max(boxes, 1)
    cells = int(shape[0] * shape[1])
    return Grid(
        np.asarray(bounds[:2], dtype=np.float64),
        shape,
        np.full(cells, -1, np.int32),
        np.full(cells, -1, np.int32),
        np.zeros(entries, np.int32),
        np.zeros(entries, np.int32),
        np.zeros(entries, np.int32),
        np.zeros(2, np.int64),
    )


@kernel
def cell_at(grid: Grid, x: float, y: float) -> int:
    """Cell of a point, -1 outside the grid."""
    cx, cy = math.floor((x - grid.origin[0]) / CELL), math.floor((y - grid.origin[1]) / CELL)
    if cx < 0 or cy < 0 or cx >= grid.shape[0] or cy >= grid.shape[1]:
        return -1
    return int(cy) * grid.shape[0] + int(cx)


@kernel
def cells_of(grid: Grid, points: NDArray[np.float64], cells: NDArray[np.int32]) -> None:
    """Fills `cells` (P,) with the cell of each centre point `(P, 5)`."""
    for p in range(len(points)):
        cells[p] = cell_at(grid, points[p, 0], points[p, 1])


@kernel
def enter_standing(grid: Grid, boxes: Boxes, how: NDArray[np.uint8], margin: float) -> None:
    """Enters the boxes that stand, and nothing else."""
    grid.head[:] = -1
    used = 0
    for i in range(len(how)):
        if how[i] == STANDING and boxes.present[i]:
            used = _enter(grid, boxes, i, 0.0, margin, used)
    for cell in range(len(grid.head)):
        grid.standing[cell] = grid.head[cell]
    grid.used[:] = used


@kernel
def enter_moving(grid: Grid, boxes: Boxes, how: NDArray[np.uint8], margin: float) -> None:
    """Enters the boxes that move where they are and where they will be within `LOOKAHEAD_TIME`.

    Args:
        grid: With the boxes that stand; entries of the last call are taken out.
        boxes: All boxes.
        how: (N,) `OUT`, `STANDING` or `MOVING`.
        margin: Boxes are made wider by this all round [m].
    """
    for entry in range(grid.used[0], grid.used[1]):
        grid.head[grid.cell[entry]] = grid.standing[grid.cell[entry]]
    used = grid.used[0]
    for i in range(len(how)):
        if how[i] == MOVING and boxes.present[i]:
            time = 0.0 if boxes.is_fleet[i] else LOOKAHEAD_TIME
            used = _enter(grid, boxes, i, time, margin, used)
    grid.used[1] = used


@kernel
def _enter(grid: Grid, boxes: Boxes, i: int, time: float, margin: float, used: int) -> int:
    cos, sin = cos_sin(boxes.pose[i, 2])
    cos, sin = abs(cos), abs(sin)
    reach_x = boxes.half[i, 0] * cos + boxes.half[i, 1] * sin + margin
    reach_y = boxes.half[i, 0] * sin + boxes.half[i, 1] * cos + margin
    x, y = boxes.pose[i, 0] - grid.origin[0], boxes.pose[i, 1] - grid.origin[1]
    ahead_x, ahead_y = x + boxes.velocity[i, 0] * time, y + boxes.velocity[i, 1] * time
    first_x = max(math.floor((min(x, ahead_x) - reach_x) / CELL), 0)
    last_x = min(math.floor((max(x, ahead_x) + reach_x) / CELL), grid.shape[0] - 1)
    first_y = max(math.floor((min(y, ahead_y) - reach_y) / CELL), 0)
    last_y = min(math.floor((max(y, ahead_y) + reach_y) / CELL), grid.shape[1] - 1)
    for cy in range(first_y, last_y + 1):
        for cx in range(first_x, last_x + 1):
            if used == len(grid.box):
                return used
            cell = cy * grid.shape[0] + cx
            grid.box[used], grid.follow[used], grid.cell[used] = i, grid.head[cell], cell
            grid.head[cell] = used
            used += 1
    return used


@kernel
def obstacle_at(
    grid: Grid,
    boxes: Boxes,
    own: int,
    point: tuple[float, float, float],
    time: float,
    margin: float,
) -> tuple[float, float, int]:
    """What blocks a path at one of its points.

    Args:
        grid: All boxes.
        boxes: The same, by row.
        own: Row to leave out.
        point: x, y [m] and heading [rad] of the path there.
        time: When the driver would be there, from now [s].
        margin: Half the driver's width and what it keeps free beside it [m].

    Returns:
        Distance from the point to the rear of the nearest blocking box along the path [m] (negative inside it), its
        speed along the path [m/s] and its row; (inf, 0, -1) when the point is free.
    """
    x, y, yaw = point
    nearest, speed, who = np.inf, 0.0, -1
    cell = cell_at(grid, x, y)
    if cell < 0:
        return nearest, speed, who
    entry = grid.head[cell]
    if entry < 0:
        return nearest, speed, who
    path_x, path_y = cos_sin(yaw)
    while entry >= 0:
        i = grid.box[entry]
        entry = grid.follow[entry]
        if i == own or abs(boxes.height[i] - boxes.height[own]) > LEVEL_GAP:
            continue
        vx, vy = boxes.velocity[i, 0], boxes.velocity[i, 1]
        gap = _gap_to(boxes, i, x, y, path_x, path_y, 0.0, margin)
        if math.isinf(gap) and not boxes.is_fleet[i] and abs(vy * path_x - vx * path_y) > CROSSING_SPEED:
            gap = _gap_to(boxes, i, x, y, path_x, path_y, min(time, LOOKAHEAD_TIME), margin)
        if gap < nearest:
            nearest, speed, who = gap, max(0.0, vx * path_x + vy * path_y), i
    return nearest, speed, who


@kernel
def _gap_to(
    boxes: Boxes, i: int, x: float, y: float, path_x: float, path_y: float, time: float, margin: float
) -> float:
    """Distance along the path from (x, y) to the near end of box `i` as it will be at `time`; inf if beside it."""
    dx = boxes.pose[i, 0] + boxes.velocity[i, 0] * time - x
    dy = boxes.pose[i, 1] + boxes.velocity[i, 1] * time - y
    half_length, half_width = boxes.half[i, 0], boxes.half[i, 1]
    reach = half_length + half_width + margin
    if abs(dx) > reach or abs(dy) > reach:
        return np.inf
    cos, sin = cos_sin(boxes.pose[i, 2])
    if abs(dx * cos + dy * sin) > half_length + margin or abs(dy * cos - dx * sin) > half_width + margin:
        return np.inf
    reach = abs(cos * path_x + sin * path_y) * half_length + abs(cos * path_y - sin * path_x) * half_width
    return dx * path_x + dy * path_y - reach
