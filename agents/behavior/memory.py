"""What the expert remembers of others from tick to tick, by id: who brakes, who turns, who has stood for how long."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

Floats = NDArray[np.float64]

AVERAGED = 0.3  # [s] over which measured accelerations and turn rates are averaged
STILL = 0.1  # [m/s]
SPEED, YAW, ACCELERATION, TURN, STOOD = range(5)  # columns: [m/s], [rad], [m/s²], [rad/s], [s]


class Memory:
    """One row an actor of the last reading, in its order.

    Attributes:
        now: (N, 5) columns above.
    """

    def __init__(self) -> None:
        self.now: Floats = np.zeros((0, 5))
        self._ids: NDArray[np.int32] = np.zeros(0, np.int32)
        self._time = -math.inf

    def update(self, truth: Mapping[str, Any]) -> Floats:
        """The memory after another reading; who is there for the first time has no acceleration yet."""
        dt = float(truth["time"]) - self._time
        self._time = float(truth["time"])
        ids = truth["ids"]
        fresh = np.empty((len(ids), 5))
        _remember(self._ids, self.now, ids, truth["velocities"], truth["yaw"], dt if 0.0 < dt < 1.0 else 0.0, fresh)
        self._ids, self.now = ids.copy(), fresh
        return fresh


@kernel
def _remember(
    old_ids: NDArray[np.int32],
    old: Floats,
    ids: NDArray[np.int32],
    velocities: Floats,
    yaw: Floats,
    dt: float,
    fresh: Floats,
) -> None:
    """Readings keep their order, so each actor is found right behind the one before, or not at all."""
    share = min(dt / AVERAGED, 1.0)
    count, at = len(old_ids), 0
    for k in range(len(ids)):
        speed = math.sqrt(velocities[k, 0] ** 2 + velocities[k, 1] ** 2)
        fresh[k, SPEED], fresh[k, YAW] = speed, yaw[k]
        fresh[k, ACCELERATION], fresh[k, TURN], fresh[k, STOOD] = 0.0, 0.0, 0.0
        for step in range(count):
            j = at + step if at + step < count else at + step - count
            if old_ids[j] == ids[k]:
                at = j + 1 if j + 1 < count else 0
                if dt > 0.0:
                    turned = yaw[k] - old[j, YAW]
                    turned -= 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
                    a, w = old[j, ACCELERATION], old[j, TURN]
                    fresh[k, ACCELERATION] = a + share * ((speed - old[j, SPEED]) / dt - a)
                    fresh[k, TURN] = w + share * (turned / dt - w)
                if speed < STILL:
                    fresh[k, STOOD] = old[j, STOOD] + dt
                break
