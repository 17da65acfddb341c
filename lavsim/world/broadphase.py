"""Which bodies could touch within a tick: a hashed grid, then separating axes of the boxes along their way.

Almost every tick of a drive has no contact at all, so the engine behind `lavsim.world.physics` is asked only about
bodies that this test can't clear. The test errs on one side: whatever touches during the tick is found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.portable_math import cos_sin
from lavsim.world.motion import GONE, WALKING

LEVEL_GAP = 3.0  # [m] DESIGN section 2: actors farther apart in z ignore each other
BODY_BAND = (0.25, 1.2)  # [m] above the ground: what is lower is driven over, what is higher under
_CELL = 16.0  # [m] of the grid of bodies; more than two of the longest
_SLOTS = 1024  # hashed cells
_WALL_CELL = 8.0  # [m] of the grid of walls


class Walls(NamedTuple):
    """Convex polygons that nothing moves, in a grid.

    Attributes:
        corners: (W, K, 2) corners [m]; those from `sides` on are unused.
        sides: (W,) corners of each.
        bounds: (W, 4) x0, y0, x1, y1 [m].
        z: (W, 2) bottom and top [m].
        origin: (2,) lower corner of the grid [m].
        shape: (2,) columns (x) and rows (y).
        first: (cells + 1,) where each cell's walls begin in `entry`.
        entry: walls by cell.
    """

    corners: NDArray[np.float64]
    sides: NDArray[np.int64]
    bounds: NDArray[np.float64]
    z: NDArray[np.float64]
    origin: NDArray[np.float64]
    shape: NDArray[np.int64]
    first: NDArray[np.int64]
    entry: NDArray[np.int64]


class Scratch(NamedTuple):
    """Room for the test, reused every tick.

    Attributes:
        head: (slots,) first row of each hashed cell, -1 for none.
        follow: (N,) the row after each in its cell, -1 at the end.
        reach: (N,) half diagonal of each box and how far it moves [m]; negative for rows that meet nobody.
        axis: (N, 2) cosine and sine of each heading.
        moves: (N,) whether it moves at all.
    """

    head: NDArray[np.int32]
    follow: NDArray[np.int32]
    reach: NDArray[np.float64]
    axis: NDArray[np.float64]
    moves: NDArray[np.bool_]


def make_scratch(rows: int) -> Scratch:
    """Room for `rows` rows."""
    return Scratch(
        np.full(_SLOTS, -1, np.int32),
        np.full(rows, -1, np.int32),
        np.zeros(rows),
        np.zeros((rows, 2)),
        np.zeros(rows, np.bool_),
    )


def build_walls(polygons: Sequence[NDArray[np.float64]], z: NDArray[np.float64] | None = None) -> Walls:
    """A grid over convex polygons `(M, 2)` with bottoms and tops `z` `(W, 2)` [m], of any height if none are given."""
    z = np.tile([-np.inf, np.inf], (len(polygons), 1)) if z is None else np.asarray(z, dtype=np.float64).reshape(-1, 2)
    count = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    most = int(count.max()) if len(count) else 0
    corners = np.zeros((len(polygons), most, 2))
    for k, polygon in enumerate(polygons):
        corners[k, : len(polygon)] = polygon
        corners[k, len(polygon) :] = polygon[-1]  # so that bounds need no mask
    if not len(polygons):
        empty = np.zeros(0, np.int64)
        return Walls(
            corners, count, np.zeros((0, 4)), z, np.zeros(2), np.zeros(2, np.int64), np.zeros(1, np.int64), empty
        )
    bounds = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    origin = bounds[:, :2].min(axis=0)
    shape = np.floor((bounds[:, 2:].max(axis=0) - origin) / _WALL_CELL).astype(np.int64) + 1
    first, entry = _fill_walls(bounds, origin, shape)
    return Walls(corners, count, bounds, z, origin, shape, first, entry)


@kernel
def _fill_walls(
    bounds: NDArray[np.float64], origin: NDArray[np.float64], shape: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Walls by cell: counted first, then entered in ascending order."""
    first = np.zeros(shape[0] * shape[1] + 1, np.int64)
    entry = np.zeros(0, np.int64)
    for is_filling in (False, True):
        used = first[:-1].copy()
        for w in range(len(bounds)):
            for cy in range(
                int((bounds[w, 1] - origin[1]) // _WALL_CELL), int((bounds[w, 3] - origin[1]) // _WALL_CELL) + 1
            ):
                for cx in range(
                    int((bounds[w, 0] - origin[0]) // _WALL_CELL), int((bounds[w, 2] - origin[0]) // _WALL_CELL) + 1
                ):
                    cell = cy * shape[0] + cx
                    if is_filling:
                        entry[used[cell]] = w
                        used[cell] += 1
                    else:
                        first[cell + 1] += 1
        if not is_filling:
            first = np.cumsum(first)
            entry = np.zeros(first[-1], np.int64)
    return first, entry


@kernel
def find_candidates(
    motion: NDArray[np.uint8],
    pose: NDArray[np.float64],
    move: NDArray[np.float64],
    half: NDArray[np.float64],
    height: NDArray[np.float64],
    walls: Walls,
    scratch: Scratch,
    found: NDArray[np.bool_],
) -> int:
    """Rows that may touch something during a tick; at rest a row can only be touched by one that moves.

    Args:
        motion: (N,) as in `lavsim.world.motion.integrate`.
        pose: (N, 3) x, y, yaw before the tick.
        move: (N, 3) displacement and turn.
        half: (N, 2) half length, half width [m]; 0 for what nobody can touch.
        height: (N,) z of the ground below [m].
        walls: What nothing moves; walkers on their feet keep off it themselves.
        scratch: Room for N rows.
        found: (N,) filled.

    Returns:
        How many rows were found.
    """
    n = len(motion)
    head, follow, reach, axis, moves = scratch.head, scratch.follow, scratch.reach, scratch.axis, scratch.moves
    widest = _enter_rows(motion, pose, move, half, scratch)
    found[:] = False
    for i in range(n):
        if not moves[i]:
            continue
        x, y, far = pose[i, 0], pose[i, 1], reach[i] + widest
        last_x, last_y = math.floor((x + far) / _CELL), math.floor((y + far) / _CELL)
        for cy in range(math.floor((y - far) / _CELL), last_y + 1):
            for cx in range(math.floor((x - far) / _CELL), last_x + 1):
                j = head[_slot(cx, cy)]
                while j >= 0:
                    # The cheap tests stand here: a call with arrays costs more than they do.
                    dx, dy, near = pose[j, 0] - x, pose[j, 1] - y, reach[i] + reach[j]
                    is_new = j > i or not moves[j]  # of two that move, the first looks for the second
                    if dx * dx + dy * dy < near * near and j != i and is_new and not (found[i] and found[j]):
                        apart = abs(height[i] - height[j]) > LEVEL_GAP
                        walkers = motion[i] == WALKING and motion[j] == WALKING  # they make room for each other
                        if not apart and not walkers:
                            slack = abs(move[i, 2]) * reach[i] + abs(move[j, 2]) * reach[j]
                            way = move[j, 0] - move[i, 0], move[j, 1] - move[i, 1]
                            box_i = axis[i, 0], axis[i, 1], half[i, 0], half[i, 1]
                            box_j = axis[j, 0], axis[j, 1], half[j, 0], half[j, 1]
                            if _boxes_meet(dx, dy, way, slack, box_i, box_j):
                                found[i] = found[j] = True
                    j = follow[j]
    if len(walls.sides) > 0:
        _mark_walls(motion, pose, move, half, height, scratch, walls, found)
    return int(np.sum(found))


@kernel
def _enter_rows(
    motion: NDArray[np.uint8],
    pose: NDArray[np.float64],
    move: NDArray[np.float64],
    half: NDArray[np.float64],
    scratch: Scratch,
) -> float:
    """Fills the grid with all rows; returns the largest reach."""
    scratch.head[:] = -1
    widest = 0.0
    for i in range(len(motion)):
        if motion[i] == GONE or half[i, 0] == 0.0:
            scratch.reach[i], scratch.moves[i] = -1.0, False
            continue
        travel = math.sqrt(move[i, 0] ** 2 + move[i, 1] ** 2)
        scratch.moves[i] = travel > 0.0 or move[i, 2] != 0.0
        scratch.reach[i] = math.sqrt(half[i, 0] ** 2 + half[i, 1] ** 2) + travel
        scratch.axis[i, 0], scratch.axis[i, 1] = cos_sin(pose[i, 2])
        widest = max(widest, scratch.reach[i])
        slot = _slot(math.floor(pose[i, 0] / _CELL), math.floor(pose[i, 1] / _CELL))
        scratch.follow[i] = scratch.head[slot]
        scratch.head[slot] = i
    return widest


@kernel
def spread(
    pose: NDArray[np.float64],
    reach: NDArray[np.float64],
    margin: float,
    found: NDArray[np.bool_],
) -> None:
    """Adds to `found` whoever stands within `margin` [m] of one that is in it: what a pushed body may reach."""
    n = len(found)
    seeds = np.flatnonzero(found)
    for i in seeds:
        for j in range(n):
            if not found[j] and reach[j] >= 0.0:
                apart = math.sqrt((pose[i, 0] - pose[j, 0]) ** 2 + (pose[i, 1] - pose[j, 1]) ** 2)
                found[j] = apart < reach[i] + reach[j] + margin


@kernel
def walls_near(x: float, y: float, radius: float, walls: Walls) -> NDArray[np.int64]:
    """Walls whose bounds come within `radius` of a point, ascending."""
    near = np.zeros(len(walls.sides), np.bool_)
    for w in range(len(walls.sides)):
        dx = max(walls.bounds[w, 0] - x, x - walls.bounds[w, 2], 0.0)
        dy = max(walls.bounds[w, 1] - y, y - walls.bounds[w, 3], 0.0)
        near[w] = dx * dx + dy * dy <= radius * radius
    return np.flatnonzero(near)


@kernel
def _slot(cx: int, cy: int) -> int:
    return (cx * 73856093 ^ cy * 19349663) & (_SLOTS - 1)


@kernel
def _boxes_meet(
    dx: float,
    dy: float,
    way: tuple[float, float],
    slack: float,
    first: tuple[float, float, float, float],
    second: tuple[float, float, float, float],
) -> bool:
    """Whether two boxes come together while the second moves by `way` relative to the first.

    Args:
        dx: From the first to the second [m].
        dy: The same.
        way: x, y [m].
        slack: What their turning may add [m].
        first: Cosine and sine of the heading, half length, half width [m].
        second: The same.
    """
    ci, si, long_i, wide_i = first
    cj, sj, long_j, wide_j = second
    along, across = abs(ci * cj + si * sj), abs(ci * sj - si * cj)
    return (
        _reaches(dx, dy, way, ci, si, slack + long_i + long_j * along + wide_j * across)
        and _reaches(dx, dy, way, -si, ci, slack + wide_i + long_j * across + wide_j * along)
        and _reaches(dx, dy, way, cj, sj, slack + long_j + long_i * along + wide_i * across)
        and _reaches(dx, dy, way, -sj, cj, slack + wide_j + long_i * across + wide_i * along)
    )


@kernel
def _reaches(dx: float, dy: float, way: tuple[float, float], nx: float, ny: float, radius: float) -> bool:
    """Whether the projections on the axis (nx, ny) come within `radius` on the way."""
    start = dx * nx + dy * ny
    end = start + way[0] * nx + way[1] * ny
    return min(start, end) <= radius and max(start, end) >= -radius


@kernel
def _mark_walls(
    motion: NDArray[np.uint8],
    pose: NDArray[np.float64],
    move: NDArray[np.float64],
    half: NDArray[np.float64],
    height: NDArray[np.float64],
    scratch: Scratch,
    walls: Walls,
    found: NDArray[np.bool_],
) -> None:
    """Adds to `found` whoever comes to a wall on its way."""
    bounds, first, entry, axis = walls.bounds, walls.first, walls.entry, scratch.axis
    (x0, y0), (columns, lines) = walls.origin, walls.shape
    for i in range(len(motion)):
        if not scratch.moves[i] or found[i] or motion[i] == WALKING:
            continue
        x, y, reach = pose[i, 0], pose[i, 1], scratch.reach[i]
        first_x = min(max(math.floor((x - reach - x0) / _WALL_CELL), 0), columns)
        last_x = min(math.floor((x + reach - x0) / _WALL_CELL), columns - 1)
        last_y = min(math.floor((y + reach - y0) / _WALL_CELL), lines - 1)
        for cy in range(max(math.floor((y - reach - y0) / _WALL_CELL), 0), last_y + 1):
            for k in range(first[cy * columns + first_x], first[cy * columns + last_x + 1]):
                w = entry[k]
                beside = x + reach < bounds[w, 0] or x - reach > bounds[w, 2]
                level = walls.z[w, 0] < height[i] + BODY_BAND[1] and walls.z[w, 1] > height[i] + BODY_BAND[0]
                if level and not beside and y + reach >= bounds[w, 1] and y - reach <= bounds[w, 3]:
                    slack = abs(move[i, 2]) * reach
                    box = axis[i, 0], axis[i, 1], half[i, 0] + slack, half[i, 1] + slack
                    corners = walls.corners[w, : walls.sides[w]]
                    found[i] = found[i] or _meets_polygon(x, y, (move[i, 0], move[i, 1]), box, corners)


@kernel
def _meets_polygon(
    x: float,
    y: float,
    way: tuple[float, float],
    box: tuple[float, float, float, float],
    corners: NDArray[np.float64],
) -> bool:
    """Whether a box (cosine, sine, half length, half width) at x, y comes to a convex polygon on its way."""
    cos, sin, half_length, half_width = box
    count = len(corners)
    for axis in range(2 + count):
        if axis == 0:
            nx, ny = cos, sin
        elif axis == 1:
            nx, ny = -sin, cos
        else:
            a, b = axis - 2, (axis - 1) % count
            nx, ny = corners[b, 1] - corners[a, 1], corners[a, 0] - corners[b, 0]
        low, high = np.inf, -np.inf
        for k in range(count):
            at = corners[k, 0] * nx + corners[k, 1] * ny
            low, high = min(low, at), max(high, at)
        radius = half_length * abs(cos * nx + sin * ny) + half_width * abs(cos * ny - sin * nx)
        start = x * nx + y * ny
        end = start + way[0] * nx + way[1] * ny
        if min(start, end) - radius > high or max(start, end) + radius < low:
            return False
    return True
