"""What stands or moves in the way of a path: boxes in a hashed grid, asked point by point along a driver's path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

CELL = 8.0  # [m]
LOOKAHEAD_TIME = 2.0  # [s] how far ahead a crossing road user is expected to keep its velocity
CROSSING_SPEED = 0.6  # [m/s] across the path: below that an obstacle is where it is
LEVEL_GAP = 3.0  # [m] as in `lavsim.world.physics`
_CELLS_PER_BOX = 48


class Boxes(NamedTuple):
    """All that can be hit, one row an actor of the world.

    Attributes:
        present: (N,) whether the row is in the world.
        pose: (N, 3) x, y [m], yaw [rad].
        velocity: (N, 3) vx, vy [m/s], yaw rate.
        half: (N, 2) half length, half width [m].
        height: (N,) z of the ground below [m].
    """

    present: NDArray[np.bool_]
    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    half: NDArray[np.float64]
    height: NDArray[np.float64]


class Grid(NamedTuple):
    """Boxes by cell: a linked list per cell.

    Attributes:
        origin: (2,) lower corner [m].
        shape: (2,) columns (x) and rows (y).
        head: (cells,) first entry of each cell, -1 for none.
        follow: (entries,) the entry after each, -1 at the end.
        box: (entries,) row of `Boxes`.
    """

    origin: NDArray[np.float64]
    shape: NDArray[np.int64]
    head: NDArray[np.int32]
    follow: NDArray[np.int32]
    box: NDArray[np.int32]


def make_grid(bounds: NDArray[np.float64], boxes: int) -> Grid:
    """An empty grid over `bounds` (x0, y0, x1, y1) for up to `boxes` boxes."""
    shape = np.maximum(np.ceil((bounds[2:] - bounds[:2]) / CELL).astype(np.int64) + 1, 1)
    entries = _CELLS_PER_BOX * max(boxes, 1)
    return Grid(
        np.asarray(bounds[:2], dtype=np.float64),
        shape,
        np.full(int(shape[0] * shape[1]), -1, np.int32),
        np.zeros(entries, np.int32),
        np.zeros(entries, np.int32),
    )


@kernel
def fill_grid(grid: Grid, boxes: Boxes, margin: float) -> None:
    """Enters each box where it is and where it will be within `LOOKAHEAD_TIME`, `margin` [m] wider all round."""
    grid.head[:] = -1
    used = 0
    for i in range(len(boxes.present)):
        if not boxes.present[i]:
            continue
        reach = math.sqrt(boxes.half[i, 0] ** 2 + boxes.half[i, 1] ** 2) + margin
        x, y = boxes.pose[i, 0], boxes.pose[i, 1]
        ahead_x, ahead_y = x + boxes.velocity[i, 0] * LOOKAHEAD_TIME, y + boxes.velocity[i, 1] * LOOKAHEAD_TIME
        first_x = max(int((min(x, ahead_x) - reach - grid.origin[0]) // CELL), 0)
        last_x = min(int((max(x, ahead_x) + reach - grid.origin[0]) // CELL), grid.shape[0] - 1)
        first_y = max(int((min(y, ahead_y) - reach - grid.origin[1]) // CELL), 0)
        last_y = min(int((max(y, ahead_y) + reach - grid.origin[1]) // CELL), grid.shape[1] - 1)
        for cy in range(first_y, last_y + 1):
            for cx in range(first_x, last_x + 1):
                if used == len(grid.box):
                    return
                cell = cy * grid.shape[0] + cx
                grid.box[used], grid.follow[used] = i, grid.head[cell]
                grid.head[cell] = used
                used += 1


@kernel
def obstacle_at(
    grid: Grid,
    boxes: Boxes,
    own: int,
    point: tuple[float, float, float],
    time: float,
    margin: float,
) -> tuple[float, float]:
    """What blocks a path at one of its points.

    Args:
        grid: All boxes.
        boxes: The same, by row.
        own: Row to leave out.
        point: x, y [m] and heading [rad] of the path there.
        time: When the driver would be there, from now [s].
        margin: Half the driver's width and what it keeps free beside it [m].

    Returns:
        Distance from the point to the rear of the nearest blocking box along the path [m] (negative inside it), and its
        speed along the path [m/s]; (inf, 0) when the point is free.
    """
    x, y, yaw = point
    cx, cy = int((x - grid.origin[0]) // CELL), int((y - grid.origin[1]) // CELL)
    nearest, speed = np.inf, 0.0
    if cx < 0 or cy < 0 or cx >= grid.shape[0] or cy >= grid.shape[1]:
        return nearest, speed
    path_x, path_y = math.cos(yaw), math.sin(yaw)
    entry = grid.head[cy * grid.shape[0] + cx]
    while entry >= 0:
        i = grid.box[entry]
        entry = grid.follow[entry]
        if i == own or abs(boxes.height[i] - boxes.height[own]) > LEVEL_GAP:
            continue
        vx, vy = boxes.velocity[i, 0], boxes.velocity[i, 1]
        gap = _gap_to(boxes, i, x, y, path_x, path_y, 0.0, margin)
        if math.isinf(gap) and abs(vy * path_x - vx * path_y) > CROSSING_SPEED:
            gap = _gap_to(boxes, i, x, y, path_x, path_y, min(time, LOOKAHEAD_TIME), margin)
        if gap < nearest:
            nearest, speed = gap, max(0.0, vx * path_x + vy * path_y)
    return nearest, speed


@kernel
def _gap_to(
    boxes: Boxes, i: int, x: float, y: float, path_x: float, path_y: float, time: float, margin: float
) -> float:
    """Distance along the path from (x, y) to the near end of box `i` as it will be at `time`; inf if beside it."""
    dx = boxes.pose[i, 0] + boxes.velocity[i, 0] * time - x
    dy = boxes.pose[i, 1] + boxes.velocity[i, 1] * time - y
    cos, sin = math.cos(boxes.pose[i, 2]), math.sin(boxes.pose[i, 2])
    half_length, half_width = boxes.half[i, 0], boxes.half[i, 1]
    if abs(dx * cos + dy * sin) > half_length + margin or abs(dy * cos - dx * sin) > half_width + margin:
        return np.inf
    reach = abs(cos * path_x + sin * path_y) * half_length + abs(cos * path_y - sin * path_x) * half_width
    return dx * path_x + dy * path_y - reach
