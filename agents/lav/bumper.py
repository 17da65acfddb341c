"""What the LiDAR has right before the bumper, whether anybody was found there or not: the last thing that brakes.

Networks miss who stands close beside something bigger: a cyclist whom the ego has let cross, and who waits beside a
truck, is gone for them, but not for the points. Right before the bumper these begin 1.0 m above the ground, where the
LiDAR's lowest ring is: what is lower there, as a bicycle's wheel, is seen by nobody.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import DriveConfig
from lavsim.types import DT
from lavsim.world.dynamics import steer_curvature

Floats = NDArray[np.float32]

_LOW, _SLOPE, _HIGH = 0.3, 0.03, 2.0  # [m] over the ground, more for each metre ahead; below what may hang over a road
_MARGIN = 0.1  # [m] beside the ego
_LEAST = 3  # points
_FASTEST = 5.0  # [m/s] who is faster looks farther ahead than this does
_NEAR, _REACTION, _BRAKES = 0.4, 0.25, 7.0  # [m], [s], [m/s²]: how far before the bumper it looks
_STANDS = 0.1  # [m/s]
_LET_GO = 3.0  # [s] in which it is not asked after it has held for long


class Bumper:
    """Says whether something is so near ahead that only full brakes help.

    Args:
        config: For how long it holds who stands: points stay where a wreck lies.
        half_size: (2,) half length and half width of the ego [m].
    """

    def __init__(self, config: DriveConfig, half_size: Sequence[float]) -> None:
        self._patience, self._length = round(config.bumper / DT), round(_LET_GO / DT)
        self._front, self._side = half_size
        self._stood = self._left = 0

    def step(self, scan: Floats, height: float, steer: float, speed: float) -> bool:
        """Whether to brake fully at this tick.

        Args:
            scan: (P, F) points ahead, right, up of the LiDAR [m].
            height: Of the LiDAR over the ground [m].
            steer: What is asked for, -1 to 1.
            speed: Of the ego [m/s].
        """
        self._left -= 1
        if not self._patience or self._left > 0 or speed > _FASTEST:
            return False
        blocks = self._is_blocked(scan, height, steer, speed)
        self._stood = self._stood + 1 if blocks and speed < _STANDS else 0
        if self._stood >= self._patience:
            self._stood, self._left = 0, self._length
            return False
        return blocks

    def _is_blocked(self, scan: Floats, height: float, steer: float, speed: float) -> bool:
        reach = _NEAR + _REACTION * speed + speed * speed / (2.0 * _BRAKES)
        ahead = scan[:, 0]
        near = scan[(ahead > self._front) & (ahead < self._front + reach)]
        ahead, up = near[:, 0], near[:, 2] + height
        aside = near[:, 1] - 0.5 * steer_curvature(steer) * ahead * ahead
        is_body = (up > _LOW + _SLOPE * ahead) & (up < _HIGH)
        return int((is_body & (np.abs(aside) < self._side + _MARGIN)).sum()) >= _LEAST
