"""Who of background traffic crossed the ego's way shortly before or after it: the post-encroachment time.

Source: Allen, Shin & Cooper 1978, "Analysis of traffic conflicts and collisions" (Transportation Research Record 667).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.types import DT, ActorIds
from lavsim.world.snapshot import Snapshot

_AROUND = 60.0  # [m] of the ego within which others are looked at
_MEET = 1.5  # [m] between two places that are the same
_CROSSING = np.cos(np.radians(25.0))  # who drives along the ego's way, or against it beside it, does not cross it


class Encounters:
    """Collects where the ego and background vehicles are, tick by tick."""

    def __init__(self) -> None:
        self._ego: list[tuple[float, float, float]] = []
        self._others: list[NDArray[np.float64]] = []  # (n, 5): tick, id, x, y, yaw

    def observe(self, snapshot: Snapshot) -> None:
        ego = snapshot.ego
        self._ego.append((*ego.xy.tolist(), ego.yaw))
        here = (snapshot.ids >= int(ActorIds.TRAFFIC)) & (snapshot.ids < int(ActorIds.WALKERS))
        rows = np.flatnonzero(here & (np.hypot(*(snapshot.xy - ego.xy).T) < _AROUND))
        tick = np.full(len(rows), len(self._ego) - 1.0)
        self._others.append(
            np.column_stack([tick, snapshot.ids[rows], snapshot.xy[rows], snapshot.yaw[rows]]).reshape(-1, 5)
        )

    def times(self) -> dict[int, float]:
        """Least time between the ego and each vehicle that crossed its way at the place where they crossed [s]."""
        others, ego = np.concatenate(self._others), np.array(self._ego)
        moving = np.append(True, np.hypot(*np.diff(ego[:, :2], axis=0).T) > 0.01)
        ticks = np.flatnonzero(moving)
        found: dict[int, float] = {}
        for tick, who, x, y, yaw in others.tolist():
            near = ticks[np.hypot(ego[ticks, 0] - x, ego[ticks, 1] - y) < _MEET]
            near = near[np.abs(np.cos(ego[near, 2] - yaw)) < _CROSSING]
            if len(near):
                apart = float(np.abs(near - tick).min()) * DT
                found[int(who)] = min(apart, found.get(int(who), np.inf))
        return found
