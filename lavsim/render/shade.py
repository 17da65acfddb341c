"""Colours of the look `fast`: one pass over the pixels after visibility is known, so each is shaded once.

Materials are painted by rule in the plane of their face: a rule says which swatch (window, brake lamp, tyre …) a point
shows. Texture is a hash of the place, so it stands still in the world.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.render.faces import DECK_FACE, TOP, UNDERSIDE
from lavsim.render.frame import Pose
from lavsim.render.ground import surface_at
from lavsim.render.look import FOG_STEPS, SKY_STEPS, Look, Swatch
from lavsim.render.solids import Material, Solids
from lavsim.render.terrain import Terrain
from lavsim.render.zbuffer import Pinhole, Visibility
from lavsim.types import VehicleLight

_WALL, _FOLIAGE, _LAMP, _BODY = int(Material.WALL), int(Material.FOLIAGE), int(Material.LAMP), int(Material.BODY)
_GLASS, _POSTER, _PLAIN = int(Material.GLASS), int(Material.POSTER), int(Material.PLAIN)
_BRAKE, _LEFT, _RIGHT = int(VehicleLight.BRAKE), int(VehicleLight.LEFT_BLINKER), int(VehicleLight.RIGHT_BLINKER)
_POSITION = int(VehicleLight.POSITION | VehicleLight.LOW_BEAM | VehicleLight.HIGH_BEAM)
_SPECIAL = int(VehicleLight.SPECIAL1 | VehicleLight.SPECIAL2)
_OWN, _WINDOW, _LIT_WINDOW, _TYRE = int(Swatch.OWN), int(Swatch.WINDOW), int(Swatch.LIT_WINDOW), int(Swatch.TYRE)
_BRAKE_ON, _REAR_ON, _REAR_OFF = int(Swatch.BRAKE_ON), int(Swatch.REAR_ON), int(Swatch.REAR_OFF)
_HEAD_ON, _HEAD_OFF, _GRILLE = int(Swatch.HEAD_ON), int(Swatch.HEAD_OFF), int(Swatch.GRILLE)
_BLINKER, _FLASH, _PLATE, _BAND = int(Swatch.BLINKER), int(Swatch.FLASH), int(Swatch.PLATE), int(Swatch.BAND_1)

STOREY, BAY = 3.2, 3.0  # [m] of the window pattern
PATTERN_RANGE = 120.0  # [m] windows farther away are blended into the wall
BLINK_TICKS = 7  # half a period of indicators and flash lights: 0.35 s
LAMP_GLOW, UNLIT = 0.8, 0.22  # of a signal lamp: how little fog takes of it while lit; its colour while dark

# Columns of the face table.
_RED, _GREEN, _BLUE, _GLOW, _START_X, _START_Y, _TANGENT_X, _TANGENT_Y, _LENGTH, _Z0, _Z1 = range(11)
_MARGIN, _BAYS, _STOREYS, _SEED = range(11, 15)  # of walls: wall beside the windows, length and height with windows [m]
_COLUMNS = 15


def shade(
    view: Visibility,
    lens: Pinhole,
    pose: Pose,
    statics: Solids,
    actors: Solids,
    terrain: Terrain,
    look: Look,
    lights: NDArray[np.uint8],
    headlights: tuple[float, float, float, float],
    tick: int,
) -> NDArray[np.uint8]:
    """(H, W, 4) uint8 blue, green, red, alpha.

    Args:
        headlights: x, y, yaw of the ego, and the strength of its headlights (0 off).
        tick: For what blinks.
    """
    table, material, side, state = _face_table(*view.faces, statics, actors, look, lights)
    ground = terrain.raster
    blink = (tick // BLINK_TICKS) % 2 == 0
    pixels = _shade(
        view.face, view.inverse_depth, lens.focal, pose.origin, pose.axes, ground.classes, ground.origin,
        terrain.deck_raster.classes, terrain.deck_raster.origin, 1.0 / ground.resolution, look,
        table, material, side, state, headlights, blink,
    )  # fmt: skip
    return pixels.view(np.uint8).reshape(lens.height, lens.width, 4)


@kernel
def _face_table(face_solid, face_side, statics, actors, look, lights):  # type: ignore[no-untyped-def]
    """Lit colour and plane coordinates of each face, with its material, side and light state."""
    count = len(face_solid)
    table = np.empty((count, _COLUMNS), np.float32)
    material, side = np.empty(count, np.uint8), np.empty(count, np.uint8)
    state = np.empty(count, np.int32)
    for f in range(count):
        row = face_solid[f]
        if row < len(statics.corners):
            _fill_face(table[f], statics, row, face_side[f], look)
            material[f], state[f] = statics.material[row], statics.state[row]
            if material[f] == _LAMP:
                light = statics.light[row]
                _fill_lamp(table[f], 0 <= light < len(lights) and lights[light] == statics.state[row])
        else:
            row -= len(statics.corners)
            _fill_face(table[f], actors, row, face_side[f], look)
            material[f], state[f] = actors.material[row], actors.state[row]
        side[f] = face_side[f]
        is_cap = face_side[f] >= TOP and material[f] != _FOLIAGE
        is_poster = material[f] == _POSTER and face_side[f] == 0
        if is_cap or not (material[f] in (_FOLIAGE, _WALL, _GLASS, _BODY) or is_poster):
            material[f] = _PLAIN
    return table, material, side, state


@kernel
def _fill_lamp(out, lit):  # type: ignore[no-untyped-def]
    """A signal lamp: its hue at full strength while lit, whatever the daylight."""
    brightest = max(out[_RED], max(out[_GREEN], max(out[_BLUE], np.float32(1.0))))
    scale = np.float32(255.0) / brightest if lit else np.float32(UNLIT)
    for c in range(3):
        out[c] *= scale
    out[_GLOW] = LAMP_GLOW if lit else 0.0


@kernel
def _fill_face(out, solids, k, side, look):  # type: ignore[no-untyped-def]
    nx, ny, nz, length = 0.0, 0.0, 0.0, 1.0
    x, y, tx, ty = 0.0, 0.0, 1.0, 0.0
    if side == TOP:
        nz = 1.0
    elif side == UNDERSIDE:
        nz = -1.0
    else:
        other = side + 1 if side + 1 < solids.corners[k] else 0
        x, y = solids.xy[k, side, 0], solids.xy[k, side, 1]
        tx, ty = solids.xy[k, other, 0] - x, solids.xy[k, other, 1] - y
        length = max(np.sqrt(tx * tx + ty * ty), 1e-9)
        tx, ty = tx / length, ty / length
        nx, ny = ty, -tx
    towards = max(0.0, nx * look.sun[0] + ny * look.sun[1] + nz * look.sun[2])
    for c in range(3):
        light = look.ambient[c] * (0.88 + 0.12 * nz + 0.06 * nx) + look.sunlight[c] * towards
        out[c] = solids.colour[k, c] * light
    out[_GLOW], out[_START_X], out[_START_Y], out[_TANGENT_X], out[_TANGENT_Y] = 0.0, x, y, tx, ty
    out[_LENGTH], out[_Z0], out[_Z1] = length, solids.z0[k], solids.z1[k]
    tall = solids.z1[k] - solids.z0[k]
    out[_BAYS] = int(length / BAY) * BAY if tall >= STOREY else 0.0
    out[_STOREYS], out[_MARGIN] = int(tall / STOREY) * STOREY, (length - out[_BAYS]) / 2.0
    out[_SEED] = (k * 37 + side * 11) & 0xFFFF


@kernel
def _hash(a, b):  # type: ignore[no-untyped-def]
    """A number in [-1, 1) that belongs to a pair of whole numbers."""
    word = np.uint32(np.uint32(a) * np.uint32(0x9E3779B1)) ^ np.uint32(np.uint32(b) * np.uint32(0x85EBCA77))
    word = np.uint32((word ^ (word >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    word ^= word >> np.uint32(13)
    return np.float32(np.int32(word & np.uint32(0xFFFF))) * np.float32(2.0 / 65536.0) - np.float32(1.0)


@kernel
def _shade(  # type: ignore[no-untyped-def]
    face, inverse_depth, focal, origin, axes, classes, corner, deck, deck_corner, per_metre,
    look, table, material, side, state, headlights, blink,
):  # fmt: skip
    """Row by row: places first, then their colours, then air and packing; only the colours need branches."""
    height, width = face.shape
    pixels = np.empty((height, width), np.uint32)
    place, depth = np.empty((2, width)), np.empty(width)
    paint = np.empty((4, width), np.float32)  # red, green, blue, glow
    for row in range(height):
        v = (row + 0.5 - height / 2.0) / focal
        ray = (axes[0, 0] - v * axes[0, 2], axes[1, 0] - v * axes[1, 2], axes[2, 0] - v * axes[2, 2])
        _place_row(inverse_depth[row], focal, origin, axes, ray, place, depth)
        _colour_row(
            face[row], inverse_depth[row], focal, origin[2], ray[2], axes[2, 1], place, depth, classes, corner,
            deck, deck_corner, per_metre, look, table, material, side, state, blink, paint,
        )  # fmt: skip
        if headlights[3] > 0.0:
            _light_row(headlights, place, paint)
        _air_row(depth, paint, look.transmission, look.haze, pixels[row])
    return pixels


@kernel
def _place_row(inverse, focal, origin, axes, ray, place, depth):  # type: ignore[no-untyped-def]
    """World x, y and depth [m] of a row of pixels; far away for the sky."""
    width = len(inverse)
    for column in range(width):
        u = (column + 0.5 - width / 2.0) / focal
        depth[column] = 1.0 / max(float(inverse[column]), 1e-6)
        place[0, column] = origin[0] + depth[column] * (ray[0] + u * axes[0, 1])
        place[1, column] = origin[1] + depth[column] * (ray[1] + u * axes[1, 1])


@kernel
def _colour_row(  # type: ignore[no-untyped-def]
    face, inverse, focal, height, rise, rise_step, place, depth, classes, corner, deck, deck_corner, per_metre, look,
    table, material, side, state, blink, paint,
):  # fmt: skip
    """Lit colours of a row of pixels, and how much of each shines through fog."""
    width = len(face)
    one, is_night = np.float32(1.0), look.night > 0.5
    for column in range(width):
        f = face[column]
        up = rise + rise_step * (column + 0.5 - width / 2.0) / focal
        share, swatch = one, _OWN
        if f >= 0:
            red, green, blue, glow = table[f, _RED], table[f, _GREEN], table[f, _BLUE], table[f, _GLOW]
            kind = material[f]
            if kind == _FOLIAGE:
                grain = one + _leaves(place[0, column], place[1, column], height + depth[column] * up) * np.float32(
                    min(1.0, 40.0 / depth[column])
                )
                red, green, blue = red * grain, green * grain, blue * grain
            elif kind != _PLAIN:
                high = np.float32(height + depth[column] * up) - table[f, _Z0]
                along = np.float32(place[0, column] - table[f, _START_X]) * table[f, _TANGENT_X]
                along += np.float32(place[1, column] - table[f, _START_Y]) * table[f, _TANGENT_Y]
                tall, length = table[f, _Z1] - table[f, _Z0], table[f, _LENGTH]
                if kind == _WALL:
                    swatch = _wall(
                        along - table[f, _MARGIN],
                        high,
                        table[f, _BAYS],
                        table[f, _STOREYS],
                        int(table[f, _SEED]),
                        is_night,
                    )
                    share = np.float32(max(0.0, 1.0 - depth[column] / PATTERN_RANGE))
                elif kind == _BODY:
                    swatch = _body(along, high, length, tall, side[f], state[f], blink)
                else:
                    swatch = _panel(along, high / max(tall, np.float32(0.01)), length, kind)
                if swatch != _OWN:
                    glow = look.swatches[swatch, 3]
                    red += (look.swatches[swatch, 0] - red) * share
                    green += (look.swatches[swatch, 1] - green) * share
                    blue += (look.swatches[swatch, 2] - blue) * share
        elif inverse[column] > 0.0:
            if f == DECK_FACE:
                cx = (place[0, column] - deck_corner[0]) * per_metre
                cy = (place[1, column] - deck_corner[1]) * per_metre
                surface = surface_at(deck, cx, cy)
            else:
                cx, cy = (place[0, column] - corner[0]) * per_metre, (place[1, column] - corner[1]) * per_metre
                surface = surface_at(classes, cx, cy)
            grain = one + look.grain[surface] * _hash(int(np.floor(cx)) >> 1, int(np.floor(cy)) >> 1)
            red, green, blue = look.ground[surface, 0], look.ground[surface, 1], look.ground[surface, 2]
            red, green, blue, glow = red * grain, green * grain, blue * grain, np.float32(0.0)
        else:
            step = int(min(max(up, 0.0), 1.0) * (SKY_STEPS - 1))
            red, green, blue, glow = look.sky[step, 0], look.sky[step, 1], look.sky[step, 2], one
        paint[0, column], paint[1, column], paint[2, column], paint[3, column] = red, green, blue, glow


@kernel
def _light_row(headlights, place, paint):  # type: ignore[no-untyped-def]
    """Brightens what the ego's headlights reach and does not shine by itself."""
    cos_ego, sin_ego, strength = np.cos(headlights[2]), np.sin(headlights[2]), np.float32(headlights[3])
    for column in range(paint.shape[1]):
        if paint[3, column] == 0.0:
            reach = _headlight(place[0, column] - headlights[0], place[1, column] - headlights[1], cos_ego, sin_ego)
            for c in range(3):
                paint[c, column] *= np.float32(1.0) + strength * reach


@kernel
def _air_row(depth, paint, transmission, haze, pixels):  # type: ignore[no-untyped-def]
    """Fades a row of colours into the haze and packs it as little-endian BGRA words."""
    one, top = np.float32(1.0), np.float32(255.0)
    for column in range(len(pixels)):
        clear = transmission[int(min(depth[column], FOG_STEPS - 1.0))]
        clear += (one - clear) * paint[3, column]
        fade = one - clear
        red = np.int32(min(paint[0, column] * clear + haze[0] * fade, top))
        green = np.int32(min(paint[1, column] * clear + haze[1] * fade, top))
        blue = np.int32(min(paint[2, column] * clear + haze[2] * fade, top))
        pixels[column] = np.uint32(blue | (green << np.int32(8)) | (red << np.int32(16))) | np.uint32(0xFF000000)


@kernel
def _headlight(dx, dy, cos_ego, sin_ego):  # type: ignore[no-untyped-def]
    """Brightening of a place by the ego's headlights: a cone that falls off with distance."""
    ahead = dx * cos_ego + dy * sin_ego - 2.0
    if ahead <= 0.0:
        return np.float32(0.0)
    aside = (dy * cos_ego - dx * sin_ego) / (0.5 * ahead + 1.2)
    if abs(aside) >= 1.0:
        return np.float32(0.0)
    return np.float32((1.0 - aside * aside) * min(ahead, 4.0) / 4.0 / (1.0 + ahead * ahead / 400.0))


@kernel
def _leaves(x, y, z):  # type: ignore[no-untyped-def]
    cell = int(np.floor(x * 2.5)) + 7919 * int(np.floor(z * 2.5))
    return np.float32(0.22) * _hash(cell, int(np.floor(y * 2.5)))


@kernel
def _wall(at, up, bays, storeys, seed, is_night):  # type: ignore[no-untyped-def]
    """Rows of windows over `bays` [m] along and `storeys` [m] up; some are lit at night."""
    if at < 0.0 or at >= bays or up < 0.0 or up >= storeys:
        return _OWN
    bay, storey = np.int32(at * np.float32(1.0 / BAY)), np.int32(up * np.float32(1.0 / STOREY))
    across, high = at - bay * np.float32(BAY), up - storey * np.float32(STOREY)
    if not (0.75 < across < 2.25 and 0.95 < high < 2.5):
        return _OWN
    return _LIT_WINDOW if is_night and _hash(seed + bay, storey) > 0.4 else _WINDOW


@kernel
def _panel(along, share, length, kind):  # type: ignore[no-untyped-def]
    """Windows of a cabin with their pillars, or the bands of a lit poster."""
    edge = min(along, length - along)
    if kind == _POSTER:
        return _BAND + int(share * 7.0) % 3 if edge > 0.08 and 0.12 < share < 0.92 else _OWN
    pillar = length > 2.0 and along % 1.2 < 0.09
    return _WINDOW if 0.1 < share < 0.8 and edge > 0.07 and not pillar else _OWN


@kernel
def _body(along, up, length, tall, side, state, blink):  # type: ignore[no-untyped-def]
    """Lamps, grille and plate of a vehicle's front and rear, and its wheels on the sides."""
    edge = min(along, length - along)
    if side == 1 or side == 3:
        radius = 0.34 if length < 5.6 else 0.48
        ahead, above = edge - 0.2 * length, up + 0.2 - radius
        return _TYRE if ahead * ahead + above * above < radius * radius and length > 2.2 else _OWN
    share, middle = up / tall, abs(along - length / 2.0)
    if edge < max(0.2 * length, 0.08) and 0.52 < share < 0.85:
        is_left = (along < length / 2.0) == (side == 0)
        if blink and edge < 0.1 * length:
            if state & _SPECIAL:
                return _FLASH
            if state & (_LEFT if is_left else _RIGHT):
                return _BLINKER
        if side == 0:
            return _HEAD_ON if state & _POSITION else _HEAD_OFF
        if state & _BRAKE:
            return _BRAKE_ON
        return _REAR_ON if state & _POSITION else _REAR_OFF
    if side == 2:
        return _PLATE if middle < 0.26 and 0.25 < share < 0.48 else _OWN
    return _GRILLE if middle < 0.25 * length and 0.15 < share < 0.6 else _OWN
