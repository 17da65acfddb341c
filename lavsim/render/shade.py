"""Colours of the look `fast`: one pass over the pixels after visibility is known, so each is shaded once.

A block of rows goes through three loops: places, colours, and at last air, noise and packing. Only the colours need
branches; the others are done several pixels at a time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.kernel_draws import draw_at, draw_base
from lavsim.random import Draws
from lavsim.render.faces import DECK_FACE
from lavsim.render.frame import Pose
from lavsim.render.ground import surface_at
from lavsim.render.inlined import inlined
from lavsim.render.look import SKY_STEPS, Look
from lavsim.render.paint import (
    BAY,
    BAYS,
    BLUE,
    BODY,
    FOLIAGE,
    GLOW,
    GREEN,
    LENGTH,
    LIT_WINDOW,
    MARGIN,
    OWN,
    PATTERN_RANGE,
    PLAIN,
    RED,
    SEED,
    START_X,
    START_Y,
    STOREY,
    STOREYS,
    TANGENT_X,
    TANGENT_Y,
    WALL,
    WINDOW,
    Z0,
    Z1,
    body_swatch,
    face_table,
    is_blink_on,
    panel_swatch,
)  # fmt: skip
from lavsim.render.solids import Solids
from lavsim.render.terrain import Terrain
from lavsim.render.texture import cell_noise
from lavsim.render.zbuffer import Pinhole, Visibility

_NOISE_LENGTH, _LONGEST_ROW = 1 << 16, 8192
NOISE_UNIT = 32.0  # entries of the noise table a standard deviation
_GRAIN_RANGE = 30.0  # [m] beyond which grain, smaller than a pixel, fades
BLOCK = 4096  # [px] that go through the loops together, so that they stay in the nearest memory
_GRAIN = 0.2  # [m] side of a grain
PADDING = 32  # [px] the loops over short runs of pixels go on for whole vectors


class PaintedFaces(NamedTuple):
    """The painted faces of a view, as the colour kernels read them: columns of `face_table`."""

    table: NDArray[np.float32]
    material: NDArray[np.uint8]
    side: NDArray[np.uint8]
    state: NDArray[np.int32]


class Ground(NamedTuple):
    """Rasters of the ground (row by row) and of bridges' decks, and where their first cells begin [m]."""

    classes: NDArray[np.uint8]
    rows: int
    columns: int
    x: float
    y: float
    deck: NDArray[np.uint8]
    deck_x: float
    deck_y: float
    per_metre: float


def ground_of(terrain: Terrain) -> Ground:
    """The rasters of a terrain."""
    ground, deck = terrain.raster, terrain.deck_raster
    rows, columns = ground.classes.shape
    return Ground(
        ground.classes.reshape(-1), rows, columns, float(ground.origin[0]), float(ground.origin[1]), deck.classes,
        float(deck.origin[0]), float(deck.origin[1]), 1.0 / ground.resolution,
    )  # fmt: skip


def faces_of(view: Visibility, statics: Solids, actors: Solids, look: Look, lights: NDArray[np.uint8]) -> PaintedFaces:
    """The painted faces of a view."""
    return PaintedFaces(*face_table(*view.faces, statics, actors, look, lights))


def shade(
    view: Visibility,
    lens: Pinhole,
    pose: Pose,
    faces: PaintedFaces,
    ground: Ground,
    look: Look,
    headlights: tuple[float, float, float, float],
    tick: int,
    draws: Draws | None,
    first_row: int = 0,
) -> NDArray[np.uint8]:
    """(H, W, 4) uint8 blue, green, red, alpha.

    Args:
        view, lens, pose: What a camera sees.
        faces: From `faces_of`.
        ground: From `ground_of`.
        look: The weather's.
        headlights: x, y, yaw of the ego, and the strength of its headlights (0 off).
        tick: For what blinks, and for the noise.
        draws: The camera's; without them there is no noise.
        first_row: Rows above this one are left as they come.
    """
    key, noise = (draws.key, look.noise) if draws is not None else (0, 0.0)
    pixels = _shade(
        view.face, view.inverse_depth, lens.focal, pose.origin, pose.axes, ground, look, faces, headlights,
        is_blink_on(tick), np.uint64(key), tick, (np.float32(noise / NOISE_UNIT), NOISE), first_row,
    )  # fmt: skip
    return pixels.view(np.uint8).reshape(lens.height, lens.width, 4)


def _noise_table() -> NDArray[np.int8]:
    """Gaussian numbers of deviation `NOISE_UNIT`; rows of pixels read on from drawn places."""
    values = np.rint(Draws.of_seed(0).stream("pixel noise").normal(0, _NOISE_LENGTH, std=NOISE_UNIT))
    values = np.clip(values, -127, 127).astype(np.int8)
    return np.concatenate([values, values[:_LONGEST_ROW]])


NOISE = _noise_table()


@kernel
def _shade(  # type: ignore[no-untyped-def]
    face, inverse_depth, focal, origin, axes, ground, look, faces, headlights, blink, key, tick, noise, first_row
):
    height, width = face.shape
    pixels = np.empty(height * width, np.uint32)
    rows = max(1, BLOCK // width)
    place, paint = np.ones((4, rows * width + PADDING), np.float32), np.empty((5, rows * width + PADDING), np.float32)
    cells = np.empty((2, rows * width), np.int32)
    face, inverse, base = face.ravel(), inverse_depth.ravel(), draw_base(key, tick)
    for row in range(first_row, height, rows):
        begin, end = row * width, min(row + rows, height) * width
        place_block(inverse[begin:end], row, width, height, focal, origin, axes, place)
        _colour_block(face[begin:end], inverse[begin:end], width, origin[2], axes[2, 1] == 0.0, place, cells,
                      ground, look, faces, blink, paint)  # fmt: skip
        if headlights[3] > 0.0:
            _light_block(end - begin, headlights, place, paint)
        air_block(place[2], paint, look, noise[0], noise[1], draw_at(base, row), pixels[begin:end])
    return pixels


@lean_kernel
def place_block(inverse, first_row, width, height, focal, origin, axes, place):  # type: ignore[no-untyped-def]
    """World x, y, depth [m] and rise over depth of pixels row by row; far away for the sky."""
    one, least, half = np.float32(1.0), np.float32(1e-4), (0.5 - width / 2.0) / focal
    ox, oy = np.float32(origin[0]), np.float32(origin[1])
    step_x, step_y = np.float32(axes[0, 1] / focal), np.float32(axes[1, 1] / focal)
    step_z = np.float32(axes[2, 1] / focal)
    for row in range(len(inverse) // width):
        v = (first_row + row + 0.5 - height / 2.0) / focal
        ray_x = np.float32(axes[0, 0] - v * axes[0, 2] + half * axes[0, 1])
        ray_y = np.float32(axes[1, 0] - v * axes[1, 2] + half * axes[1, 1])
        ray_z = np.float32(axes[2, 0] - v * axes[2, 2] + half * axes[2, 1])
        part = inverse[row * width : (row + 1) * width]
        x, y = place[0, row * width :][:width], place[1, row * width :][:width]
        depth, rise = place[2, row * width :][:width], place[3, row * width :][:width]
        for i in range(width):
            far = one / max(part[i], least)
            depth[i] = far
            x[i] = ox + far * (ray_x + step_x * np.float32(i))
            y[i] = oy + far * (ray_y + step_y * np.float32(i))
            rise[i] = ray_z + step_z * np.float32(i)


@inlined
def cell_run(begin, end, place, ground, cells):  # type: ignore[no-untyped-def]
    """Cells of the ground raster under pixels, -1 outside of it, and the quarters of them."""
    x, y, cell_of, quarter_of = place[0], place[1], cells[0], cells[1]
    corner_x, corner_y = np.float32(ground.x), np.float32(ground.y)
    scale, rows, columns = np.float32(2.0 * ground.per_metre), np.int32(ground.rows), np.int32(ground.columns)
    for i in range(np.uint64(begin), np.uint64(end)):
        half_x = np.int32(np.floor((x[i] - corner_x) * scale))
        half_y = np.int32(np.floor((y[i] - corner_y) * scale))
        column, row = half_x >> np.int32(1), half_y >> np.int32(1)
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        cell_of[i] = row * columns + column if inside else np.int32(-1)
        quarter_of[i] = (half_x & np.int32(1)) + np.int32(2) * (half_y & np.int32(1))


@inlined
def _grain_run(begin, end, place, grain):  # type: ignore[no-untyped-def]
    """Grain of the ground, -1 to 1, weaker far away."""
    x, y, depth = place[0], place[1], place[2]
    scale, reach, one = np.float32(1.0 / _GRAIN), np.float32(_GRAIN_RANGE), np.float32(1.0)
    for i in range(np.uint64(begin), np.uint64(end)):
        speck = cell_noise(np.int32(np.floor(x[i] * scale)), np.int32(np.floor(y[i] * scale)))
        grain[i] = speck * min(one, reach / depth[i])


@inlined
def surface_of(classes, cell, quarter):  # type: ignore[no-untyped-def]
    """`Surface` at a quarter of a cell; terrain outside the raster. As `surface_at`."""
    if cell < 0:
        return 0
    value = int(classes[cell])
    if value < 16:
        return value
    return 1 if (value >> (4 + quarter)) & 1 else value & 15


@inlined
def surface_below(i, f, place, cells, ground):  # type: ignore[no-untyped-def]
    """`Surface` that a pixel without a face shows: the ground's, or that of a bridge's deck."""
    if f == DECK_FACE:
        x, y = place[0, i] - ground.deck_x, place[1, i] - ground.deck_y
        return int(surface_at(ground.deck, x * ground.per_metre, y * ground.per_metre))
    return surface_of(ground.classes, cells[0, i], cells[1, i])


@inlined
def run_end(face, inverse, begin, limit):  # type: ignore[no-untyped-def]
    """Where the pixels end that show the same as the one at `begin`: a face, the ground, or the sky.

    Here and in the loops over runs, pixels are counted by unsigned numbers: signed ones, which could count from an
    array's back, keep the compiler from working on several pixels at a time.
    """
    f, end, limit = face[begin], np.uint64(begin), np.uint64(limit)
    if f >= 0:
        while end < limit and face[end] == f:
            end += np.uint64(1)
    elif inverse[begin] > np.float32(0.0):
        while end < limit and face[end] == f and inverse[end] > np.float32(0.0):
            end += np.uint64(1)
    else:
        while end < limit and face[end] < 0 and inverse[end] <= np.float32(0.0):
            end += np.uint64(1)
    return np.int64(end)


@lean_kernel
def _colour_block(  # type: ignore[no-untyped-def]
    face, inverse, width, height, is_level, place, cells, ground, look, faces, blink, paint
):
    """Lit colours of pixels, and how much of each shines through fog: run by run of what they show."""
    i = 0
    while i < len(face):
        begin, f = i, face[i]
        if f >= 0:
            i = run_end(face, inverse, begin, len(face))
            paint_face(begin, i, f, height, place, faces, look, blink, paint)
            if faces.material[f] == FOLIAGE:
                _grow_leaves(begin, i, height, place, paint)
        elif inverse[i] > np.float32(0.0):
            i = run_end(face, inverse, begin, len(face))
            _paint_ground(begin, i, f, place, cells, ground, look, paint)
        else:  # a row of a level picture shows one colour of the sky
            i = run_end(face, inverse, begin, (begin // width + 1) * width if is_level else begin + 1)
            level = sky_level(place[3, begin])
            _fill(begin, i, look.sky[level, 0], look.sky[level, 1], look.sky[level, 2], np.float32(1.0), paint)


@inlined
def sky_level(rise):  # type: ignore[no-untyped-def]
    """Row of the table of the sky."""
    return int(min(max(rise, np.float32(0.0)), np.float32(1.0)) * np.float32(SKY_STEPS - 1))


@inlined
def _fill(begin, end, red, green, blue, glow, paint):  # type: ignore[no-untyped-def]
    """One colour; each loop writes one array, so that none is checked for overlaps."""
    red_of, green_of, blue_of, glow_of = paint[0], paint[1], paint[2], paint[3]
    for n in range(np.uint64(begin), np.uint64(end)):
        red_of[n] = red
    for n in range(np.uint64(begin), np.uint64(end)):
        green_of[n] = green
    for n in range(np.uint64(begin), np.uint64(end)):
        blue_of[n] = blue
    for n in range(np.uint64(begin), np.uint64(end)):
        glow_of[n] = glow


@inlined
def _paint_ground(begin, end, f, place, cells, ground, look, paint):  # type: ignore[no-untyped-def]
    colours, red_of, green_of, blue_of, glow_of = look.ground, paint[0], paint[1], paint[2], paint[3]
    grain = paint[4]
    cell_run(begin, end, place, ground, cells)
    _grain_run(begin, end, place, grain)
    for n in range(np.uint64(begin), np.uint64(end)):
        surface = surface_below(n, f, place, cells, ground)
        light = np.float32(1.0) + colours[surface, 6] * grain[n]
        red_of[n], green_of[n] = colours[surface, 0] * light, colours[surface, 1] * light
        blue_of[n], glow_of[n] = colours[surface, 2] * light, np.float32(0.0)


@inlined
def paint_face(begin, end, f, eye, place, faces, look, blink, paint):  # type: ignore[no-untyped-def]
    """Colours of the pixels `begin` to `end`, which show face `f`, by the rule of its material."""
    table, kind = faces.table, faces.material[f]
    if kind == WALL:
        _open_windows(begin, end, table[f], np.float32(eye), place, look, paint)
        return
    _fill(begin, end, table[f, RED], table[f, GREEN], table[f, BLUE], table[f, GLOW], paint)
    if kind != PLAIN and kind != FOLIAGE:
        for n in range(np.uint64(begin), np.uint64(end)):
            along, high = along_face(n, table[f], place), np.float32(eye) + place[2, n] * place[3, n] - table[f, Z0]
            tall, length = table[f, Z1] - table[f, Z0], table[f, LENGTH]
            if kind == BODY:
                swatch = body_swatch(along, high, length, tall, faces.side[f], faces.state[f], blink)
            else:
                swatch = panel_swatch(along, high / max(tall, np.float32(0.01)), length, kind)
            if swatch != OWN:
                for c in range(4):
                    paint[c, n] = look.swatches[swatch, c]


@inlined
def along_face(n, row, place):  # type: ignore[no-untyped-def]
    """How far along the face of a row of the table a pixel lies [m]."""
    return (place[0, n] - row[START_X]) * row[TANGENT_X] + (place[1, n] - row[START_Y]) * row[TANGENT_Y]


@inlined
def _open_windows(begin, end, row, eye, place, look, paint):  # type: ignore[no-untyped-def]
    """Rows of windows in a wall, fainter far away; some are lit at night. Several pixels at a time."""
    x, y, depth, rise, pane_of = place[0], place[1], place[2], place[3], paint[4]
    start_x, start_y, tangent_x, tangent_y = row[START_X], row[START_Y], row[TANGENT_X], row[TANGENT_Y]
    margin, low, bays, storeys, seed = row[MARGIN], row[Z0], row[BAYS], row[STOREYS], np.int32(row[SEED])
    one, none, bright = np.float32(1.0), np.float32(0.0), np.float32(0.4 if look.night > 0.5 else 2.0)
    for n in range(np.uint64(begin), np.uint64(padded(begin, end))):
        along = (x[n] - start_x) * tangent_x + (y[n] - start_y) * tangent_y - margin
        high = eye + depth[n] * rise[n] - low
        bay, storey = np.int32(along * np.float32(1.0 / BAY)), np.int32(high * np.float32(1.0 / STOREY))
        across, up = along - np.float32(bay) * np.float32(BAY), high - np.float32(storey) * np.float32(STOREY)
        opens = (along >= none) & (along < bays) & (high >= none) & (high < storeys)
        opens &= (across > np.float32(0.75)) & (across < np.float32(2.25))
        opens &= (up > np.float32(0.95)) & (up < np.float32(2.5))
        share = max(none, one - depth[n] * np.float32(1.0 / PATTERN_RANGE)) if opens else none
        pane_of[n] = -share if cell_noise(seed + bay, storey) > bright else share
    dark, lit = look.swatches[WINDOW], look.swatches[LIT_WINDOW]
    for c in range(3):
        _blend(begin, end, row[RED + c], dark[c], lit[c], pane_of, paint[c])
    _blend(begin, end, none, none, lit[3], pane_of, paint[3])


@inlined
def padded(begin, end):  # type: ignore[no-untyped-def]
    """An end that makes whole steps of vectors; the runs that follow overwrite what is too much."""
    return begin + ((end - begin + PADDING - 1) & -PADDING)


@inlined
def _blend(begin, end, own, dark, lit, pane_of, colour_of):  # type: ignore[no-untyped-def]
    none = np.float32(0.0)
    for n in range(np.uint64(begin), np.uint64(padded(begin, end))):
        share = pane_of[n]
        other = (lit if share < none else dark) - own
        colour_of[n] = own + other * abs(share)


@inlined
def _grow_leaves(begin, end, eye, place, paint):  # type: ignore[no-untyped-def]
    """Leaves of lighter and darker green, fainter far away."""
    x, y, depth, rise, leaf_of = place[0], place[1], place[2], place[3], paint[4]
    eye, one, size = np.float32(eye), np.float32(1.0), np.float32(2.5)
    for n in range(np.uint64(begin), np.uint64(end)):
        z = eye + depth[n] * rise[n]
        cell = np.int32(np.floor(x[n] * size)) + np.int32(7919) * np.int32(np.floor(z * size))
        fade = np.float32(0.22) * min(one, np.float32(40.0) / depth[n])
        leaf_of[n] = one + cell_noise(cell, np.int32(np.floor(y[n] * size))) * fade
    for c in range(3):
        colour_of = paint[c]
        for n in range(np.uint64(begin), np.uint64(end)):
            colour_of[n] *= leaf_of[n]


@lean_kernel
def _light_block(count, headlights, place, paint):  # type: ignore[no-untyped-def]
    """Brightens what the ego's headlights reach and does not shine by itself."""
    cos_ego, sin_ego, strength = np.cos(headlights[2]), np.sin(headlights[2]), np.float32(headlights[3])
    for column in range(count):
        if paint[3, column] == 0.0:
            reach = headlight(place[0, column] - headlights[0], place[1, column] - headlights[1], cos_ego, sin_ego)
            for c in range(3):
                paint[c, column] *= np.float32(1.0) + strength * reach


@lean_kernel
def headlight(dx, dy, cos_ego, sin_ego):  # type: ignore[no-untyped-def]
    """Brightening of a place by a vehicle's headlights: a cone that falls off with distance."""
    ahead = dx * cos_ego + dy * sin_ego - 2.0
    if ahead <= 0.0:
        return np.float32(0.0)
    aside = (dy * cos_ego - dx * sin_ego) / (0.5 * ahead + 1.2)
    if abs(aside) >= 1.0:
        return np.float32(0.0)
    return np.float32((1.0 - aside * aside) * min(ahead, 4.0) / 4.0 / (1.0 + ahead * ahead / 400.0))


@lean_kernel
def air_block(depth, paint, look, noise, noise_table, word, pixels):  # type: ignore[no-untyped-def]
    """Fades colours into the haze, adds noise, and packs it as little-endian BGRA words."""
    width = len(pixels)
    red_of, green_of, blue_of, glow_of = paint[0], paint[1], paint[2], paint[3]
    noise_1 = noise_table[int(word & np.uint64(0xFFFF)) :][:width]
    noise_2 = noise_table[int((word >> np.uint64(16)) & np.uint64(0xFFFF)) :][:width]
    noise_3 = noise_table[int((word >> np.uint64(32)) & np.uint64(0xFFFF)) :][:width]
    haze_r, haze_g, haze_b = look.haze[0], look.haze[1], look.haze[2]
    one, none, top, half = np.float32(1.0), np.float32(0.0), np.float32(255.0), np.float32(0.5)
    air, fog, begin = look.air[0], look.air[1], look.air[2]
    part = np.float32(1.0 / 64.0)
    for i in range(width):
        loss = air * depth[i] + fog * max(depth[i] - begin, none)
        clear = max(one - loss * part, none)  # (1 - x / 64)^64 stands for exp(-x)
        clear *= clear
        clear *= clear
        clear *= clear
        clear *= clear
        clear *= clear
        clear *= clear
        clear += (one - clear) * glow_of[i]
        fade = one - clear
        red = red_of[i] * clear + haze_r * fade + noise * np.float32(noise_1[i]) + half
        green = green_of[i] * clear + haze_g * fade + noise * np.float32(noise_2[i]) + half
        blue = blue_of[i] * clear + haze_b * fade + noise * np.float32(noise_3[i]) + half
        r = np.int32(min(max(red, none), top))
        g = np.int32(min(max(green, none), top))
        b = np.int32(min(max(blue, none), top))
        pixels[i] = np.uint32(b | (g << np.int32(8)) | (r << np.int32(16))) | np.uint32(0xFF000000)
