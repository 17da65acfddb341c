"""How high the ground lies: a grid of heights, and where a ray first meets it.

Heights stand at the corners of square cells, and each cell is two triangles, so the ground is one surface without
gaps that a mesh can repeat exactly. Blocks of cells know their lowest and highest corner; a ray passes over most of
them in one step. A level ground is no grid but a plane, which costs the kernels nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel

CELL = 1.0  # [m] between corners
BLOCK = 16  # cells along a block's side
_SHIFT = 4  # BLOCK = 1 << _SHIFT
_NUDGE = 1e-9  # cells a ray is pushed over a border, to be in the next cell
_FAR = 1e30  # runs of rays that never leave a row or column
_LEAST_STEP = 1e-7  # cells it goes ahead at least


class Heights(NamedTuple):
    """The ground's surface; beyond the grid its border goes on outward.

    Attributes:
        nodes: (R, C) float32 heights at y = y0 + row * CELL, x = x0 + column * CELL [m]. A cell is cut from its
            corner of least x and y to the opposite one.
        low, high: (BR, BC) float32 lowest and highest corner of each block of cells [m].
        x0, y0: Place of corner (0, 0) [m].
        top: Its highest place [m].
        level: Height where the ground is level [m].
        is_level: Whether it is level everywhere; then there is no grid.
    """

    nodes: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    x0: float
    y0: float
    top: float
    level: float
    is_level: bool


def level_ground(level: float = 0.0) -> Heights:
    """A plane."""
    one = np.full((1, 1), level, np.float32)
    return Heights(one, one, one, 0.0, 0.0, float(level), float(level), True)


LEVEL_GROUND = level_ground()


def heights_of(nodes: NDArray[np.float32], x0: float, y0: float) -> Heights:
    """The surface through `nodes` (R, C), at least 2 x 2."""
    blocks = [-(-(size - 1) // BLOCK) for size in nodes.shape]
    pad = [(0, count * BLOCK + 1 - size) for count, size in zip(blocks, nodes.shape, strict=True)]
    padded = np.pad(nodes.astype(np.float32), pad, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (BLOCK + 1, BLOCK + 1))[::BLOCK, ::BLOCK]
    low, high = windows.min(axis=(2, 3)), windows.max(axis=(2, 3))
    nodes = np.ascontiguousarray(nodes, np.float32)
    return Heights(nodes, low, high, float(x0), float(y0), float(high.max()), 0.0, False)


@lean_kernel
def _corners(nodes, i, j):  # type: ignore[no-untyped-def]
    """Heights of the corners of cell (column i, row j): least x and y, most x, most y, most of both."""
    rows, columns = nodes.shape
    a, b = min(max(i, 0), columns - 1), min(max(i + 1, 0), columns - 1)
    c, d = min(max(j, 0), rows - 1), min(max(j + 1, 0), rows - 1)
    return float(nodes[c, a]), float(nodes[c, b]), float(nodes[d, a]), float(nodes[d, b])


@lean_kernel
def _on_cell(corners, x, y):  # type: ignore[no-untyped-def]
    """Height at x, y in cells from a cell's first corner."""
    first, along_x, along_y, last = corners
    if x >= y:
        return first + (along_x - first) * x + (last - along_x) * y
    return first + (last - along_y) * x + (along_y - first) * y


@kernel
def height_at(heights, x, y):  # type: ignore[no-untyped-def]
    """Height of the ground at a world place [m]."""
    if heights.is_level:
        return heights.level
    x, y = (x - heights.x0) / CELL, (y - heights.y0) / CELL
    i, j = int(np.floor(x)), int(np.floor(y))
    return _on_cell(_corners(heights.nodes, i, j), x - i, y - j)


@kernel
def rise_at(heights, x, y):  # type: ignore[no-untyped-def]
    """Rise of the ground along x and y at a world place."""
    if heights.is_level:
        return 0.0, 0.0
    x, y = (x - heights.x0) / CELL, (y - heights.y0) / CELL
    i, j = int(np.floor(x)), int(np.floor(y))
    first, along_x, along_y, last = _corners(heights.nodes, i, j)
    if x - i >= y - j:
        return (along_x - first) / CELL, (last - along_x) / CELL
    return (last - along_y) / CELL, (along_y - first) / CELL


@kernel
def heights_at(heights, places):  # type: ignore[no-untyped-def]
    """(N,) heights of the ground at world `places` (N, 2) [m]."""
    found = np.empty(len(places))
    for n in range(len(places)):
        found[n] = height_at(heights, places[n, 0], places[n, 1])
    return found


@lean_kernel
def _leave(place, step, inverse, cell, size):  # type: ignore[no-untyped-def]
    """Run at which a ray that is at `place` + run * `step` leaves the span of `size` that starts at `cell`."""
    return (cell + size - place if step >= 0.0 else cell - place) * inverse


@lean_kernel
def _walk_cells(nodes, px, py, oz, dx, dy, over_dx, over_dy, rise, run, out):  # type: ignore[no-untyped-def]
    """Run (in cells) at which a ray goes below the ground between `run` and `out`; infinite if it stays above."""
    while run < out:
        i, j = int(np.floor(px + (run + _NUDGE) * dx)), int(np.floor(py + (run + _NUDGE) * dy))
        stop = min(_leave(px, dx, over_dx, i, 1), _leave(py, dy, over_dy, j, 1))
        stop = min(max(stop, run + _LEAST_STEP), out)
        corners = _corners(nodes, i, j)
        x, y = px - i, py - j
        before = oz + rise * run - _on_cell(corners, x + run * dx, y + run * dy)
        if before <= 0.0:
            return run
        middle = (y - x) / (dx - dy) if dx != dy else stop  # where it crosses the cell's diagonal
        if run < middle < stop:
            after = oz + rise * middle - _on_cell(corners, x + middle * dx, y + middle * dy)
            if after <= 0.0:
                return run + (middle - run) * before / (before - after)
            run, before = middle, after
        after = oz + rise * stop - _on_cell(corners, x + stop * dx, y + stop * dy)
        if after <= 0.0:
            return run + (stop - run) * before / (before - after)
        run = stop
    return np.inf


@lean_kernel
def meet_ground(heights, origin, headings, slopes, limits, carried, runs):  # type: ignore[no-untyped-def]
    """Fills `runs` with the horizontal runs [m] at which rays go below the ground; infinite if not before the limit.

    One call for many rays: passing arrays to a kernel costs as much as a short search.

    Args:
        heights: The ground, not level.
        origin: (3,) where the rays start [m].
        headings: (N, 2) of length 1.
        slopes: (N,) rise over run.
        limits: (N,) runs at which to give up [m]; negative for a ray that nobody asks about.
        carried: Share of a ray's run up to which the next one is above the ground too.
        runs: (N,) to fill.
    """
    nodes, low, high, top = heights.nodes, heights.low, heights.high, heights.top
    px, py, oz = (origin[0] - heights.x0) / CELL, (origin[1] - heights.y0) / CELL, origin[2]
    last_row, last_column = low.shape[0] - 1, low.shape[1] - 1
    known = 0.0
    # The plane that the last ray met: height base + tilt_x * x + tilt_y * y within `size` cells from left, above.
    base, tilt_x, tilt_y, left, above, size, half = 0.0, 0.0, 0.0, 0, 0, 0, 0
    for n in range(len(runs)):
        dx, dy, rise, end = headings[n, 0], headings[n, 1], slopes[n] * CELL, limits[n] / CELL
        run, met = carried * known, np.inf
        fall = rise - tilt_x * dx - tilt_y * dy
        if carried > 0.0 and size > 0 and fall < 0.0:
            again = (base + tilt_x * px + tilt_y * py - oz) / fall
            x, y = px + again * dx - left, py + again * dy - above
            if run <= again < end and 0.0 <= x < size and 0.0 <= y < size and (half == 0 or (x >= y) == (half == 1)):
                runs[n], known = again * CELL, again
                continue
        over_dx, over_dy = 1.0 / dx if dx != 0.0 else _FAR, 1.0 / dy if dy != 0.0 else _FAR
        if oz > top and rise < 0.0:
            run = max(run, (top - oz) / rise)
        while run < end:
            if rise >= 0.0 and oz + rise * run > top:
                break
            bi = int(np.floor(px + (run + _NUDGE) * dx)) >> _SHIFT
            bj = int(np.floor(py + (run + _NUDGE) * dy)) >> _SHIFT
            out = min(_leave(px, dx, over_dx, bi << _SHIFT, BLOCK), _leave(py, dy, over_dy, bj << _SHIFT, BLOCK))
            out = min(max(out, run + _LEAST_STEP), end)
            bi, bj = min(max(bi, 0), last_column), min(max(bj, 0), last_row)
            floor, roof = float(low[bj, bi]), float(high[bj, bi])
            if min(oz + rise * run, oz + rise * out) > roof:
                run = out
                continue
            if floor == roof:
                if oz + rise * run <= floor:
                    met = run
                elif oz + rise * out <= floor:
                    met = (floor - oz) / rise
                if met < np.inf:
                    base, tilt_x, tilt_y, size, half = floor, 0.0, 0.0, BLOCK, 0
                    left = (int(np.floor(px + (run + _NUDGE) * dx)) >> _SHIFT) << _SHIFT
                    above = (int(np.floor(py + (run + _NUDGE) * dy)) >> _SHIFT) << _SHIFT
                    break
            else:
                met = _walk_cells(nodes, px, py, oz, dx, dy, over_dx, over_dy, rise, run, out)
                if met < np.inf:
                    left, above, size = int(np.floor(px + met * dx)), int(np.floor(py + met * dy)), 1
                    first, along_x, along_y, last = _corners(nodes, left, above)
                    half = 1 if px + met * dx - left >= py + met * dy - above else 2
                    tilt_x = along_x - first if half == 1 else last - along_y
                    tilt_y = last - along_x if half == 1 else along_y - first
                    base = first - tilt_x * left - tilt_y * above
                    break
            run = out
        runs[n] = met * CELL
        if end >= 0.0:
            known = min(met, end)


@lean_kernel
def level_within(heights, x, y, reach):  # type: ignore[no-untyped-def]
    """The one height of the ground within `reach` of a place, NaN if it has several."""
    if heights.is_level:
        return heights.level
    rows, columns = heights.low.shape
    size = BLOCK * CELL
    left, right = int(np.floor((x - reach - heights.x0) / size)), int(np.floor((x + reach - heights.x0) / size))
    top, bottom = int(np.floor((y - reach - heights.y0) / size)), int(np.floor((y + reach - heights.y0) / size))
    level = heights.low[min(max(top, 0), rows - 1), min(max(left, 0), columns - 1)]
    for j in range(min(max(top, 0), rows - 1), min(max(bottom, 0), rows - 1) + 1):
        for i in range(min(max(left, 0), columns - 1), min(max(right, 0), columns - 1) + 1):
            if heights.low[j, i] != level or heights.high[j, i] != level:
                return np.nan
    return float(level)
