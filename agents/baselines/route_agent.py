"""What the baselines share: a plan to follow, the ego's place on it, and the pedals and wheel that hold it there."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.control import Controller
from agents.behavior.path import PathTracker, ReferencePath, path_of_plan
from agents.privileged import PrivilegedAgent
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.types import Control

LEVEL = 3.0  # [m] above or below the ego somebody is on another road
FLAT = 0.3  # [m] things lower than that are driven over, as background traffic does


@dataclass(frozen=True)
class Pose:
    """The ego on its path: place s and offset to the right of it [m], yaw [rad], speed [m/s], half length [m]."""

    s: float
    offset: float
    yaw: float
    speed: float
    half_length: float


def obstacles(truth: Mapping[str, Any]) -> NDArray[np.int64]:
    """Rows of who and what could be run into: on the ego's level, and too high to be driven over."""
    is_level = np.abs(truth["xyz"][1:, 2] - truth["xyz"][0, 2]) < LEVEL
    return np.flatnonzero(is_level & (truth["sizes"][1:, 2] >= FLAT)) + 1


class RouteAgent(PrivilegedAgent):
    """Follows the dense plan; a subclass says how fast.

    Attributes:
        path: What to drive; known from the first step on.
        town: The town's map, likewise.
    """

    path: ReferencePath
    town: TownMap

    radius = 60.0

    def setup(self, path_to_conf_file: str | None) -> None:
        super().setup(path_to_conf_file)
        self._tracker: PathTracker | None = None

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        truth = input_data["truth"][1]
        if self._tracker is None:
            self.path, self.town = path_of_plan(self.dense_plan), load_town(truth["town"])
            self._tracker, self._controller = PathTracker(self.path), Controller()
            self.begin()
        s, offset = self._tracker.update(float(truth["xyz"][0, 0]), float(truth["xyz"][0, 1]))
        speed = max(float(truth["ego_speed"]), 0.0)
        pose = Pose(s, offset, float(truth["yaw"][0]), speed, float(truth["sizes"][0, 0]) / 2.0)
        return self.command(pose, self.acceleration(pose, truth))

    def begin(self) -> None:
        """Called once path and town are known."""

    @abstractmethod
    def acceleration(self, pose: Pose, truth: Mapping[str, Any]) -> float:
        """The acceleration it wants [m/s²]."""

    def command(self, pose: Pose, acceleration: float) -> Control:
        """Pedals and wheel for it; steers as the expert does."""
        return self._controller.command(self.path, pose.s, pose.offset, pose.yaw, pose.speed, acceleration)
