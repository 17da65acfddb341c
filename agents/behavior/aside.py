"""Making room for others: for an emergency vehicle from behind, and for who comes against the ego on its lane."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.beside import BESIDE, WITHIN, Neighbours
from agents.behavior.gaps import is_free
from agents.behavior.hazards import Ego
from agents.behavior.memory import SPEED
from agents.behavior.way import BEND, Shift
from lavsim.types import VehicleLight

Floats = NDArray[np.float64]
Ground = Callable[[float, float, float], str | None]  # begin, end, offset: the lane there

LANE = 3.5  # [m] to the middle of the lane beside
HURRIES = 3.0  # [m/s]
STRETCH, LEAST_STRETCH = 100.0, 40.0  # [m] for which it makes way at first
PASSED = 6.0  # [m] the emergency vehicle is ahead when it comes back
RAMP_TIME, RAMP_LEAST, RAMP_MOST = 2.2, 12.0, 32.0  # [s], [m], [m]
TIGHTEST = 0.2  # [1/m]
FACED_AHEAD = 70.0  # [m]
FACED_CLEAR = 0.35  # [m] kept from who comes against it
KEEP_RIGHT = (1.2, 1.0, 0.8, 0.6, 0.4)  # [m] at most, as the lane allows
ROOM_BESIDE = 0.25  # [m] kept from what stands beside it then
FACED_STRETCHES = (FACED_AHEAD, 45.0, 25.0)  # [m] for which it keeps right at first

_SPECIAL = int(VehicleLight.SPECIAL1 | VehicleLight.SPECIAL2)


def emergency(truth: Mapping[str, Any], memory: Floats) -> int:
    """Row of a moving vehicle with its blue lights on; -1 without any."""
    rows = np.flatnonzero((truth["vehicle_lights"] & _SPECIAL != 0) & (memory[:, SPEED] > HURRIES))
    return int(rows[0]) if len(rows) and rows[0] > 0 else -1


def make_way(ego: Ego, near: Neighbours, row: int, ground: Ground, limit: float) -> Shift | None:
    """The shift onto a lane beside that lets `row` pass; None where it needn't or can't."""
    own = np.flatnonzero(near.row == row)
    if not len(own) or near.front[own[0]] > ego.s or abs(near.left[own[0]] + near.right[own[0]]) > LANE:
        return None
    others = Neighbours(*(column[near.row != row] for column in near))
    ramp = min(max(RAMP_TIME * ego.speed, RAMP_LEAST), RAMP_MOST)
    for offset in (LANE, -LANE):
        for length in (STRETCH, LEAST_STRETCH):
            shift = Shift(ego.s, ego.s + ramp, ego.s + ramp + length, ego.s + 2.0 * ramp + length, offset)
            if ground(shift.full, shift.leave, offset) == BESIDE and is_free(ego, shift, BESIDE, others, limit, 0.5):
                return shift
    return None


def made_way(ego: Ego, near: Neighbours, row: int, shift: Shift, ground: Ground) -> Shift:
    """What becomes of a shift that makes way for `row`: it lasts until that is past and the own lane is free."""
    own = np.flatnonzero(near.row == row)
    front, back = ego.s + ego.half_length, ego.s - ego.half_length
    has_passed = row < 0 or not len(own) or near.rear[own[0]] > front + PASSED
    half = ego.half_width + 0.3
    on_lane = (near.left < half) & (near.right > -half) & (near.row != row)
    is_taken = np.any(
        on_lane & (near.rear < front + 4.0) & (near.front > back - 2.0 - 1.5 * np.maximum(near.speed, 0.0))
    )
    fall = shift.end - shift.leave
    if has_passed and not is_taken:
        leave = max(min(shift.leave, ego.s + 3.0), shift.full)
        return replace(shift, leave=leave, end=leave + fall)
    wanted = ego.s + LEAST_STRETCH
    if wanted > shift.leave and ground(shift.leave, wanted, shift.offset) == BESIDE:
        return replace(shift, leave=wanted, end=wanted + fall)
    return shift


def keep_right(ego: Ego, near: Neighbours, ground: Ground) -> Shift | None:
    """The shift within the own lane that leaves room to who comes against the ego partly on it."""
    comes = _invading(ego, near)
    if not comes.any():
        return None
    needed = float(near.right[comes].max()) + FACED_CLEAR + ego.half_width
    if needed <= 0.05:
        return None
    for most in KEEP_RIGHT:
        offset = min(needed, most)
        ramp = max(6.0, math.sqrt(BEND * offset / TIGHTEST), ego.speed)
        for stretch in FACED_STRETCHES:
            leave = ego.s + max(stretch, ramp)
            if ground(ego.s + ramp, leave, offset) == WITHIN and not _is_taken(ego, near, leave, offset):
                return Shift(ego.s, ego.s + ramp, leave, leave + 15.0, offset)
    return None


def kept_right(ego: Ego, near: Neighbours, shift: Shift, ground: Ground) -> Shift:
    """The same shift, longer while somebody still comes."""
    wanted = ego.s + FACED_AHEAD
    if wanted < shift.leave + 10.0 or not _invading(ego, near).any():
        return shift
    if ground(shift.leave, wanted, shift.offset) != WITHIN or _is_taken(ego, near, wanted, shift.offset):
        return shift
    return replace(shift, leave=wanted, end=wanted + 15.0)


def _is_taken(ego: Ego, near: Neighbours, until: float, offset: float) -> bool:
    """Whether something stands where the ego would drive `offset` to the right up to place `until`."""
    half = ego.half_width + ROOM_BESIDE
    within = (near.rear < until + ego.half_length) & (near.front > ego.s - ego.half_length) & (np.abs(near.speed) < 1.0)
    return bool(np.any(within & (near.left < offset + half) & (near.right > offset - half)))


def _invading(ego: Ego, near: Neighbours) -> NDArray[np.bool_]:
    """(N,) who comes against the ego partly on its lane."""
    ahead = (near.speed < -1.0) & (near.front > ego.s) & (near.rear < ego.s + FACED_AHEAD)
    return ahead & (near.right > -ego.half_width - FACED_CLEAR) & (near.left < -ego.half_width)
