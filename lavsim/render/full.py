"""Colours of the look `full`: that of `fast` with shadows, texture, wet mirrors, the light of lamps, clouds and rain.

Noise and texture belong to places and weather, rain to camera and tick, so a picture is the same whenever it is drawn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.kernel_draws import draw_at, draw_base
from lavsim.random import Draws
from lavsim.render.frame import Pose
from lavsim.render.ground import Surface
from lavsim.render.inlined import inlined
from lavsim.render.lamps import LightMap, light_at
from lavsim.render.look import Look
from lavsim.render.paint import BODY, DARK, FOLIAGE, SEED, WALL, Z0, Z1, is_blink_on
from lavsim.render.shade import (
    BLOCK,
    NOISE,
    NOISE_UNIT,
    PADDING,
    Ground,
    PaintedFaces,
    air_block,
    along_face,
    cell_run,
    paint_face,
    place_block,
    run_end,
    sky_level,
    surface_below,
)
from lavsim.render.shadow import ShadowMap, sun_share
from lavsim.render.texture import HOLLOWS, SMOOTH, cell_noise, patch_noise, smooth_noise
from lavsim.render.zbuffer import Pinhole, Visibility

_TERRAIN, _MEDIAN, _SIDEWALK = int(Surface.TERRAIN), int(Surface.MEDIAN), int(Surface.SIDEWALK)
_FIRST_PAINT, _LAST_PAINT = int(Surface.CROSSWALK), int(Surface.YELLOW_BROKEN)
_LAMP_LIGHT = 4.2  # brightening of what lies below a street lamp, at night
_SLAB = 1.5  # [m] of sidewalks
_SEAM_RANGE = 25.0  # [m] of seams in the asphalt
_COURSE = 0.45  # [m] between the joints of a wall
_CLOUD_STEP = 4  # [px] between the places of a row where clouds are worked out
_DROPS = 1.0 / 700.0  # streaks of rain a pixel in the heaviest rain


class Surroundings(NamedTuple):
    """What the kernel needs beside the faces: shadows, lamps, and a picture of what wet ground mirrors.

    Attributes:
        shadows: Of the sun.
        lamps: Light of lamps on the ground.
        mirror: (H / 2, W / 2, 4) uint8 of the mirrored camera, a single pixel if nothing is wet.
        mirrors: Whether anything is.
    """

    shadows: ShadowMap
    lamps: LightMap
    mirror: NDArray[np.uint8]
    mirrors: bool


_TABLES = (NOISE, SMOOTH, HOLLOWS)
NO_MIRROR: NDArray[np.uint8] = np.zeros((1, 1, 4), np.uint8)


def shade_full(
    view: Visibility,
    lens: Pinhole,
    pose: Pose,
    faces: PaintedFaces,
    ground: Ground,
    look: Look,
    surroundings: Surroundings,
    tick: int,
    draws: Draws | None,
) -> NDArray[np.uint8]:
    """(H, W, 4) uint8 blue, green, red, alpha; arguments as of `lavsim.render.shade.shade`."""
    key, noise = (draws.key, look.noise) if draws is not None else (0, 0.0)
    pixels = _shade(
        view.face, view.inverse_depth, lens.focal, pose.origin, pose.axes, ground, look, faces, surroundings,
        is_blink_on(tick), np.uint64(key), tick, np.float32(noise / NOISE_UNIT), _TABLES,
    )  # fmt: skip
    image = pixels.view(np.uint8).reshape(lens.height, lens.width, 4)
    if look.rain > 0.0:
        _add_rain(image, look, np.uint64(key), tick)
    return image


@kernel
def _shade(  # type: ignore[no-untyped-def]
    face, inverse_depth, focal, origin, axes, ground, look, faces, around, blink, key, tick, noise, tables
):
    height, width = face.shape
    noise_table, smooth, hollows = tables
    pixels = np.empty(height * width, np.uint32)
    rows = max(1, BLOCK // width)
    place, paint = np.ones((4, rows * width + PADDING), np.float32), np.empty((5, rows * width + PADDING), np.float32)
    cells, light = np.empty((2, rows * width), np.int32), np.empty((2, rows * width), np.float32)
    face, inverse, base = face.ravel(), inverse_depth.ravel(), draw_base(key, tick)
    for row in range(0, height, rows):
        begin, end = row * width, min(row + rows, height) * width
        place_block(inverse[begin:end], row, width, height, focal, origin, axes, place)
        _light_block(face[begin:end], inverse[begin:end], origin[2], place, look, faces, around, light)
        _colour_block(face[begin:end], inverse[begin:end], row, width, origin, place, cells, light, ground, look,
                      faces, around, blink, tick, smooth, hollows, paint)  # fmt: skip
        air_block(place[2], paint, look, noise, noise_table, draw_at(base, row), pixels[begin:end])
    return pixels


@lean_kernel
def _light_block(face, inverse, eye, place, look, faces, around, light):  # type: ignore[no-untyped-def]
    """Share of the sun that reaches each pixel's place, and the light of lamps there."""
    sun_of, lamp_of, one, none = light[0], light[1], np.float32(1.0), np.float32(0.0)
    x, y, depth, rise = place[0], place[1], place[2], place[3]
    shadow, lamp, lamps = around.shadows.height, np.float32(_LAMP_LIGHT * look.night), around.lamps.light
    shadow_x, shadow_y = np.float32(around.shadows.x), np.float32(around.shadows.y)
    slope_x, slope_y = np.float32(around.shadows.slope_x), np.float32(around.shadows.slope_y)
    lamp_x, lamp_y, eye = np.float32(around.lamps.x), np.float32(around.lamps.y), np.float32(eye)
    if not around.shadows.covers:
        sun_of[: len(face)] = one
    if lamp <= none:
        lamp_of[: len(face)] = none
    for i in range(len(face)):
        if inverse[i] <= none:
            continue
        z = eye + depth[i] * rise[i]
        if around.shadows.covers:
            if face[i] >= 0 and faces.table[face[i], DARK] >= one:  # it looks away from the sun
                sun_of[i] = one
            else:
                sun_of[i] = sun_share(shadow, shadow_x, shadow_y, slope_x, slope_y, x[i], y[i], z)
        if lamp > none:
            height = z if face[i] >= 0 else none
            fall = min(one, max(np.float32(0.15), np.float32(1.4) - np.float32(0.25) * height))
            lamp_of[i] = lamp * fall * light_at(lamps, x[i] - lamp_x, y[i] - lamp_y)


@lean_kernel
def _colour_block(  # type: ignore[no-untyped-def]
    face,
    inverse,
    first_row,
    width,
    origin,
    place,
    cells,
    light,
    ground,
    look,
    faces,
    around,
    blink,
    tick,
    smooth,
    hollows,
    paint,
):
    i = 0
    while i < len(face):
        begin, f = i, face[i]
        if f >= 0:
            i = run_end(face, inverse, begin, len(face))
            paint_face(begin, i, f, origin[2], place, faces, look, blink, paint)
            _texture_face(begin, i, f, np.float32(origin[2]), place, faces, look, smooth, paint)
            _light_face(begin, i, faces.table[f], light, paint)
        elif inverse[i] > np.float32(0.0):
            i = run_end(face, inverse, begin, len(face))
            _paint_ground(begin, i, f, place, cells, light, ground, look, smooth, paint)
            if around.mirrors:
                _mirror(begin, i, first_row, width, place, look, around.mirror, tick, hollows, paint)
        else:
            i = run_end(face, inverse, begin, (begin // width + 1) * width)
            _paint_sky(begin, i, origin, place, look, smooth, paint)


@inlined
def _texture_face(begin, end, f, eye, place, faces, look, smooth, paint):  # type: ignore[no-untyped-def]
    row, kind, one = faces.table[f], faces.material[f], np.float32(1.0)
    if kind != WALL and kind != FOLIAGE and kind != BODY:
        return
    tall, seed = max(row[Z1] - row[Z0], np.float32(0.1)), np.int32(row[SEED])
    for n in range(np.uint64(begin), np.uint64(end)):
        if paint[3, n] != np.float32(0.0):
            continue
        z = eye + place[2, n] * place[3, n]
        if kind == FOLIAGE:
            grain = _leaves(place[0, n], place[1, n], z, place[2, n], smooth)
        elif kind == BODY:
            grain = np.float32(0.82) + np.float32(0.3) * min(one, (z - row[Z0]) / tall)
        else:
            along = along_face(n, row, place)
            if paint[4, n] != np.float32(0.0):  # panes show more or less of the sky
                grain = one + np.float32(0.25) * cell_noise(np.int32(along) + seed, np.int32(z - row[Z0]))
            else:
                grain = _wall(along, z - row[Z0], place[2, n], seed, smooth)
        for c in range(3):
            paint[c, n] *= grain


@inlined
def _light_face(begin, end, row, light, paint):  # type: ignore[no-untyped-def]
    """Shadow and lamp light on what does not shine by itself; several pixels at a time."""
    glow_of, sun, lamp, one, none = paint[3], light[0], light[1], np.float32(1.0), np.float32(0.0)
    for c in range(3):
        colour_of, loss = paint[c], one - row[DARK + c]
        hue = one if c == 0 else np.float32(0.9) if c == 1 else np.float32(0.68)
        for n in range(np.uint64(begin), np.uint64(end)):
            factor = (one - loss * (one - sun[n])) * (one + lamp[n] * hue)
            colour_of[n] *= factor if glow_of[n] == none else one


@inlined
def _paint_ground(begin, end, f, place, cells, light, ground, look, smooth, paint):  # type: ignore[no-untyped-def]
    colours, one = look.ground, np.float32(1.0)
    cell_run(begin, end, place, ground, cells)
    for n in range(np.uint64(begin), np.uint64(end)):
        surface = surface_below(n, f, place, cells, ground)
        grain, dark, lit = (
            _grain(surface, place[0, n], place[1, n], place[2, n], smooth),
            one - light[0, n],
            light[1, n],
        )
        paint[0, n] = colours[surface, 0] * grain * (one - (one - colours[surface, 3]) * dark) * (one + lit)
        green = colours[surface, 1] * grain * (one - (one - colours[surface, 4]) * dark)
        paint[1, n] = green * (one + lit * np.float32(0.9))
        blue = colours[surface, 2] * grain * (one - (one - colours[surface, 5]) * dark)
        paint[2, n], paint[3, n] = blue * (one + lit * np.float32(0.68)), np.float32(0.0)
        paint[4, n] = np.float32(0.0) if surface in (_TERRAIN, _MEDIAN) else one  # whether it mirrors when wet


@inlined
def _mirror(  # type: ignore[no-untyped-def]
    begin, end, first_row, width, place, look, mirror, tick, hollows, paint
):
    """Mixes what wet ground mirrors into its colours, row by row; grass mirrors nothing."""
    wet, puddles, ripple = np.float32(look.wet), np.float32(look.puddles), np.float32(3.0 * look.rain)
    nine, none, last_row = np.float32(9.0), np.float32(0.0), 2 * mirror.shape[0] - 1
    x_of, y_of, rise, mirrors, ticks = place[0], place[1], place[3], paint[4], np.int32(tick * 31)
    for row in range(begin // width, (end - 1) // width + 1):
        left, middle = row * width, first_row + row
        for n in range(np.uint64(max(begin, left)), np.uint64(min(end, left + width))):
            if mirrors[n] == none:
                continue
            x, y = x_of[n], y_of[n]
            share, blur = _mirror_share(x, y, -rise[n], wet, puddles, hollows)
            shift = cell_noise(np.int32(x * nine) + ticks, np.int32(y * nine)) * (blur + ripple)
            seen = np.uint64(min(max(middle + np.int64(shift), 0), last_row) >> 1)
            column = (n - np.uint64(left)) >> np.uint64(1)
            for c in range(3):
                paint[c, n] += (np.float32(mirror[seen, column, 2 - c]) - paint[c, n]) * share


@inlined
def _paint_sky(begin, end, origin, place, look, smooth, paint):  # type: ignore[no-untyped-def]
    """Part of a row of sky; clouds are worked out every few pixels and change evenly in between."""
    clouds, white, none = np.float32(1.7 * look.clouds - 0.75), np.float32(1.04), np.float32(0.0)
    x, y, rise, near = place[0], place[1], place[3], np.float32(1.0) / place[2, np.uint64(begin)]
    eye_x, eye_y = np.float32(origin[0]), np.float32(origin[1])
    red_of, green_of, blue_of, glow_of = paint[0], paint[1], paint[2], paint[3]
    at = np.uint64(begin)
    ray_x, ray_y = (x[at] - eye_x) * near, (y[at] - eye_y) * near
    ahead = _cloud(ray_x, ray_y, rise[at], clouds, smooth)
    sun_ahead = _sun(ray_x, ray_y, rise[at], look.sun, look.sunlight)
    for first in range(begin, end, _CLOUD_STEP):
        last, level = min(first + _CLOUD_STEP, end), np.uint64(sky_level(rise[first]))
        cloud, sun, at = ahead, sun_ahead, np.uint64(min(last, end - 1))
        ray_x, ray_y = (x[at] - eye_x) * near, (y[at] - eye_y) * near
        ahead = _cloud(ray_x, ray_y, rise[at], clouds, smooth)
        sun_ahead = _sun(ray_x, ray_y, rise[at], look.sun, look.sunlight)
        step = (ahead - cloud) / np.float32(last - first)
        red, green, blue = look.sky[level, 0], look.sky[level, 1], look.sky[level, 2]
        more_red, more_green = look.haze[0] * white - red, look.haze[1] * white - green
        more_blue = look.haze[2] * white - blue
        for n in range(np.uint64(first), np.uint64(last)):
            red_of[n], green_of[n] = red + more_red * cloud, green + more_green * cloud
            blue_of[n], glow_of[n] = blue + more_blue * cloud, np.float32(1.0)
            cloud += step
        if sun > none or sun_ahead > none:
            clear = np.float32(1.0) - (cloud - step * np.float32(last - first))  # what the clouds leave of the sun
            for n in range(np.uint64(first), np.uint64(last)):
                ray_x, ray_y = (x[n] - eye_x) * near, (y[n] - eye_y) * near
                shine = np.float32(255.0) * max(clear, none) * _sun(ray_x, ray_y, rise[n], look.sun, look.sunlight)
                clear -= step
                for c in range(3):
                    paint[c, n] += shine * look.sunlight[c]


@inlined
def _cloud(ray_x, ray_y, rise, clouds, smooth):  # type: ignore[no-untyped-def]
    """Share of cloud in a direction: two sizes of patches on a plane above, gone at the horizon."""
    if rise < np.float32(0.01):
        return np.float32(0.0)
    scale = np.float32(0.9) / (rise + np.float32(0.12))
    u, v = ray_x * scale, ray_y * scale
    patch = np.float32(0.65) * smooth_noise(smooth, u * np.float32(1.7), v * np.float32(1.7))
    patch += np.float32(0.35) * smooth_noise(smooth, u * np.float32(5.1) + np.float32(7.0), v * np.float32(5.1))
    cover = (patch + clouds) * np.float32(1.8)
    return min(max(cover, np.float32(0.0)), np.float32(0.85)) * min(np.float32(1.0), rise * np.float32(8.0))


@inlined
def _sun(ray_x, ray_y, rise, sun, sunlight):  # type: ignore[no-untyped-def]
    """Brightness of the sun's disc and of the halo about it."""
    if sunlight[0] < np.float32(0.05):
        return np.float32(0.0)
    square, along = ray_x * ray_x + ray_y * ray_y + rise * rise, ray_x * sun[0] + ray_y * sun[1] + rise * sun[2]
    if along <= np.float32(0.0) or along * along < np.float32(0.81) * square:
        return np.float32(0.0)
    cosine = along / np.sqrt(square)
    near = (cosine - np.float32(0.9)) * np.float32(10.0)
    near *= near
    near *= near
    return np.float32(0.5) * near + (np.float32(1.0) if cosine > np.float32(0.9996) else np.float32(0.0))


@inlined
def _grain(surface, x, y, depth, smooth):  # type: ignore[no-untyped-def]
    """Brightness of a place of ground: blades, stones, patches, joints; what is smaller than a pixel fades."""
    one = np.float32(1.0)
    fine, wide = min(one, np.float32(14.0) / depth), min(one, np.float32(60.0) / depth)
    speck = cell_noise(np.int32(np.floor(x * np.float32(16.0))), np.int32(np.floor(y * np.float32(16.0)))) * fine
    if surface == _SIDEWALK:
        u, v = x * np.float32(1.0 / _SLAB), y * np.float32(1.0 / _SLAB)
        floor_u, floor_v, half = np.floor(u), np.floor(v), np.float32(0.5)
        edge = half - max(abs(u - floor_u - half), abs(v - floor_v - half))
        joint = np.float32(0.16) * fine if edge < np.float32(0.02) else np.float32(0.0)
        slab = cell_noise(np.int32(floor_u), np.int32(floor_v))
        return one + np.float32(0.04) * speck + np.float32(0.05) * slab * wide - joint
    patch = patch_noise(smooth, x * np.float32(0.23), y * np.float32(0.23)) * wide
    if surface in (_TERRAIN, _MEDIAN):
        tuft = patch_noise(smooth, x * np.float32(1.9), y * np.float32(1.9)) * fine
        return one + np.float32(0.16) * speck + np.float32(0.12) * tuft + np.float32(0.12) * patch
    worn = np.float32(0.10) if _FIRST_PAINT <= surface <= _LAST_PAINT else np.float32(0.07)
    seam = np.float32(0.0)
    if depth < np.float32(_SEAM_RANGE):
        crack = smooth_noise(smooth, x * np.float32(0.31) + np.float32(11.0), y * np.float32(0.31))
        seam = np.float32(0.10) * fine if abs(crack) < np.float32(0.009) else seam
    return one + worn * speck + np.float32(0.07) * patch - seam


@inlined
def _leaves(x, y, z, depth, smooth):  # type: ignore[no-untyped-def]
    """Brightness of foliage: clumps and single leaves."""
    one, size = np.float32(1.0), np.float32(7.0)
    clump_x, clump_y = x * np.float32(1.6) + z * np.float32(1.3), y * np.float32(1.6) - z * np.float32(1.9)
    cell = np.int32(np.floor(x * size)) + np.int32(7919) * np.int32(np.floor(z * size))
    leaf = cell_noise(cell, np.int32(np.floor(y * size))) * min(one, np.float32(20.0) / depth)
    return one + np.float32(0.22) * patch_noise(smooth, clump_x, clump_y) + np.float32(0.22) * leaf


@inlined
def _wall(along, high, depth, seed, smooth):  # type: ignore[no-untyped-def]
    """Brightness of a wall: courses, stains, and a foot that is darker."""
    one, none = np.float32(1.0), np.float32(0.0)
    stain = patch_noise(smooth, along * np.float32(0.5) + np.float32(seed & 31), high * np.float32(0.35))
    fine, near, nine = min(one, np.float32(18.0) / depth), min(one, np.float32(7.0) / depth), np.float32(9.0)
    course = high * np.float32(1.0 / _COURSE) + np.float32(0.5)
    is_joint = abs(course - np.floor(course) - np.float32(0.5)) < np.float32(0.06)
    joint = np.float32(0.08) * near * near if is_joint else none  # of less than a pixel it would make a moiré
    speck = cell_noise(np.int32(np.floor(along * nine)) + seed, np.int32(np.floor(high * nine))) * fine
    foot = np.float32(0.15) if high < np.float32(0.5) else none
    return one + np.float32(0.07) * stain + np.float32(0.035) * speck - joint - foot


@inlined
def _mirror_share(x, y, drop, wet, puddles, hollows):  # type: ignore[no-untyped-def]
    """Share of light that wet ground mirrors, and by how many rows the picture is smeared.

    Args:
        x, y: The place [m].
        drop: Fall of the ray over its length along the optical axis.
        wet, puddles: 0 to 1.
        hollows: `HOLLOWS`.
    """
    one, none, wide = np.float32(1.0), np.float32(0.0), np.float32(0.27)
    steep = min(max(drop, np.float32(0.0)), one)
    grazing = (one - steep) * (one - steep)
    fresnel = np.float32(0.04) + np.float32(0.96) * grazing * grazing * (one - steep)
    if puddles > none and smooth_noise(hollows, x * wide, y * wide) > np.float32(0.62) - np.float32(0.75) * puddles:
        return np.float32(0.18) + np.float32(0.62) * fresnel, none
    return wet * np.float32(0.5) * fresnel, np.float32(5.0)


@kernel
def _add_rain(image, look, key, tick):  # type: ignore[no-untyped-def]
    """Streaks of drops, each a little lighter than what is behind it."""
    height, width = image.shape[:2]
    scale, base = height / 288.0, draw_base(key, tick)
    for k in range(int(look.rain * _DROPS * height * width)):
        word = draw_at(base, 100_000 + k)
        x, y = int(word & np.uint64(0xFFFF)) * width / 65536.0, int((word >> np.uint64(16)) & np.uint64(0xFFFF))
        y = y * height / 65536.0
        near = (int((word >> np.uint64(32)) & np.uint64(0xFF)) + 1) / 256.0
        length, alpha = (5.0 + 18.0 * near) * scale, 0.08 + 0.2 * near
        for step in range(int(length)):
            row, column = int(y + step), int(x - 0.12 * step)
            if 0 <= row < height and 0 <= column < width:
                for c in range(3):
                    ahead = min(255.0, look.haze[2 - c] * 1.15 + 30.0)
                    image[row, column, c] = np.uint8(image[row, column, c] + (ahead - image[row, column, c]) * alpha)


def is_wet(look: Look) -> bool:
    """Whether the ground mirrors."""
    return look.wet > 0.02
