"""What faces are painted with: one lit colour each, and rules for what lies in their planes.

A rule says which swatch (window, brake lamp, tyre …) a point of a face shows. All texture is a function of the place,
so it stands still in the world.
"""

from __future__ import annotations

import numpy as np

from lavsim.kernel import kernel, lean_kernel
from lavsim.render.faces import TOP, UNDERSIDE
from lavsim.render.inlined import inlined
from lavsim.render.look import Swatch
from lavsim.render.solids import Material
from lavsim.types import DT, VehicleLight

WALL, FOLIAGE, LAMP, BODY = int(Material.WALL), int(Material.FOLIAGE), int(Material.LAMP), int(Material.BODY)
GLASS, POSTER, PLAIN = int(Material.GLASS), int(Material.POSTER), int(Material.PLAIN)
_BRAKE, _LEFT, _RIGHT = int(VehicleLight.BRAKE), int(VehicleLight.LEFT_BLINKER), int(VehicleLight.RIGHT_BLINKER)
POSITION = int(VehicleLight.POSITION | VehicleLight.LOW_BEAM | VehicleLight.HIGH_BEAM)
SPECIAL = int(VehicleLight.SPECIAL1 | VehicleLight.SPECIAL2)
OWN, WINDOW, LIT_WINDOW, _TYRE = int(Swatch.OWN), int(Swatch.WINDOW), int(Swatch.LIT_WINDOW), int(Swatch.TYRE)
_BRAKE_ON, _REAR_ON, _REAR_OFF = int(Swatch.BRAKE_ON), int(Swatch.REAR_ON), int(Swatch.REAR_OFF)
_HEAD_ON, _HEAD_OFF, _GRILLE = int(Swatch.HEAD_ON), int(Swatch.HEAD_OFF), int(Swatch.GRILLE)
_BLINKER, _FLASH, _PLATE, _BAND = int(Swatch.BLINKER), int(Swatch.FLASH), int(Swatch.PLATE), int(Swatch.BAND_1)

STOREY, BAY = 3.2, 3.0  # [m] of the window pattern
PATTERN_RANGE = 120.0  # [m] windows farther away are blended into the wall
BLINK_HERTZ = 1.5  # of indicators and flash lights
LAMP_GLOW, UNLIT = 0.8, 0.22  # of a signal lamp: how little fog takes of it while lit; its colour while dark

# Columns of the face table.
RED, GREEN, BLUE, GLOW, START_X, START_Y, TANGENT_X, TANGENT_Y, LENGTH, Z0, Z1 = range(11)
MARGIN, BAYS, STOREYS, SEED = range(11, 15)  # of walls: wall beside the windows, length and height with windows [m]
DARK = 15  # and 16, 17: share of each colour that is left in shadow
_COLUMNS = 18


@kernel
def face_table(face_solid, face_side, statics, actors, look, lights):  # type: ignore[no-untyped-def]
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
            if material[f] == LAMP:
                light = statics.light[row]
                _fill_lamp(table[f], 0 <= light < len(lights) and lights[light] == statics.state[row])
        else:
            row -= len(statics.corners)
            _fill_face(table[f], actors, row, face_side[f], look)
            material[f], state[f] = actors.material[row], actors.state[row]
        side[f] = face_side[f]
        is_cap = face_side[f] >= TOP and material[f] != FOLIAGE
        is_poster = material[f] == POSTER and face_side[f] == 0
        if is_cap or not (material[f] in (FOLIAGE, WALL, GLASS, BODY) or is_poster):
            material[f] = PLAIN
    return table, material, side, state


@lean_kernel
def _fill_lamp(out, lit):  # type: ignore[no-untyped-def]
    """A signal lamp: its hue at full strength while lit, whatever the daylight."""
    brightest = max(out[RED], max(out[GREEN], max(out[BLUE], np.float32(1.0))))
    scale = np.float32(255.0) / brightest if lit else np.float32(UNLIT)
    for c in range(3):
        out[c] *= scale
        out[DARK + c] = 1.0
    out[GLOW] = LAMP_GLOW if lit else 0.0


@lean_kernel
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
        out[DARK + c] = (light - look.sunlight[c] * towards) / light
    out[GLOW], out[START_X], out[START_Y], out[TANGENT_X], out[TANGENT_Y] = 0.0, x, y, tx, ty
    out[LENGTH], out[Z0], out[Z1] = length, solids.z0[k], solids.z1[k]
    tall = solids.z1[k] - solids.z0[k]
    out[BAYS] = int(length / BAY) * BAY if tall >= STOREY else 0.0
    out[STOREYS], out[MARGIN] = int(tall / STOREY) * STOREY, (length - out[BAYS]) / 2.0
    out[SEED] = (k * 37 + side * 11) & 0xFFFF


def is_blink_on(tick: int) -> bool:
    """Whether what blinks shines at a tick; all blinks together, as a function of the tick alone."""
    return int(tick * (2.0 * BLINK_HERTZ * DT) + 1e-9) % 2 == 0


@inlined
def panel_swatch(along, share, length, kind):  # type: ignore[no-untyped-def]
    """Windows of a cabin with their pillars, or the bands of a lit poster."""
    edge = min(along, length - along)
    if kind == POSTER:
        return _BAND + int(share * 7.0) % 3 if edge > 0.08 and 0.12 < share < 0.92 else OWN
    pillar = length > 2.0 and along % 1.2 < 0.09
    return WINDOW if 0.1 < share < 0.8 and edge > 0.07 and not pillar else OWN


@inlined
def body_swatch(along, up, length, tall, side, state, blink):  # type: ignore[no-untyped-def]
    """Lamps, grille and plate of a vehicle's front and rear, and its wheels on the sides."""
    edge = min(along, length - along)
    if side == 1 or side == 3:
        radius = 0.34 if length < 5.6 else 0.48
        ahead, above = edge - 0.2 * length, up + 0.2 - radius
        return _TYRE if ahead * ahead + above * above < radius * radius and length > 2.2 else OWN
    share, middle = up / tall, abs(along - length / 2.0)
    if edge < max(0.2 * length, 0.08) and 0.52 < share < 0.85:
        is_left = (along < length / 2.0) == (side == 0)
        if blink and edge < 0.1 * length:
            if state & SPECIAL:
                return _FLASH
            if state & (_LEFT if is_left else _RIGHT):
                return _BLINKER
        if side == 0:
            return _HEAD_ON if state & POSITION else _HEAD_OFF
        if state & _BRAKE:
            return _BRAKE_ON
        return _REAR_ON if state & POSITION else _REAR_OFF
    if side == 2:
        return _PLATE if middle < 0.26 and 0.25 < share < 0.48 else OWN
    return _GRILLE if middle < 0.25 * length and 0.15 < share < 0.6 else OWN
