"""LAV with some of its work done by the truth: which part costs what.

    lavsim score --agent agents.lav.helped:HelpedLavAgent --agent-config helped.toml …

with `truth = ["brake"]` in the file, and whatever else `LavSettings` has. The difference to the same drive without is
what that part costs. It reads privileged state, so it is on the track PRIVILEGED.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from agents.behavior.path import PathTracker, path_of_plan
from agents.behavior.road import stop_points
from agents.lav.agent import LavAgent, LavSettings, Readings
from agents.lav.config import TIME_STEP
from agents.lav.driving import Outlook
from agents.lav.frames import forward_of
from agents.lav.halting import FREE
from agents.lav.localise import Pose
from agents.lav.others import Found
from agents.lav.perceive import Sight
from agents.lav.privileged import PrivilegedLavAgent, bev_sensor
from agents.lav.told import StopLines, told_vehicles, told_walkers
from agents.privileged import PrivilegedAgent
from lavsim.agent import Track
from lavsim.config import read_config
from lavsim.map.town_files import load_town

Floats = NDArray[np.float64]
Part = Literal["brake", "detections", "plan"]


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "HelpedLavAgent"


class HelpedSettings(LavSettings):
    """Which parts are replaced."""

    truth: tuple[Part, ...] = ()


class HelpedLavAgent(PrivilegedAgent, LavAgent):
    """LAV with its brake network, detections or plan replaced by the truth, as its configuration says."""

    radius = 60.0

    def setup(self, path_to_conf_file: str | None) -> None:
        given = read_config(HelpedSettings, Path(path_to_conf_file)) if path_to_conf_file else HelpedSettings()
        self._truth = given.truth
        self.begin(given)
        self.track = Track.PRIVILEGED
        self._lines: StopLines | None = None
        self._teacher = PrivilegedLavAgent(None) if "plan" in given.truth else None

    def sensors(self) -> list[dict[str, Any]]:
        bev = [bev_sensor(self._teacher.config)] if self._teacher else []
        return [*LavAgent.sensors(self), *PrivilegedAgent.sensors(self), *bev]

    def signals(self, images: Sequence[NDArray[np.uint8]], readings: Readings, speed: float) -> tuple[bool, float]:
        told = super().signals(images, readings, speed)
        if "brake" not in self._truth:
            return told
        if self._lines is None:
            path = path_of_plan(self.dense_plan)
            self._lines = StopLines(PathTracker(path), stop_points(path, load_town(readings["truth"]["town"])))
        return self._lines.must_stop(readings["truth"], speed), FREE

    def found(self, sight: Sight, pose: Pose, readings: Readings) -> Found:
        found = super().found(sight, pose, readings)
        if "detections" not in self._truth:
            return found
        return self.told(readings["truth"])

    def told(self, truth: Mapping[str, Any]) -> Found:
        """Who is there, of the truth sensor's reading."""
        rows, poses = (part[1 : 1 + self.config.drive.forecasts] for part in told_vehicles(truth, self.config))
        walkers = told_walkers(truth, 2).paths[:, 0]
        return Found(
            np.column_stack([poses, truth["sizes"][rows, :2] / 2.0]).astype(np.float64),
            np.linalg.norm(truth["velocities"][rows, :2], axis=1)[:, None] * forward_of(poses[:, 2]),
            2.0 * walkers[:, 0] - walkers[:, 1],
            (walkers[:, 1] - walkers[:, 0]) / TIME_STEP,
        )

    def outlook(
        self, sight: Sight, found: Found, goals: Floats, speed: float, command: int, readings: Readings
    ) -> Outlook:
        if self._teacher is None:
            return super().outlook(sight, found, goals, speed, command, readings)
        poses = np.concatenate([np.zeros((1, 3)), found.vehicles[:, :3]]).astype(np.float32)
        speeds = np.concatenate([[speed], found.speeds])
        return self._teacher.outlook(readings["bev"], poses, speeds, goals, command)
