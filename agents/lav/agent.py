"""LAV from sensors alone: cameras paint points, points tell who is where, motions are foreseen, and one is driven.

The order within a tick is the original's (reference `lav.md` 6.2); what differs is in `docs/lav-agent.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from agents.lav.bumper import Bumper
from agents.lav.config import DriveConfig
from agents.lav.controller import BrakeHold
from agents.lav.data.points import SCORES
from agents.lav.driving import (
    HALF_SIZE,
    Driver,
    Forecasts,
    Outlook,
    drawings_of,
    outlook_of,
    straight_forecasts,
    vehicle_forecasts,
)  # fmt: skip
from agents.lav.frames import vehicle_from_planner
from agents.lav.halting import FREE, Signals, Told
from agents.lav.localise import Pose
from agents.lav.look import Look, carried_forecasts, carried_outlook, carried_points, carried_sight
from agents.lav.models.detection import Detections
from agents.lav.others import Found, Others
from agents.lav.perceive import CAMERAS, LIDAR, LIDAR_HEIGHT, SUITE, TELEPHOTO, Perceiver, Sight, read_trained
from agents.lav.readings import Asked, Readings, Waypointer, rgb_of, speed_of
from agents.lav.scans import Scans
from lavsim.agent import Agent, Track
from lavsim.config import Config, read_config
from lavsim.drawings import Drawing, boxes, points, raster, scalar
from lavsim.types import DT, Control

Floats = NDArray[np.float64]

_SHOWN_SCORE, _SHOWN_LEVELS = 0.3, 8  # of a painted point; of the map, whose few levels pack well
_PAINTED = {"painted vehicle": 3, "painted walker": 0}  # among a point's scores


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "LavAgent"


class LavSettings(Config):
    """What drives, and how. How to drive is no part of what was learnt: the weights' own `drive` is not used."""

    weights: str = Field(default="", description="Folder or file as `--agent-config` takes it; empty: those that ship.")
    drive: DriveConfig = DriveConfig()


def read_settings(path: str | None) -> LavSettings:
    """The settings in a TOML file, or those that go with weights.

    Raises:
        ConfigError: the file can't be read, or holds something else.
    """
    if path and path.endswith(".toml"):
        return read_config(LavSettings, Path(path))
    return LavSettings(weights=path or "")


class LavAgent(Agent):
    """The student behind the wheel.

    Its configuration is the folder of a training, the file of a student's weights, or a TOML file with `LavSettings`;
    without one the weights that ship drive.
    """

    def setup(self, path_to_conf_file: str | None) -> None:
        self.begin(read_settings(path_to_conf_file))

    def begin(self, given: LavSettings) -> None:
        """Reads the weights and begins to drive."""
        self.track = Track.SENSORS
        torch.set_num_threads(1)
        self._eyes = Perceiver(read_trained(given.weights or None), given.drive)
        self.config = self._eyes.config
        self._driver, self._hold = Driver(self.config.drive, HALF_SIZE), BrakeHold(self.config.drive)
        self._bumper = Bumper(self.config.drive, HALF_SIZE)
        self._scans = Scans(self.config)
        self._others = Others(self.config.drive)
        self._way: Waypointer | None = None
        self._tick, self._steer, self._told = 0, 0.0, Told(0.0)
        self._signals = Signals(self.config.drive)
        self._look: Look | None = None
        self._pose = Pose(np.zeros(2), 0.0)

    def sensors(self) -> list[dict[str, Any]]:
        return [dict(sensor) for sensor in SUITE]

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        readings = {name: reading for name, (_, reading) in input_data.items()}
        if self._way is None:
            self._way = Waypointer(self._global_plan or [], self.config.drive.filtered)
        asked = self._way.update(readings, self._steer)
        speed, images = speed_of(readings), [rgb_of(readings[name]) for name in CAMERAS]
        sweep = self._scans.merged(readings[LIDAR])
        if self._look is None or self._tick % self.config.drive.look_every == 0:
            self._look = self.look(sweep, images, asked, readings)
        is_held, allowed = self.signals(images, readings, speed)
        self._tick, self._pose = self._tick + 1, asked.pose
        plan = carried_points(self._look.outlook.plan, self._look.pose, self._pose)
        others = carried_forecasts(self._look.others, self._look.pose, self._pose)
        control = self._driver.step(plan, others, speed, asked.command, is_held, allowed)
        if self._bumper.step(self._look.sight.points, LIDAR_HEIGHT, control.steer, speed):
            control = Control(steer=control.steer, brake=1.0)
        self._steer = control.steer
        return control

    def drawings(self) -> dict[str, Drawing]:
        """Plan, forecasts, who was found, who is in the way, the map, painted points, and how sure it is to brake."""
        if self._look is None:
            return {}
        then, now, sight = self._look.pose, self._pose, self._look.sight
        sight = carried_sight(sight, then, now)
        return {
            **drawings_of(carried_outlook(self._look.outlook, then, now), self.config.drive),
            "vehicles": _drawn_boxes(sight.vehicles),
            "walkers": _drawn_boxes(sight.walkers),
            "road": self._drawn_map(sight),
            **(_drawn_paint(sight.points) if self.config.painted else {}),
            **self._drawn_signals(),
            **self._driver.drawings(),
        }

    def look(
        self, sweep: NDArray[np.float32], images: Sequence[NDArray[np.uint8]], asked: Asked, readings: Readings
    ) -> Look:
        """What the networks see in a sweep (P, 4) and three images, and foresee."""
        pose, goals, command = asked
        sight = self._eyes.see(self._scans.stacked(self._eyes.paint(sweep, images), pose))
        found = self.found(sight, pose, readings)
        outlook = self.outlook(sight, found, goals, speed_of(readings), command, readings)
        return Look(pose, sight, outlook, self._forecasts(outlook, found))

    def found(self, sight: Sight, pose: Pose, readings: Readings) -> Found:
        """Who is taken to be there: what is seen, with speeds from where it was seen before."""
        moved = speed_of(readings) * DT * self.config.drive.look_every
        return self._others.update(sight.vehicles, sight.walkers, pose, moved)

    def signals(self, images: Sequence[NDArray[np.uint8]], readings: Readings, speed: float) -> tuple[bool, float]:
        """Whether to brake at once, and the speed [m/s] that lights and signs ahead allow."""
        drive = self.config.drive
        # Looks of the two take turns: no tick pays for both.
        is_new = self._tick == 0 or (self._tick + 1) % drive.brake_every == 0
        if is_new:
            self._told = self._eyes.brake(images, rgb_of(readings[TELEPHOTO]))
        if not self._told.tells_causes:
            return self._hold.step(self._told.stop, speed), FREE
        is_stopped = self._told.others > drive.others_score and speed > drive.stop_below
        return is_stopped, self._signals.step(self._told, is_new, speed)

    def outlook(
        self, sight: Sight, found: Found, goals: Floats, speed: float, command: int, readings: Readings
    ) -> Outlook:
        """The ego's plan, and forecasts of the vehicles found."""
        poses = torch.from_numpy(np.concatenate([np.zeros((1, 3)), found.vehicles[:, :3]]).astype(np.float32))[None]
        known = torch.from_numpy(np.concatenate([[speed], found.speeds]).astype(np.float32))[None]
        targets = torch.from_numpy(goals.astype(np.float32))[None]
        motions = self._eyes.foresee(sight.features, poses, targets, known)
        return outlook_of(motions, poses, command, self.config.drive)

    def _forecasts(self, outlook: Outlook, found: Found) -> dict[str, Forecasts]:
        """Who may come into the way, by kind."""
        drive, boxes = self.config.drive, found.vehicles
        stands = found.speeds < drive.standing  # not so where they are not known
        sizes = np.maximum(boxes[:, 3:] - drive.slack * stands[:, None], 0.5 * boxes[:, 3:])
        return {
            "vehicle": vehicle_forecasts(outlook, boxes[:, :3], sizes, stands, found.velocities, drive.leader_brakes),
            "walker": straight_forecasts(found.walkers, found.walking, len(outlook.plan)),
        }

    def _drawn_signals(self) -> dict[str, Drawing]:
        told = self._told
        if not told.tells_causes:
            return {"brake": scalar(told.stop)}
        names = {"brake": told.stop, "red or yellow": told.red + told.yellow, "stop sign": told.sign}
        shown = {name: scalar(value) for name, value in {**names, "others": told.others}.items()}
        return {**shown, "to the line": scalar(told.distance, "m")}

    def _drawn_map(self, sight: Sight) -> Drawing:
        grid = self.config.grid
        road, solid, broken = torch.sigmoid(sight.map).numpy()
        shown = np.round((0.5 * road + 0.5 * np.maximum(solid, broken)) * _SHOWN_LEVELS) / _SHOWN_LEVELS
        return raster(shown, ((grid.ahead - grid.behind) / 2.0, 0.0, 0.0), grid.cell, "ego")


def _drawn_boxes(found: Detections) -> Drawing:
    box = found.boxes.numpy().astype(np.float64)
    poses = np.column_stack([vehicle_from_planner(box[:, :2]), box[:, 2], 2.0 * box[:, 3:]])
    return boxes(poses, found.scores.numpy(), frame="ego")


def _drawn_paint(scan: NDArray[np.float32]) -> dict[str, Drawing]:
    """Points that the cameras painted as somebody; all of them would hide the street."""
    scores = scan[:, 4 : 4 + SCORES]
    kinds = {name: (scores[:, k] > _SHOWN_SCORE, scores[:, k]) for name, k in _PAINTED.items()}
    return {
        name: points(np.round(scan[shown, :2], 1), np.round(score[shown], 1), "ego")
        for name, (shown, score) in kinds.items()
    }
