"""Looking before driving against traffic: the rules of 2.x forbid the other lane for 5 s after coming near."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lavsim.types import ActorClass

LONG_ENOUGH = 5.3  # [s]
SLOWEST = 2.0  # [m/s]
NEAR_VEHICLES, NEAR_THINGS = 50.0, 30.0  # [m] to the obstacle from where on it counts
SAME = 18.0  # [m] between places of the same obstacle
BRAKING = 2.0  # [m/s²] before that


class Look:
    """How long it has been near what it is going to pass."""

    def __init__(self) -> None:
        self._place = -math.inf  # [m along the way]
        self._outside = math.inf  # [m] that it still is from being near
        self._since = math.inf  # [s]
        self._time = 0.0

    def note(self, place: float, truth: Mapping[str, Any], row: int) -> None:
        """Takes in where the obstacle is that begins at `place` [m along the way] with actor `row`."""
        if abs(place - self._place) > SAME:
            self._place, self._since = place, math.inf
        near = NEAR_THINGS if truth["classes"][row] == ActorClass.PROP else NEAR_VEHICLES
        self._outside = max(float(np.hypot(*(truth["xyz"][row, :2] - truth["xyz"][0, :2]))) - near, 0.0)
        self._time = float(truth["time"])
        if self._outside == 0.0:
            self._since = min(self._since, self._time)

    def pace(self, over: float, speed: float) -> float:
        """Speed at which it will have looked for long enough when it comes over the line [m/s]; inf: it will have.

        Args:
            over: How far the line is away, along the way [m].
            speed: Its own [m/s].
        """
        over, left = max(over, 0.0), LONG_ENOUGH - max(self._time - self._since, 0.0)
        if over / max(speed, SLOWEST) > left:
            return math.inf
        return math.sqrt(max((over - self._outside) / left, SLOWEST) ** 2 + 2.0 * BRAKING * self._outside)
