"""Whether the gap suffices: who comes against a shifted stretch of the way, or from behind beside it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.behavior.beside import AGAINST, WITHIN, Neighbours
from agents.behavior.hazards import Ego
from agents.behavior.speed import time_to_cover
from agents.behavior.way import BEND, Shift

Floats = NDArray[np.float64]

ROOM = 0.35  # [m] kept on either side
SPARE = 0.7  # [s] left to who comes against it
REACTION, FAIR_BRAKING = 1.5, 2.0  # [s], [m/s²] of others, on which it counts once it has waited for long
FOLLOW_GAP = 1.2  # [s] left to who comes from behind in the lane it moves to
EASY_BRAKING, FIRM_BRAKING = 2.0, 3.5  # [m/s²] expected of them, at first and once it has waited for long
PULL, FIRM_PULL = 1.8, 2.6  # [m/s²] at which it passes, at first and once it has waited for long
OVER = 0.3  # of the ramp after which it comes over the line
LEFT_BEHIND = 1.0  # [m] that who came against it is past its back by then
LATERAL = 2.2  # [m/s²] in the ramps
SIGHT = 200.0  # [m] from where on somebody it doesn't know of may come against it
FASTEST_UNSEEN = 14.0  # [m/s]


def is_free(ego: Ego, shift: Shift, kind: str, near: Neighbours, limit: float, patience: float) -> bool:
    """Whether nobody is or comes where a shift leads, or they can make room.

    Args:
        ego: Where the ego is.
        shift: What it would drive.
        kind: The lane that this leads over, see `agents.behavior.beside`.
        near: Who is near the path.
        limit: Speed limit [m/s]: who isn't seen yet may come as fast.
        patience: 1 at first; at 0 it counts on others to slow down.
    """
    half = ego.half_width + ROOM
    aside = (near.left < shift.offset + half) & (near.right > shift.offset - half)
    ends = shift.leave + 0.6 * (shift.end - shift.leave) + ego.half_length
    stands = aside & (np.abs(near.speed) < 0.3) & (near.front > shift.begin) & (near.rear < ends)
    if stands.any():
        return False
    time = _time(ego, shift, ends, patience)
    unseen = min(limit, FASTEST_UNSEEN)
    if kind == AGAINST and ego.s + SIGHT - _run(np.array(unseen), time, patience) < ends:
        return False
    over = shift.begin + OVER * (shift.full - shift.begin)
    gone = near.speed * time_to_cover(over - ego.s, ego.speed, _pull(patience), max(ego.wanted, 3.0))
    against = aside & (near.speed < -0.3) & (near.front + gone > max(over, ego.s) - ego.half_length - LEFT_BEHIND)
    if np.any(near.rear[against] - _run(-near.speed[against], time, patience) < ends):
        return False
    return kind == WITHIN or not np.any(aside & _comes_up(ego, near, patience))


def _pull(patience: float) -> float:
    return PULL + (1.0 - patience) * (FIRM_PULL - PULL)


def _time(ego: Ego, shift: Shift, ends: float, patience: float) -> float:
    """Seconds until the ego is back in its lane: the ramps' bends are driven slowly."""
    ramp = min(shift.full - shift.begin, shift.end - shift.leave)
    slow = math.sqrt(LATERAL / max(BEND * abs(shift.offset) / max(ramp, 1.0) ** 2, 1e-3))
    top = max(ego.wanted, 3.0)
    return float(time_to_cover(ends - ego.s, ego.speed, _pull(patience), 0.5 * (min(slow, top) + top))) + 0.3


def _run(speed: Floats, time: float, patience: float) -> Floats:
    """How far who comes against it gets meanwhile [m]; with less patience they are taken to slow down."""
    full = speed * (time + SPARE)
    braking = np.minimum(speed * REACTION + speed**2 / (2.0 * FAIR_BRAKING), full)
    return braking + patience * (full - braking)


def _comes_up(ego: Ego, near: Neighbours, patience: float) -> NDArray[np.bool_]:
    """(N,) who drives beside the ego, or comes from behind too fast to let it in."""
    front, back = ego.s + ego.half_length, ego.s - ego.half_length
    closing = np.maximum(near.speed - ego.speed, 0.0)
    braking = FIRM_BRAKING + patience * (EASY_BRAKING - FIRM_BRAKING)
    needed = 2.0 + FOLLOW_GAP * (0.4 + 0.6 * patience) * closing + closing**2 / (2.0 * braking)
    return (near.speed >= 0.3) & (near.rear < front + 3.0) & (near.front > back - needed)
