"""What shines: the glow of lamps in a picture, and the light that headlights and street lamps throw around."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.render.inlined import inlined
from lavsim.render.shadow import SPAN
from lavsim.render.solids import Material, Solids
from lavsim.types import Tag, VehicleLight

CELL = 0.5  # [m] of the map of light
_CELLS = round(SPAN / CELL)
_POOL = 14.0  # [m] reach of a street lamp
_BEAM = 36.0  # [m] reach of headlights
_POST = (5.5, 7.0)  # [m] heights of poles that are street lamps
_LAMP, _BODY = int(Material.LAMP), int(Material.BODY)
_BEAMS = int(VehicleLight.LOW_BEAM | VehicleLight.HIGH_BEAM)
_SHINES = int(VehicleLight.POSITION | VehicleLight.LOW_BEAM | VehicleLight.HIGH_BEAM)
_BRAKE, _FLASH = int(VehicleLight.BRAKE), int(VehicleLight.SPECIAL1 | VehicleLight.SPECIAL2)
_FARTHEST = 150.0  # [m] of lamps that glow


class LightMap(NamedTuple):
    """Light of lamps on the ground.

    Attributes:
        light: (C, C) float32, 1 right below a street lamp.
        x, y: Corner of cell (0, 0) [m].
    """

    light: NDArray[np.float32]
    x: float
    y: float


NO_LIGHT = LightMap(np.zeros((1, 1), np.float32), 0.0, 0.0)


def street_lamps(statics: Solids) -> NDArray[np.float64]:
    """(N, 3) tops of the poles that are street lamps, not masts of traffic lights."""
    tall = statics.z1 - statics.z0
    found = (statics.tag == Tag.POLE) & (tall > _POST[0]) & (tall < _POST[1]) & (statics.light < 0)
    return np.column_stack([statics.centre[found], statics.z1[found]])


def lamp_light(lamps: NDArray[np.float64], x: float, y: float) -> LightMap:
    """The light of street lamps on the grid with corner x, y."""
    grid = LightMap(np.zeros((_CELLS, _CELLS), np.float32), x, y)
    _add_pools(grid.light, lamps, x, y)
    return grid


def with_headlights(still: LightMap, actors: Solids) -> LightMap:
    """`still` with the headlights of all vehicles that have them on."""
    grid = still._replace(light=still.light.copy())
    _add_beams(grid.light, actors, grid.x, grid.y)
    return grid


@kernel
def _add_pools(light, lamps, x0, y0):  # type: ignore[no-untyped-def]
    size = len(light)
    for k in range(len(lamps)):
        x, y = (lamps[k, 0] - x0) / CELL, (lamps[k, 1] - y0) / CELL
        reach = _POOL / CELL
        for row in range(max(0, int(y - reach)), min(size, int(y + reach) + 1)):
            for column in range(max(0, int(x - reach)), min(size, int(x + reach) + 1)):
                dx, dy = (column + 0.5 - x) * CELL, (row + 0.5 - y) * CELL
                square = (dx * dx + dy * dy) / 25.0
                light[row, column] += np.float32(max(0.0, 1.0 / ((1.0 + square) * np.sqrt(1.0 + square)) - 0.04))


@kernel
def _add_beams(light, actors, x0, y0):  # type: ignore[no-untyped-def]
    size = len(light)
    for k in range(len(actors.radius)):
        if actors.material[k] != _BODY or not actors.state[k] & _BEAMS:
            continue
        ax, ay = (actors.xy[k, 0, 0] + actors.xy[k, 1, 0]) / 2.0, (actors.xy[k, 0, 1] + actors.xy[k, 1, 1]) / 2.0
        cx, cy = ax - actors.centre[k, 0], ay - actors.centre[k, 1]
        norm = max(np.sqrt(cx * cx + cy * cy), 1e-6)
        cx, cy = cx / norm, cy / norm
        mx, my = (ax + cx * _BEAM / 2.0 - x0) / CELL, (ay + cy * _BEAM / 2.0 - y0) / CELL
        reach = 0.75 * _BEAM / CELL
        for row in range(max(0, int(my - reach)), min(size, int(my + reach) + 1)):
            for column in range(max(0, int(mx - reach)), min(size, int(mx + reach) + 1)):
                dx, dy = x0 + (column + 0.5) * CELL - ax, y0 + (row + 0.5) * CELL - ay
                ahead = dx * cx + dy * cy
                if ahead <= 0.0 or ahead > _BEAM:
                    continue
                aside = (dy * cx - dx * cy) / (0.5 * ahead + 1.2)
                if abs(aside) < 1.0:
                    near = min(ahead, 4.0) / 4.0 / (1.0 + ahead * ahead / 300.0) * (1.0 - ahead / _BEAM)
                    light[row, column] += np.float32((1.0 - aside * aside) * near * 1.2)


@inlined
def light_at(light, x, y):  # type: ignore[no-untyped-def]
    """Light at a place from the corner of the grid, smooth between cells; 0 outside."""
    column, row = x * np.float32(1.0 / CELL) - np.float32(0.5), y * np.float32(1.0 / CELL) - np.float32(0.5)
    left, top, one, none = np.floor(column), np.floor(row), np.float32(1.0), np.float32(0.0)
    if top < none or left < none or top >= light.shape[0] - 1 or left >= light.shape[1] - 1:
        return none
    u, v, j, i, next_to = column - left, row - top, np.uint64(left), np.uint64(top), np.uint64(1)
    above = light[i, j] * (one - u) + light[i, j + next_to] * u
    below = light[i + next_to, j] * (one - u) + light[i + next_to, j + next_to] * u
    return above * (one - v) + below * v


@kernel
def add_glows(  # type: ignore[no-untyped-def]
    pixels, face, inverse, face_solid, statics, actors, lights, street, focal, origin, axes, night, blink
):
    """Adds halos to (H, W, 4) pixels: around lit lamps of traffic lights, and at night around those of vehicles."""
    for k in range(len(statics.radius)):
        if statics.material[k] != _LAMP:
            continue
        light = statics.light[k]
        if not 0 <= light < len(lights) or lights[light] != statics.state[k]:
            continue
        z = (statics.z0[k] + statics.z1[k]) / 2.0
        brightest = max(statics.colour[k, 0], max(statics.colour[k, 1], statics.colour[k, 2]))
        scale = (70.0 + 90.0 * night) / max(brightest, 1.0)
        colour = (statics.colour[k, 0] * scale, statics.colour[k, 1] * scale, statics.colour[k, 2] * scale)
        _glow(pixels, face, inverse, face_solid, k, statics.centre[k, 0], statics.centre[k, 1], z, 0.42, colour, focal,
              origin, axes)  # fmt: skip
    for k in range(len(actors.radius)):
        state = actors.state[k]
        if actors.material[k] != _BODY or not (state & _FLASH or (night > 0.3 and state & (_SHINES | _BRAKE))):
            continue
        z = actors.z0[k] + 0.68 * (actors.z1[k] - actors.z0[k])
        for end in range(2):
            a, b = (0, 1) if end == 0 else (2, 3)
            ax, ay, bx, by = actors.xy[k, a, 0], actors.xy[k, a, 1], actors.xy[k, b, 0], actors.xy[k, b, 1]
            if (by - ay) * (origin[0] - ax) - (bx - ax) * (origin[1] - ay) <= 0.0:
                continue  # it looks away
            colour, size = (0.0, 0.0, 0.0), 0.0
            if state & _FLASH and blink:
                colour, size = (40.0, 70.0, 200.0), 0.9
            elif night > 0.3 and end == 0 and state & _SHINES:
                colour, size = (150.0 * night, 145.0 * night, 125.0 * night), 0.6
            elif night > 0.3 and end == 1 and state & _BRAKE:
                colour, size = (130.0 * night, 14.0, 10.0), 0.5
            elif night > 0.3 and end == 1 and state & _SHINES:
                colour, size = (60.0 * night, 6.0, 5.0), 0.35
            for share in (0.1, 0.9):
                if size > 0.0:
                    x, y = ax + share * (bx - ax), ay + share * (by - ay)
                    _glow(pixels, face, inverse, face_solid, -1, x, y, z, size, colour, focal, origin, axes)
    if night > 0.3:
        for k in range(len(street)):
            colour = (170.0 * night, 140.0 * night, 90.0 * night)
            _glow(pixels, face, inverse, face_solid, -1, street[k, 0], street[k, 1], street[k, 2], 0.8, colour, focal,
                  origin, axes)  # fmt: skip


@lean_kernel
def _glow(  # type: ignore[no-untyped-def]
    pixels, face, inverse, face_solid, solid, x, y, z, size, colour, focal, origin, axes
):
    """One halo of `size` [m], if the lamp is in sight: its own face, or nothing nearer than it."""
    height, width = face.shape
    dx, dy, dz = x - origin[0], y - origin[1], z - origin[2]
    ahead = axes[0, 0] * dx + axes[1, 0] * dy + axes[2, 0] * dz
    if ahead < 1.0 or ahead > _FARTHEST:
        return
    column = width / 2.0 + focal * (axes[0, 1] * dx + axes[1, 1] * dy + axes[2, 1] * dz) / ahead
    row = height / 2.0 - focal * (axes[0, 2] * dx + axes[1, 2] * dy + axes[2, 2] * dz) / ahead
    if not (0.0 <= column < width and 0.0 <= row < height):
        return
    seen = face[int(row), int(column)]
    if solid >= 0:
        if seen < 0 or face_solid[seen] != solid:
            return
    elif inverse[int(row), int(column)] > 1.0 / max(ahead - 0.3, 0.1):
        return
    reach = min(max(focal * size / ahead, 1.5), 0.12 * width)
    for i in range(max(0, int(row - reach)), min(height, int(row + reach) + 1)):
        for j in range(max(0, int(column - reach)), min(width, int(column + reach) + 1)):
            far = np.sqrt((i + 0.5 - row) ** 2 + (j + 0.5 - column) ** 2) / reach
            if far < 1.0:
                share = (1.0 - far) * (1.0 - far)
                for c in range(3):
                    pixels[i, j, 2 - c] = np.uint8(min(255.0, pixels[i, j, 2 - c] + share * colour[c]))
