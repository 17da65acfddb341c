"""Colours of the look `full`: that of `fast` with shadows, texture, wet mirrors, the light of lamps, clouds and rain.

Noise and texture belong to places and weather, rain to camera and tick, so a picture is the same whenever it is drawn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.kernel_draws import draw_at, draw_base
from lavsim.random import Draws
from lavsim.render.faces import DECK_FACE
from lavsim.render.frame import Pose
from lavsim.render.ground import Surface
from lavsim.render.lamps import LightMap, light_at
from lavsim.render.look import SKY_STEPS, Look
from lavsim.render.paint import (
    BAYS,
    BLUE,
    BODY,
    DARK,
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
    is_blink_on,
    panel_swatch,
    wall_swatch,
)
from lavsim.render.shade import (
    BLOCK,
    NOISE,
    NOISE_UNIT,
    Ground,
    PaintedFaces,
    air_block,
    cell_block,
    place_block,
    surface_of,
)
from lavsim.render.shadow import ShadowMap, sun_share
from lavsim.render.texture import cell_noise, smooth_noise
from lavsim.render.zbuffer import Pinhole, Visibility

_TERRAIN, _MEDIAN, _SIDEWALK = int(Surface.TERRAIN), int(Surface.MEDIAN), int(Surface.SIDEWALK)
_FIRST_PAINT, _LAST_PAINT = int(Surface.CROSSWALK), int(Surface.YELLOW_BROKEN)
_LAMP_LIGHT = 4.2  # brightening of what lies below a street lamp, at night
_SLAB = 1.5  # [m] of sidewalks
_SEAM_RANGE = 25.0  # [m] of seams in the asphalt
_COURSE = 0.45  # [m] between the joints of a wall
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
        is_blink_on(tick), np.uint64(key), tick, np.float32(noise / NOISE_UNIT), NOISE,
    )  # fmt: skip
    image = pixels.view(np.uint8).reshape(lens.height, lens.width, 4)
    if look.rain > 0.0:
        _add_rain(image, look, np.uint64(key), tick)
    return image


@kernel
def _shade(  # type: ignore[no-untyped-def]
    face, inverse_depth, focal, origin, axes, ground, look, faces, around, blink, key, tick, noise, noise_table
):
    height, width = face.shape
    pixels = np.empty(height * width, np.uint32)
    rows = max(1, BLOCK // width)
    place, paint = np.empty((4, rows * width), np.float32), np.empty((4, rows * width), np.float32)
    cells = np.empty((2, rows * width), np.int32)
    face, inverse, base = face.ravel(), inverse_depth.ravel(), draw_base(key, tick)
    for row in range(0, height, rows):
        begin, end = row * width, min(row + rows, height) * width
        place_block(inverse[begin:end], row, width, height, focal, origin, axes, place)
        cell_block(end - begin, place, ground, cells)
        _colour_block(face[begin:end], inverse[begin:end], row, width, origin, place, cells, ground, look, faces,
                      around, blink, tick, paint)  # fmt: skip
        air_block(place[2], paint, look, noise, noise_table, draw_at(base, row), pixels[begin:end])
    return pixels


@kernel
def _colour_block(  # type: ignore[no-untyped-def]
    face, inverse, first_row, width, origin, place, cells, ground, look, faces, around, blink, tick, paint
):
    one, none, is_night, night = np.float32(1.0), np.float32(0.0), look.night > 0.5, np.float32(look.night)
    classes, deck, colours, sky, swatches = ground.classes, ground.deck, look.ground, look.sky, look.swatches
    table, material, side, state = faces.table, faces.material, faces.side, faces.state
    x, y, depth, rise, columns, rows = place[0], place[1], place[2], place[3], cells[0], cells[1]
    red_of, green_of, blue_of, glow_of = paint[0], paint[1], paint[2], paint[3]
    shadow, has_sun = around.shadows.height, around.shadows.covers
    shadow_x, shadow_y = np.float32(around.shadows.x), np.float32(around.shadows.y)
    slope_x, slope_y = np.float32(around.shadows.slope_x), np.float32(around.shadows.slope_y)
    light, light_x, light_y = around.lamps.light, np.float32(around.lamps.x), np.float32(around.lamps.y)
    mirror, mirrors = around.mirror, around.mirrors
    eye, wet, puddles = np.float32(origin[2]), np.float32(look.wet), np.float32(look.puddles)
    eye_x, eye_y = np.float32(origin[0]), np.float32(origin[1])
    cloud = none
    ripple, lamp = np.float32(look.rain), np.float32(_LAMP_LIGHT) * night
    for i in range(len(face)):
        f = face[i]
        if f < 0 and inverse[i] <= none:
            level = int(min(max(rise[i], none), one) * np.float32(SKY_STEPS - 1))
            ray_x, ray_y = (x[i] - eye_x) / depth[i], (y[i] - eye_y) / depth[i]
            if i & 1 == 0:  # clouds are wider than two pixels
                cloud = _cloud(ray_x, ray_y, rise[i], look.clouds)
            sun = _sun(ray_x, ray_y, rise[i], look.sun, look.sunlight)
            for c in range(3):
                tint = sky[level, c]
                tint += (look.haze[c] * np.float32(1.04) - tint) * cloud
                paint[c, i] = tint + sun * np.float32(255.0) * look.sunlight[c]
            glow_of[i] = one
            continue
        z = eye + depth[i] * rise[i]
        sunny, lit = one, none
        if has_sun:
            sunny = sun_share(shadow, shadow_x, shadow_y, slope_x, slope_y, x[i], y[i], z)
        if lamp > none:
            height = z if f >= 0 else none
            fall = min(one, max(np.float32(0.15), np.float32(1.4) - np.float32(0.25) * height))
            lit = lamp * fall * light_at(light, x[i] - light_x, y[i] - light_y)
        glow = none
        if f >= 0:
            red, green, blue, glow = table[f, RED], table[f, GREEN], table[f, BLUE], table[f, GLOW]
            kind = material[f]
            high = z - table[f, Z0]
            if kind == FOLIAGE:
                leaf = _leaves(x[i], y[i], z, depth[i])
                red, green, blue = red * leaf, green * leaf, blue * leaf
            elif kind != PLAIN:
                along = (x[i] - table[f, START_X]) * table[f, TANGENT_X]
                along += (y[i] - table[f, START_Y]) * table[f, TANGENT_Y]
                tall, length = table[f, Z1] - table[f, Z0], table[f, LENGTH]
                share, grain = one, one
                if kind == WALL:
                    at = along - table[f, MARGIN]
                    swatch = wall_swatch(at, high, table[f, BAYS], table[f, STOREYS], int(table[f, SEED]), is_night)
                    share = max(none, one - depth[i] * np.float32(1.0 / PATTERN_RANGE))
                    grain = _wall(at, along, high, depth[i], int(table[f, SEED]), swatch != OWN)
                elif kind == BODY:
                    swatch = body_swatch(along, high, length, tall, side[f], state[f], blink)
                    grain = np.float32(0.82) + np.float32(0.3) * min(one, high / max(tall, np.float32(0.1)))
                else:
                    swatch = panel_swatch(along, high / max(tall, np.float32(0.01)), length, kind)
                if swatch != OWN:
                    glow = swatches[swatch, 3]
                    red += (swatches[swatch, 0] - red) * share
                    green += (swatches[swatch, 1] - green) * share
                    blue += (swatches[swatch, 2] - blue) * share
                    if kind == WALL and glow == none:  # panes show more or less of the sky
                        grain += np.float32(0.25) * cell_noise(int(along) + int(table[f, SEED]), int(high))
                if glow == none:
                    red, green, blue = red * grain, green * grain, blue * grain
            if glow == none:
                dark = one - sunny
                red *= (one - (one - table[f, DARK]) * dark) * (one + lit)
                green *= (one - (one - table[f, DARK + 1]) * dark) * (one + lit * np.float32(0.9))
                blue *= (one - (one - table[f, DARK + 2]) * dark) * (one + lit * np.float32(0.68))
        else:
            if f == DECK_FACE:
                scale = 2.0 * ground.per_metre
                surface = surface_of(deck, int(np.floor((x[i] - ground.deck_x) * scale)),
                                     int(np.floor((y[i] - ground.deck_y) * scale)))  # fmt: skip
            else:
                surface = surface_of(classes, columns[i], rows[i])
            dark, grain = one - sunny, _ground(surface, x[i], y[i], depth[i])
            red = colours[surface, 0] * grain * (one - (one - colours[surface, 3]) * dark) * (one + lit)
            green = colours[surface, 1] * grain * (one - (one - colours[surface, 4]) * dark)
            green *= one + lit * np.float32(0.9)
            blue = colours[surface, 2] * grain * (one - (one - colours[surface, 5]) * dark)
            blue *= one + lit * np.float32(0.68)
            if mirrors and surface != _TERRAIN and surface != _MEDIAN:
                share, blur = _mirror_share(x[i], y[i], -rise[i], wet, puddles)
                row, column = first_row + i // width, i % width
                shift = cell_noise(int(x[i] * np.float32(9.0)) + tick * 31, int(y[i] * np.float32(9.0)))
                row += int(shift * (blur + np.float32(3.0) * ripple))
                row, column = min(max(row >> 1, 0), mirror.shape[0] - 1), min(column >> 1, mirror.shape[1] - 1)
                red += (np.float32(mirror[row, column, 2]) - red) * share
                green += (np.float32(mirror[row, column, 1]) - green) * share
                blue += (np.float32(mirror[row, column, 0]) - blue) * share
        red_of[i], green_of[i], blue_of[i], glow_of[i] = red, green, blue, glow


@kernel
def _cloud(ray_x, ray_y, rise, clouds):  # type: ignore[no-untyped-def]
    """Share of cloud in a direction: two sizes of patches on a plane above, gone at the horizon."""
    if rise < np.float32(0.01):
        return np.float32(0.0)
    scale = np.float32(0.9) / (rise + np.float32(0.12))
    u, v = ray_x * scale, ray_y * scale
    patch = np.float32(0.65) * smooth_noise(u * np.float32(1.7), v * np.float32(1.7))
    patch += np.float32(0.35) * smooth_noise(u * np.float32(5.1) + np.float32(7.0), v * np.float32(5.1))
    cover = (patch + np.float32(1.7 * clouds - 0.75)) * np.float32(1.8)
    return min(max(cover, np.float32(0.0)), np.float32(0.85)) * min(np.float32(1.0), rise * np.float32(8.0))


@kernel
def _sun(ray_x, ray_y, rise, sun, sunlight):  # type: ignore[no-untyped-def]
    """Brightness of the sun's disc and of the halo about it."""
    if sunlight[0] < np.float32(0.05):
        return np.float32(0.0)
    norm = np.sqrt(ray_x * ray_x + ray_y * ray_y + rise * rise)
    cosine = (ray_x * sun[0] + ray_y * sun[1] + rise * sun[2]) / norm
    if cosine < np.float32(0.9):
        return np.float32(0.0)
    near = (cosine - np.float32(0.9)) * np.float32(10.0)
    near *= near
    near *= near
    return np.float32(0.5) * near + (np.float32(1.0) if cosine > np.float32(0.9996) else np.float32(0.0))


@kernel
def _ground(surface, x, y, depth):  # type: ignore[no-untyped-def]
    """Brightness of a place of ground: blades, stones, patches, joints; what is smaller than a pixel fades."""
    one = np.float32(1.0)
    fine = min(one, np.float32(14.0) / depth)
    wide = min(one, np.float32(60.0) / depth)
    speck = cell_noise(int(np.floor(x * np.float32(16.0))), int(np.floor(y * np.float32(16.0)))) * fine
    patch = smooth_noise(x * np.float32(0.23), y * np.float32(0.23)) * wide
    if surface in (_TERRAIN, _MEDIAN):
        tuft = smooth_noise(x * np.float32(1.9), y * np.float32(1.9)) * fine
        return one + np.float32(0.16) * speck + np.float32(0.12) * tuft + np.float32(0.12) * patch
    if surface == _SIDEWALK:
        u, v = x / np.float32(_SLAB), y / np.float32(_SLAB)
        edge = min(abs(u - np.round(u)), abs(v - np.round(v)))
        joint = np.float32(0.16) * fine if edge < np.float32(0.02) else np.float32(0.0)
        slab = cell_noise(int(np.floor(u)), int(np.floor(v)))
        return one + np.float32(0.04) * speck + np.float32(0.05) * slab * wide - joint
    worn = np.float32(0.10) if _FIRST_PAINT <= surface <= _LAST_PAINT else np.float32(0.07)
    seam = np.float32(0.0)
    if depth < np.float32(_SEAM_RANGE):
        crack = smooth_noise(x * np.float32(0.31) + np.float32(40.0), y * np.float32(0.31))
        seam = np.float32(0.10) * fine if abs(crack) < np.float32(0.009) else seam
    return one + worn * speck + np.float32(0.07) * patch - seam


@kernel
def _leaves(x, y, z, depth):  # type: ignore[no-untyped-def]
    """Brightness of foliage: clumps and single leaves."""
    one = np.float32(1.0)
    clump = smooth_noise(x * np.float32(1.6) + z * np.float32(1.3), y * np.float32(1.6) - z * np.float32(1.9))
    cell = int(np.floor(x * np.float32(7.0))) + 7919 * int(np.floor(z * np.float32(7.0)))
    leaf = cell_noise(cell, int(np.floor(y * np.float32(7.0)))) * min(one, np.float32(20.0) / depth)
    return one + np.float32(0.22) * clump + np.float32(0.22) * leaf


@kernel
def _wall(at, along, high, depth, seed, is_window):  # type: ignore[no-untyped-def]
    """Brightness of a wall: courses, stains, and a foot that is darker."""
    one, fine = np.float32(1.0), min(np.float32(1.0), np.float32(18.0) / depth)
    if is_window:
        return one
    stain = smooth_noise(along * np.float32(0.5) + np.float32(seed & 1023), high * np.float32(0.35))
    course = high / np.float32(_COURSE)
    near = min(one, np.float32(7.0) / depth)  # joints of less than a pixel would make a moiré
    joint = np.float32(0.08) * near * near if abs(course - np.round(course)) < np.float32(0.06) else np.float32(0.0)
    speck = cell_noise(int(np.floor(along * np.float32(9.0))) + seed, int(np.floor(high * np.float32(9.0)))) * fine
    foot = np.float32(0.15) if high < np.float32(0.5) else np.float32(0.0)
    return one + np.float32(0.07) * stain + np.float32(0.035) * speck - joint - foot


@kernel
def _mirror_share(x, y, drop, wet, puddles):  # type: ignore[no-untyped-def]
    """Share of light that wet ground mirrors, and by how many rows the picture is smeared.

    Args:
        x, y: The place [m].
        drop: Fall of the ray over its length along the optical axis.
        wet, puddles: 0 to 1.
    """
    one = np.float32(1.0)
    steep = min(max(drop, np.float32(0.0)), one)
    grazing = (one - steep) * (one - steep)
    fresnel = np.float32(0.04) + np.float32(0.96) * grazing * grazing * (one - steep)
    hollow = np.float32(0.7) * smooth_noise(x * np.float32(0.27), y * np.float32(0.27))
    hollow += np.float32(0.3) * smooth_noise(x * np.float32(0.9), y * np.float32(0.9))
    if hollow > np.float32(0.62) - np.float32(0.75) * puddles and puddles > np.float32(0.0):
        return np.float32(0.18) + np.float32(0.62) * fresnel, np.float32(0.0)
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
