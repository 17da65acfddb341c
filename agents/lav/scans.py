"""LiDAR scans as they come: half sweeps put together, and past scans carried to where the ego is now."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import TIME_STEP, LavConfig
from agents.lav.data.points import turned
from agents.lav.localise import Pose
from lavsim.geometry import to_local
from lavsim.types import DT

Floats = NDArray[np.float32]

_APART = round(TIME_STEP / DT)  # ticks between the scans of a stack


class Scans:
    """What a tick's points stand beside.

    Args:
        config: How many scans make a stack.
    """

    def __init__(self, config: LavConfig) -> None:
        self._count = config.temporal.scans
        self._half: Floats = np.zeros((0, 4), np.float32)
        self._past: deque[tuple[int, Floats, Pose]] = deque(maxlen=_APART * (self._count - 1) + 1)
        self._tick = 0

    def merged(self, points: Floats) -> Floats:
        """Points (P, 4) of this tick's half sweep and then of the one before, in its own frame, as they are learnt."""
        scan, self._half = np.concatenate([points, self._half]), points
        self._tick += 1
        return scan

    def stacked(self, scan: Floats, pose: Pose) -> Floats:
        """A scan (P, F) with those before it, each with a tag of its age; as it is where scans are not stacked."""
        if self._count == 1:
            return scan
        self._past.append((self._tick, scan, pose))
        return np.concatenate([self._tagged(age, pose) for age in range(self._count)])

    def _tagged(self, age: int, now: Pose) -> Floats:
        """The newest scan that is so old, tagged and seen from where the ego is now; nothing where there is none."""
        old = [(scan, then) for tick, scan, then in self._past if tick <= self._tick - age * _APART]
        scan, then = old[-1] if old else (self._past[-1][1][:0], now)
        tags = np.zeros((len(scan), self._count), np.float32)
        tags[:, age] = 1.0
        points = np.concatenate([scan, tags], axis=1)
        if age:
            points[:, :2] = turned(points[:, :2], then.yaw - now.yaw) + to_local(then.xy, now.xy, now.yaw)
        return points
