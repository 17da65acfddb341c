"""Colours of the look `fast`: one pass over the pixels after visibility is known, so each is shaded once.

A block of rows goes through four loops: places, ground cells, colours, and at last air, noise and packing. Only the
colours need branches; the others are done several pixels at a time.
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
from lavsim.render.look import SKY_STEPS, Look
from lavsim.render.paint import (
    BAYS,
    BLUE,
    BODY,
    FOLIAGE,
    GLOW,
    GREEN,
    LENGTH,
    MARGIN,
    OWN,
    PATTERN_RANGE,
    PLAIN,
    RED,
    SEED,
    START_X,
    START_Y,
    STOREYS,
    TANGENT_X,
    TANGENT_Y,
    WALL,
    Z0,
    Z1,
    body_swatch,
    face_table,
    is_blink_on,
    leaf_grain,
    panel_swatch,
    wall_swatch,
)  # fmt: skip
from lavsim.render.solids import Solids
from lavsim.render.terrain import Terrain
from lavsim.render.texture import cell_noise
from lavsim.render.zbuffer import Pinhole, Visibility

_NOISE_LENGTH, _LONGEST_ROW = 1 << 16, 8192
NOISE_UNIT = 32.0  # entries of the noise table a standard deviation
_GRAIN_RANGE = 30.0  # [m] beyond which grain, smaller than a pixel, fades
BLOCK = 4096  # [px] that go through the loops together, so that they stay in the nearest memory
_TEXEL = 2  # cells of ground a grain


class PaintedFaces(NamedTuple):
    """The painted faces of a view, as the colour kernels read them: columns of `face_table`."""

    table: NDArray[np.float32]
    material: NDArray[np.uint8]
    side: NDArray[np.uint8]
    state: NDArray[np.int32]


class Ground(NamedTuple):
    """Rasters of the ground and of bridges' decks, and where their first cells begin [m]."""

    classes: NDArray[np.uint8]
    x: float
    y: float
    deck: NDArray[np.uint8]
    deck_x: float
    deck_y: float
    per_metre: float


def ground_of(terrain: Terrain) -> Ground:
    """The rasters of a terrain."""
    ground, deck = terrain.raster, terrain.deck_raster
    return Ground(
        ground.classes, float(ground.origin[0]), float(ground.origin[1]), deck.classes, float(deck.origin[0]),
        float(deck.origin[1]), 1.0 / ground.resolution,
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
    """
    key, noise = (draws.key, look.noise) if draws is not None else (0, 0.0)
    pixels = _shade(
        view.face, view.inverse_depth, lens.focal, pose.origin, pose.axes, ground, look, faces, headlights,
        is_blink_on(tick), np.uint64(key), tick, np.float32(noise / NOISE_UNIT), NOISE,
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
    face, inverse_depth, focal, origin, axes, ground, look, faces, headlights, blink, key, tick, noise, noise_table
):
    height, width = face.shape
    pixels = np.empty(height * width, np.uint32)
    rows = max(1, BLOCK // width)
    place, paint = np.empty((4, rows * width), np.float32), np.empty((4, rows * width), np.float32)
    cells, grain = np.empty((2, rows * width), np.int32), np.empty(rows * width, np.float32)
    face, inverse, base = face.ravel(), inverse_depth.ravel(), draw_base(key, tick)
    for row in range(0, height, rows):
        begin, end = row * width, min(row + rows, height) * width
        place_block(inverse[begin:end], row, width, height, focal, origin, axes, place)
        cell_block(end - begin, place, ground, cells)
        _grain_block(end - begin, cells, place[2], grain)
        _colour_block(face[begin:end], inverse[begin:end], width, origin[2], axes[2, 1] == 0.0, place, cells, grain,
                      ground, look, faces, blink, paint)  # fmt: skip
        if headlights[3] > 0.0:
            _light_block(end - begin, headlights, place, paint)
        air_block(place[2], paint, look, noise, noise_table, draw_at(base, row), pixels[begin:end])
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


@lean_kernel
def cell_block(count, place, ground, cells):  # type: ignore[no-untyped-def]
    """Half cells of the ground raster under pixels."""
    x, y, column_of, row_of = place[0], place[1], cells[0], cells[1]
    corner_x, corner_y = np.float32(ground.x), np.float32(ground.y)
    scale = np.float32(2.0 * ground.per_metre)
    for i in range(count):
        column_of[i] = np.int32(np.floor((x[i] - corner_x) * scale))
        row_of[i] = np.int32(np.floor((y[i] - corner_y) * scale))


@lean_kernel
def _grain_block(count, cells, depth, grain):  # type: ignore[no-untyped-def]
    """Grain of the ground, -1 to 1, weaker far away."""
    column_of, row_of = cells[0], cells[1]
    reach, one = np.float32(_GRAIN_RANGE), np.float32(1.0)
    for i in range(count):
        grain[i] = cell_noise(column_of[i] >> _TEXEL, row_of[i] >> _TEXEL) * min(one, reach / depth[i])


@lean_kernel
def surface_of(classes, column, row):  # type: ignore[no-untyped-def]
    """`Surface` at a half cell; terrain outside the raster. As `surface_at`."""
    i, j = row >> 1, column >> 1
    if i < 0 or j < 0 or i >= classes.shape[0] or j >= classes.shape[1]:
        return 0
    cell = int(classes[i, j])
    if cell < 16:
        return cell
    quarter = (column & 1) + 2 * (row & 1)
    return 1 if (cell >> (4 + quarter)) & 1 else cell & 15


@lean_kernel
def _colour_block(  # type: ignore[no-untyped-def]
    face, inverse, width, height, is_level, place, cells, grain, ground, look, faces, blink, paint
):
    """Lit colours of pixels, and how much of each shines through fog."""
    one, none, is_night = np.float32(1.0), np.float32(0.0), look.night > 0.5
    # Each use of an array out of a tuple counts a reference, so they are taken out once.
    classes, deck, colours, sky, swatches = ground.classes, ground.deck, look.ground, look.sky, look.swatches
    table, material, side, state = faces.table, faces.material, faces.side, faces.state
    x, y, depth, rise, columns, rows = place[0], place[1], place[2], place[3], cells[0], cells[1]
    red_of, green_of, blue_of, glow_of = paint[0], paint[1], paint[2], paint[3]
    eye, done = np.float32(height), 0
    for i in range(len(face)):
        if i < done:
            continue
        f = face[i]
        if f >= 0:
            red, green, blue, glow = table[f, RED], table[f, GREEN], table[f, BLUE], table[f, GLOW]
            kind = material[f]
            if kind == PLAIN:
                done = _repeat(face, inverse, i, len(face), red, green, blue, glow, red_of, green_of, blue_of, glow_of)
                continue
            else:
                z = eye + depth[i] * rise[i]
                if kind == FOLIAGE:
                    leaf = one + leaf_grain(x[i], y[i], z) * min(one, np.float32(40.0) / depth[i])
                    red, green, blue = red * leaf, green * leaf, blue * leaf
                else:
                    along = (x[i] - table[f, START_X]) * table[f, TANGENT_X]
                    along += (y[i] - table[f, START_Y]) * table[f, TANGENT_Y]
                    high, tall, length = z - table[f, Z0], table[f, Z1] - table[f, Z0], table[f, LENGTH]
                    share = one
                    if kind == WALL:
                        swatch = wall_swatch(along - table[f, MARGIN], high, table[f, BAYS], table[f, STOREYS],
                                             int(table[f, SEED]), is_night)  # fmt: skip
                        share = max(none, one - depth[i] * np.float32(1.0 / PATTERN_RANGE))
                    elif kind == BODY:
                        swatch = body_swatch(along, high, length, tall, side[f], state[f], blink)
                    else:
                        swatch = panel_swatch(along, high / max(tall, np.float32(0.01)), length, kind)
                    if swatch != OWN:
                        glow = swatches[swatch, 3]
                        red += (swatches[swatch, 0] - red) * share
                        green += (swatches[swatch, 1] - green) * share
                        blue += (swatches[swatch, 2] - blue) * share
        elif inverse[i] > none:
            if f == DECK_FACE:
                scale = 2.0 * ground.per_metre
                surface = surface_of(deck, int(np.floor((x[i] - ground.deck_x) * scale)),
                                     int(np.floor((y[i] - ground.deck_y) * scale)))  # fmt: skip
            else:
                surface = surface_of(classes, columns[i], rows[i])
            light = one + colours[surface, 6] * grain[i]
            red, green, blue = colours[surface, 0] * light, colours[surface, 1] * light, colours[surface, 2] * light
            glow = none
        else:
            level = int(min(max(rise[i], none), one) * np.float32(SKY_STEPS - 1))
            red, green, blue, glow = sky[level, 0], sky[level, 1], sky[level, 2], one
            if is_level:
                done = _repeat(
                    face,
                    inverse,
                    i,
                    (i // width + 1) * width,
                    red,
                    green,
                    blue,
                    glow,
                    red_of,
                    green_of,
                    blue_of,
                    glow_of,
                )
                continue
        red_of[i], green_of[i], blue_of[i], glow_of[i] = red, green, blue, glow


@lean_kernel
def _repeat(  # type: ignore[no-untyped-def]
    face, inverse, begin, limit, red, green, blue, glow, red_of, green_of, blue_of, glow_of
):
    """Gives one colour to the pixels from `begin` on that show the same face, or the sky; where they end."""
    length, f = limit - begin, face[begin]
    face, inverse = face[begin:], inverse[begin:]
    count = 1
    if f >= 0:
        while count < length and face[count] == f:
            count += 1
    else:
        while count < length and inverse[count] <= np.float32(0.0):
            count += 1
    _fill(red_of[begin:], red, count)
    _fill(green_of[begin:], green, count)
    _fill(blue_of[begin:], blue, count)
    _fill(glow_of[begin:], glow, count)
    return begin + count


@lean_kernel
def _fill(values, value, count):  # type: ignore[no-untyped-def]
    for i in range(count):
        values[i] = value


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
