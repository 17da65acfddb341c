"""The path as it is driven: the route's own, shifted sideways where something has to be passed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.behavior.manner import Manner
from agents.behavior.path import STEP, ReferencePath, smoothed
from agents.behavior.speed import speed_profile
from lavsim.world.dynamics import REAR_LENGTH

Floats = NDArray[np.float64]

PAD = 12  # samples around a shift that are worked out with it
BLEND = 12.0  # [m]
BEND = math.pi**2 / 2.0  # a cosine ramp of length L over D metres sideways bends by BEND D / L² at most


@dataclass(frozen=True)
class Shift:
    """A stretch that is driven beside the route's path; places along it [m].

    Attributes:
        begin: Where it leaves the path, and
        full: is all the way aside;
        leave: where it begins to come back, and
        end: is back.
        offset: How far aside, to the right [m].
    """

    begin: float
    full: float
    leave: float
    end: float
    offset: float

    def at(self, s: Floats) -> Floats:
        """Offsets at places `s`."""
        rise = np.clip((s - self.begin) / max(self.full - self.begin, 1e-6), 0.0, 1.0)
        fall = np.clip((self.end - s) / max(self.end - self.leave, 1e-6), 0.0, 1.0)
        return self.offset * (0.5 - 0.5 * np.cos(np.pi * np.minimum(rise, fall)))


class Way:
    """A route's path with its speeds, and what is driven instead of it.

    Args:
        base: The route's path.
        limits: (S,) speed limits along it [m/s].
        manner: How it is driven.

    Attributes:
        path: What is driven. Places along it are those of `base`, so that lines and junctions keep theirs.
        profile: (S,) [m/s] how fast.
    """

    def __init__(self, base: ReferencePath, limits: Floats, manner: Manner) -> None:
        self.base, self._limits, self._manner = base, limits, manner
        self._offsets: Floats = np.zeros(len(base))
        self.path = base
        self.profile = self._base_profile = speed_profile(base, limits, manner)

    def offset_at(self, s: float) -> float:
        """How far beside the route's path it is driven [m]."""
        return self.base.at(self._offsets, s)

    def limit_at(self, s: float) -> float:
        """Speed limit at a place [m/s]."""
        return self.base.at(self._limits, s)

    def take(self, shift: Shift, now: float) -> None:
        """Drives `shift` from place `now` on; where it already is aside, that blends over within `BLEND`."""
        s: Floats = np.arange(len(self.base), dtype=np.float64) * STEP
        aside = shift.at(s)
        if np.any(self._offsets[s >= now]):
            share = 0.5 - 0.5 * np.cos(np.pi * np.clip((s - now) / BLEND, 0.0, 1.0))
            aside = self._offsets + share * (aside - self._offsets)
        self._offsets = np.where(s < now, self._offsets, aside)
        self.path = shifted(self.base, self._offsets)
        self.profile = speed_profile(self.path, self._limits, self._manner)

    def clear(self) -> None:
        """Goes back to the route's path."""
        self._offsets = np.zeros(len(self.base))
        self.path, self.profile = self.base, self._base_profile


def shifted(base: ReferencePath, offsets: Floats) -> ReferencePath:
    """`base` moved to the right by `offsets` (S,) [m], sample by sample."""
    aside = np.flatnonzero(offsets)
    if not len(aside):
        return base
    low, high = max(int(aside[0]) - PAD, 0), min(int(aside[-1]) + PAD + 1, len(base))
    part = slice(low, high)
    normal = np.stack([-np.sin(base.yaw[part]), np.cos(base.yaw[part])], axis=1)
    xy, yaw, curvature, heading = base.xy.copy(), base.yaw.copy(), base.curvature.copy(), base.heading.copy()
    xy[part] += offsets[part, None] * normal
    ahead = np.gradient(xy[part], axis=0)
    turned = np.arctan2(ahead[:, 1], ahead[:, 0]) - base.yaw[part]
    course = smoothed(base.yaw[part] + np.arctan2(np.sin(turned), np.cos(turned)))
    inner = slice(low + PAD // 2, high - PAD // 2)
    cut = slice(PAD // 2, high - low - PAD // 2)
    bend = smoothed(np.gradient(course) / np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 0.1))
    yaw[inner], curvature[inner] = course[cut], bend[cut]
    heading[inner] = yaw[inner] - np.arcsin(np.clip(curvature[inner] * REAR_LENGTH, -0.4, 0.4))
    return ReferencePath(xy, base.z, yaw, curvature, heading, base.options, base.end)
