"""Conditional behaviour cloning behind the wheel: what LAV drives with, without what LAV sees and foresees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.cloning.network import CloningNetwork
from agents.lav.config import DriveConfig
from agents.lav.controller import planned_speed
from agents.lav.data.images import as_batch, shrunk
from agents.lav.devices import has_bfloat16
from agents.lav.driving import HALF_SIZE, Driver
from agents.lav.frames import vehicle_from_planner
from agents.lav.perceive import CAMERAS, SUITE
from agents.lav.readings import Waypointer, rgb_of, speed_of
from agents.lav.weights import Weights, read_weights
from lavsim.agent import Agent, Track
from lavsim.drawings import Drawing, polylines, scalar
from lavsim.errors import ConfigError
from lavsim.types import Control

Floats = NDArray[np.float64]

SHIPPED = Path(__file__).parent / "trained" / "cloning-tiny.safetensors"
_STAGE = "cloning"
_READ = (*CAMERAS, "GPS", "IMU", "EGO")


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "CloningAgent"


def read_cloning(path: str | None) -> Weights:
    """The weights in a file, in the folder of a training, or those that ship.

    Raises:
        ConfigError: there are none, or they are of another stage.
    """
    given = Path(path) if path else SHIPPED
    weights = read_weights(given / _STAGE / f"{_STAGE}.safetensors" if given.is_dir() else given)
    if weights.stage != _STAGE:
        raise ConfigError(f"{given.name} has weights of stage {weights.stage!r}, not {_STAGE!r}.")
    return weights


class CloningAgent(Agent):
    """Cloned behaviour: three cameras, speed, goals and command to waypoints; the baseline beside LAV."""

    def setup(self, path_to_conf_file: str | None) -> None:
        """Reads the weights: of a file, a training's folder, or those that ship."""
        self.track = Track.SENSORS
        torch.set_num_threads(1)
        weights = read_cloning(path_to_conf_file)
        self._cameras, self._drive = weights.config.cameras, DriveConfig()
        self._network = CloningNetwork(weights.config)
        self._network.load_state_dict(dict(weights.tensors))
        self._network.eval().requires_grad_(False)
        self._driver = Driver(self._drive, HALF_SIZE)
        self._way: Waypointer | None = None
        self._steer = 0.0
        self._plan: Floats | None = None

    def sensors(self) -> list[dict[str, Any]]:
        return [dict(sensor) for sensor in SUITE if sensor["id"] in _READ]

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        readings = {name: reading for name, (_, reading) in input_data.items()}
        if self._way is None:
            self._way = Waypointer(self._global_plan or [], self._drive.filtered)
        _, goals, command = self._way.update(readings, self._steer)
        speed, images = speed_of(readings), [rgb_of(readings[name]) for name in CAMERAS]
        self._plan = self.plan(images, speed, goals, command)
        # Standing is what it plans, as it does before a light: it is not taken to be stuck before LAV would be there.
        is_held = planned_speed(self._plan) < self._drive.stop_below
        control = self._driver.step(self._plan, {}, speed, command, is_held)
        self._steer = control.steer
        return control

    def plan(self, images: Sequence[NDArray[np.uint8]], speed: float, goals: Floats, command: int) -> Floats:
        """(T, 2) the commanded branch's plan in the planner frame [m].

        Args:
            images: Left, centre and right, (H, W, 3), red first.
            speed: Of the ego [m/s].
            goals: (2, 2) [m].
            command: 0 to 5.
        """
        size = self._cameras
        wide = np.concatenate([shrunk(image, size.width, size.height) for image in images], axis=1)
        told = torch.tensor([speed]), torch.from_numpy(goals.astype(np.float32))[None]
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16("cpu")):
            plans = self._network(as_batch([wide]), *told)
        return np.asarray(plans[0, command].double().numpy())

    def drawings(self) -> dict[str, Drawing]:
        """Its plan, how fast that is, and whether it stands because of it."""
        if self._plan is None:
            return {}
        return {
            "plan": polylines([vehicle_from_planner(self._plan)], frame="ego"),
            "planned speed": scalar(planned_speed(self._plan) * 3.6, "km/h"),
            **self._driver.drawings(),
        }
