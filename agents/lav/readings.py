"""What the agents on sensors read: speed, images, where they are, and what their plan asks for there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.lav.driving import goals_of, guide_of
from agents.lav.frames import command_of
from agents.lav.localise import EgoFilter, Pose

Readings = Mapping[str, Any]


class Asked(NamedTuple):
    """What holds at a tick.

    Attributes:
        pose: Of the ego, in the filter's frame.
        goals: (2, 2) the next two goal points in the planner frame [m].
        command: 0 to 5.
    """

    pose: Pose
    goals: NDArray[np.float64]
    command: int


class Waypointer:
    """Follows a thinned plan by GNSS, compass, speed and steering.

    Args:
        plan: As an agent is given it.
        filtered: Whether goals are seen from the filter's place, not from the newest fix.
    """

    def __init__(self, plan: Sequence[tuple[Mapping[str, float], Any]], filtered: bool) -> None:
        self._guide, self._place, self._filtered = guide_of(plan), EgoFilter(), filtered

    def update(self, readings: Readings, steer: float) -> Asked:
        """What holds now.

        Args:
            readings: Of GPS, IMU and EGO.
            steer: What was asked at the tick before, -1 to 1.
        """
        pose = self._place.update(readings["GPS"], float(readings["IMU"][6]), speed_of(readings), steer)
        self._guide.update(self._place.gps() if self._filtered else readings["GPS"])
        guidance = self._guide.now(pose.yaw + np.pi / 2.0)
        return Asked(pose, goals_of(guidance), command_of(int(guidance.command)))


def speed_of(readings: Readings) -> float:
    """Of the ego [m/s]; noise can make it negative."""
    return max(float(readings["EGO"]["speed"]), 0.0)


def rgb_of(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) red first of a camera's (H, W, 4), blue first."""
    return np.ascontiguousarray(image[..., 2::-1])
