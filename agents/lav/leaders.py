"""Who goes the ego's way goes on as he goes, or brakes: what learned forecasts of leaders lack.

The likeliest learned branch of others is worse than constant velocity (`docs/lav-student.md`), and two-wheelers' ends
now before, now behind them: an ego that follows one closes up. So a leader is also taken to keep his velocity, and to
brake gently.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import TIME_STEP

Floats = NDArray[np.float64]

_WITHIN = np.cos(np.deg2rad(50.0))  # of the plan's direction


def same_way(plan: Floats, places: Floats, velocities: Floats) -> NDArray[np.bool_]:
    """(N,) whether velocities (N, 2) point along a plan (T, 2), there where it is nearest to places (N, 2).

    Velocities that are not known point nowhere.
    """
    steps = np.diff(plan, axis=0, prepend=np.zeros((1, 2)))
    apart = np.hypot(*(places[:, None] - plan[None]).transpose(2, 0, 1))
    along = steps[np.argmin(apart, axis=1)]
    length = np.hypot(*along.T) * np.hypot(*velocities.T)
    return np.asarray((along * velocities).sum(axis=1) > _WITHIN * np.maximum(length, 1e-3))


def leader_paths(places: Floats, velocities: Floats, steps: int, braking: float) -> Floats:
    """(N, 2, T, 2) of leaders at places (N, 2) with velocities (N, 2): straight on, and straight on braking [m/s²]."""
    time = TIME_STEP * np.arange(1, steps + 1)
    speeds = np.hypot(*velocities.T)[:, None]
    braked = np.minimum(time, speeds / braking)  # [s] until it stands
    lasting = np.where(speeds > 0.0, braked - 0.5 * braking * braked**2 / np.maximum(speeds, 1e-9), 0.0)
    times = np.stack([np.broadcast_to(time, lasting.shape), lasting], axis=1)
    return np.asarray(places[:, None, None] + times[..., None] * velocities[:, None, None])
