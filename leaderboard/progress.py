"""Where the ego is: along its route, by the plane tests that the original criteria use, and far from what matters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.map.route import Route

SLACK = 0.1  # [m] far more than rounding: quick tests that spare an exact one leave this much


class PlaneProgress:
    """Index of the last route point whose plane the ego has crossed.

    A point counts as passed when the ego is on the far side of the plane through it, square to the road; there is no
    lateral limit. Each criterion looks another number of points ahead, so each has its own.

    Args:
        route: The dense route.
        window: Points beyond the current one that are tested in a tick.
    """

    def __init__(self, route: Route, window: int) -> None:
        # Python floats: three points a tick are tested faster one by one than through numpy.
        self._x = [float(v) for v in route.points[:, 0]]
        self._y = [float(v) for v in route.points[:, 1]]
        self._ahead = [(math.cos(yaw), math.sin(yaw)) for yaw in route.yaw]
        self._window = window
        self.index = 0

    def advance(self, x: float, y: float) -> list[int]:
        """Points passed since the last call with the ego now at x, y [m], in route order; some may be skipped."""
        passed = []
        for index in range(self.index + 1, min(self.index + self._window + 1, len(self._x))):
            ahead = self._ahead[index]
            if (x - self._x[index]) * ahead[0] + (y - self._y[index]) * ahead[1] > 0.0:
                passed.append(index)
        if passed:
            self.index = passed[-1]
        return passed


class Clear:
    """Says without looking at all of some points again that none is within reach.

    Args:
        x: (N,) of the points [m].
        y: Likewise.
        reach: [m].
    """

    def __init__(self, x: NDArray[np.float64], y: NDArray[np.float64], reach: float) -> None:
        self._x, self._y, self._reach = x, y, reach
        self._centre, self._radius = (0.0, 0.0), -1.0

    def holds(self, x: float, y: float) -> bool:
        """Whether surely no point is within reach of the ego at x, y [m]."""
        if math.dist((x, y), self._centre) < self._radius:
            return True
        nearest = math.sqrt(float(np.min((self._x - x) ** 2 + (self._y - y) ** 2, initial=math.inf)))
        self._centre, self._radius = (x, y), nearest - self._reach - SLACK
        return self._radius > 0.0
