"""Shadows of the sun: for each ray of sunlight how high it is stopped, on a grid around the ego.

A ray is named by where it would meet the plane z = 0, so one grid serves ground, walls and roofs: a point lies in
shadow if its ray is stopped above it. What stands still is drawn once for a sun and a place and kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.render.inlined import inlined
from lavsim.render.look import Look
from lavsim.render.solids import Solids

CELL = 0.25  # [m]
SPAN = 160.0  # [m] side of the grid
STEP = 16.0  # [m] the grid moves in such steps
_CELLS = round(SPAN / CELL)
_UNIT = 100.0  # entries a metre
_LOWEST = -32768
_FAINTEST = 0.06  # of sunlight, that still throws shadows
_BIAS = 0.12  # [m] a point is lit if its ray is stopped less than this above it


class ShadowMap(NamedTuple):
    """Where rays of sunlight end.

    Attributes:
        height: (C, C) int16 greatest height at which the rays of a cell are stopped [cm].
        x, y: Corner of cell (0, 0) on the plane z = 0 [m].
        slope_x, slope_y: Way of a ray over the plane for a metre of height, towards the sun.
        covers: Whether there is sun at all.
    """

    height: NDArray[np.int16]
    x: float
    y: float
    slope_x: float
    slope_y: float
    covers: bool


NO_SHADOWS = ShadowMap(np.full((1, 1), _LOWEST, np.int16), 0.0, 0.0, 0.0, 0.0, False)


def corner_of(x: float, y: float) -> tuple[float, float]:
    """Corner of the grid about a place."""
    return (
        float(np.floor((x - SPAN / 2.0) / STEP + 0.5) * STEP),
        float(np.floor((y - SPAN / 2.0) / STEP + 0.5) * STEP),
    )


def has_shadows(look: Look) -> bool:
    """Whether the sun is strong enough."""
    return float(look.sunlight.max()) > _FAINTEST


def static_shadows(statics: Solids, look: Look, x: float, y: float) -> ShadowMap:
    """The shadows of what stands still, on the grid with corner x, y."""
    slope = look.sun[:2].astype(np.float64) / float(look.sun[2])
    empty = ShadowMap(np.full((_CELLS, _CELLS), _LOWEST, np.int16), x, y, float(slope[0]), float(slope[1]), True)
    _cast(empty.height, x, y, empty.slope_x, empty.slope_y, statics)
    return empty


def with_actors(still: ShadowMap, actors: Solids) -> ShadowMap:
    """`still` with the shadows of `actors`."""
    grid = still._replace(height=still.height.copy())
    _cast(grid.height, grid.x, grid.y, grid.slope_x, grid.slope_y, actors)
    return grid


@kernel
def _cast(grid, x0, y0, slope_x, slope_y, solids):  # type: ignore[no-untyped-def]
    """Draws the sides that face the sun and the tops, along the rays onto the plane."""
    xy, count, z0, z1, centre, radius = solids.xy, solids.corners, solids.z0, solids.z1, solids.centre, solids.radius
    lean = np.sqrt(slope_x * slope_x + slope_y * slope_y)
    outline = np.empty((8, 3))
    span = len(grid) * CELL
    for k in range(len(radius)):
        reach = radius[k] + lean * abs(z1[k] - z0[k])
        x, y = centre[k, 0] - slope_x * z1[k], centre[k, 1] - slope_y * z1[k]
        if x + reach < x0 or y + reach < y0 or x - reach > x0 + span or y - reach > y0 + span:
            continue
        n = count[k]
        for e in range(n):
            f = e + 1 if e + 1 < n else 0
            ax, ay, bx, by = xy[k, e, 0], xy[k, e, 1], xy[k, f, 0], xy[k, f, 1]
            if (by - ay) * slope_x - (bx - ax) * slope_y <= 1e-9:
                continue
            for corner in range(4):
                px, py = (ax, ay) if corner == 0 or corner == 3 else (bx, by)
                z = z0[k] if corner < 2 else z1[k]
                outline[corner, 0], outline[corner, 1] = (px - slope_x * z - x0) / CELL, (py - slope_y * z - y0) / CELL
                outline[corner, 2] = z
            _raise_polygon(grid, outline, 4)
        for e in range(n):
            outline[e, 0] = (xy[k, e, 0] - slope_x * z1[k] - x0) / CELL
            outline[e, 1] = (xy[k, e, 1] - slope_y * z1[k] - y0) / CELL
            outline[e, 2] = z1[k]
        _raise_polygon(grid, outline, n)


@lean_kernel
def _raise_polygon(grid, outline, n):  # type: ignore[no-untyped-def]
    """Raises the cells whose centres lie in a convex polygon (x, y, height) to the plane through its corners."""
    ux, uy, uz = outline[1, 0] - outline[0, 0], outline[1, 1] - outline[0, 1], outline[1, 2] - outline[0, 2]
    vx, vy, vz = outline[n - 1, 0] - outline[0, 0], outline[n - 1, 1] - outline[0, 1], outline[n - 1, 2] - outline[0, 2]
    area = ux * vy - uy * vx
    if abs(area) < 1e-9:
        return
    along_x, along_y = (uz * vy - uy * vz) / area, (ux * vz - uz * vx) / area
    top, bottom = np.inf, -np.inf
    for e in range(n):
        top, bottom = min(top, outline[e, 1]), max(bottom, outline[e, 1])
    first, last = int(max(0.0, np.ceil(top - 0.5))), int(min(float(len(grid)), np.ceil(bottom - 0.5)))
    for row in range(first, last):
        left, right, y = np.inf, -np.inf, row + 0.5
        for e in range(n):
            f = e + 1 if e + 1 < n else 0
            a, b = (e, f) if outline[e, 1] <= outline[f, 1] else (f, e)
            if outline[a, 1] <= y < outline[b, 1]:
                share = (y - outline[a, 1]) / (outline[b, 1] - outline[a, 1])
                x = outline[a, 0] + share * (outline[b, 0] - outline[a, 0])
                left, right = min(left, x), max(right, x)
        begin, end = int(max(0.0, np.ceil(left - 0.5))), int(min(float(grid.shape[1]), np.ceil(right - 0.5)))
        base = outline[0, 2] + along_y * (y - outline[0, 1]) - along_x * outline[0, 0]
        for column in range(begin, end):
            height = np.int16(min(max((base + along_x * (column + 0.5)) * _UNIT, -32767.0), 32767.0))
            grid[row, column] = max(grid[row, column], height)


@inlined
def sun_share(height, corner_x, corner_y, slope_x, slope_y, x, y, z):  # type: ignore[no-untyped-def]
    """Share of the sun that reaches a point, soft over a cell; 1 outside the grid."""
    column = (x - slope_x * z - corner_x) * np.float32(1.0 / CELL) - np.float32(0.5)
    row = (y - slope_y * z - corner_y) * np.float32(1.0 / CELL) - np.float32(0.5)
    left, above = np.floor(column), np.floor(row)
    one, none = np.float32(1.0), np.float32(0.0)
    if above < none or left < none or above >= height.shape[0] - 1 or left >= height.shape[1] - 1:
        return one
    u, v, j, i, next_to = column - left, row - above, np.uint64(left), np.uint64(above), np.uint64(1)
    limit = np.int32(np.floor((z + np.float32(_BIAS)) * np.float32(_UNIT)))
    share = (one - u) * (one - v) if height[i, j] <= limit else none
    share += u * (one - v) if height[i, j + next_to] <= limit else none
    share += (one - u) * v if height[i + next_to, j] <= limit else none
    share += u * v if height[i + next_to, j + next_to] <= limit else none
    return share
