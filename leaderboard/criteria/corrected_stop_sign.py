"""Running a stop sign, judged where its box lies: `--rules corrected`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.map.signal import Sign
from lavsim.world.snapshot import EgoState
from leaderboard.criteria.base import CRITERIA
from leaderboard.criteria.stop_sign import StopSign


@CRITERIA.register("corrected_stop_sign")
class CorrectedStopSign(StopSign):
    """Fires when the ego has driven through a sign's trigger box without coming to rest before or in it.

    1.0 asks whether the ego came to the POST, lets a stop 20 m before count, and keeps boxes parallel to the world.
    Here the box itself is what is entered, it is turned with its road, and a stop counts from 8 m before it (the
    distance is the centre's, so the bumper is some 5.5 m away).
    """

    name = "corrected_stop_sign"
    applies = ("corrected",)
    instead_of = "stop_sign"

    steps = {"1.0": (0.5, 16)}  # noqa: RUF012 - lane points ahead: spacing [m] and number

    def _inside(self, index: int, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        x, y, yaw, half_length, half_width = self._boxes[index]
        cos, sin = math.cos(yaw), math.sin(yaw)
        east, south = points[:, 0] - x, points[:, 1] - y
        return (np.abs(east * cos + south * sin) < half_length) & (np.abs(south * cos - east * sin) < half_width)

    def _is_entered(self, index: int, ego: EgoState) -> bool:
        return bool(self._inside(index, np.array([[ego.x, ego.y]]))[0])

    def _is_near(self, sign: Sign, index: int, ego: EgoState, points: NDArray[np.float64]) -> bool:
        return True  # the points ahead reach no farther than they should
