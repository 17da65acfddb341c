"""The teacher behind the wheel: LAV's planner on true bird's-eye labels, the upper bound of what a student can learn.

Full stops are no part of its plans; what the brake network answers in the sensor agent, the truth sensor tells here:
lights, stop signs, and walkers who come into the way.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.behavior.path import PathTracker, path_of_plan
from agents.behavior.road import StopPoint, stop_points
from agents.lav.config import LavConfig
from agents.lav.data.arrays import grid_layers
from agents.lav.driving import (
    Driver,
    Forecasts,
    Outlook,
    drawings_of,
    goals_of,
    guide_of,
    outlook_of,
    straight_forecasts,
    vehicle_forecasts,
)  # fmt: skip
from agents.lav.frames import command_of, planner_from_vehicle, planner_from_world
from agents.lav.models.teacher import LABEL_LAYERS, MotionNetwork, make_teacher
from agents.lav.weights import read_weights
from agents.privileged import PrivilegedAgent
from lavsim.drawings import Drawing
from lavsim.errors import ConfigError
from lavsim.geometry import to_local, wrap_angle
from lavsim.guidance import Guide
from lavsim.map.town_map import load_town
from lavsim.sensors.bev import BevConfig
from lavsim.types import ActorClass, Control, LightState

Floats = NDArray[np.float64]

TEACHER = Path(__file__).parent / "trained" / "teacher-tiny.safetensors"
PIXELS_PER_METRE = 4.0  # the labels are drawn as the dataset's and made coarser as there
_SAME_LEVEL = 3.0  # [m]
_COMFORT = 3.5  # [m/s²] it brakes for a line when less would not do
_LINE_GAP, _OVER_LINE = 1.5, 2.5  # [m] kept before a stop line; over it by more, it drives on
_STANDS = 0.3  # [m/s]
_SIGN_REACH = 4.0  # [m] before a stop sign's line where standing counts


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "PrivilegedLavAgent"


class PrivilegedLavAgent(PrivilegedAgent):
    """LAV's teacher on true labels; the configuration is the file of its weights, those that ship by default."""

    radius = 60.0

    def setup(self, path_to_conf_file: str | None) -> None:
        super().setup(path_to_conf_file)
        torch.set_num_threads(1)
        weights = read_weights(Path(path_to_conf_file) if path_to_conf_file else TEACHER)
        if weights.stage != "bev":
            raise ConfigError(f"the teacher needs weights of stage 'bev', got those of {weights.stage!r}.")
        self.config = weights.config
        self.network: MotionNetwork = make_teacher(self.config).eval()
        self.network.load_state_dict(dict(weights.tensors))
        self._driver: Driver | None = None
        self._guide: Guide | None = None
        self._lines: _Lines | None = None
        self._bev = bev_sensor(self.config)
        self._drawn = BevConfig.parse(self._bev)
        self._shown: dict[str, Drawing] = {}

    def sensors(self) -> list[dict[str, Any]]:
        return [
            *super().sensors(),
            self._bev,
            {"type": "sensor.other.gnss", "id": "gps", "x": 0.0, "y": 0.0, "z": 2.4},
            {"type": "sensor.other.imu", "id": "imu", "x": 0.0, "y": 0.0, "z": 2.4},
            {"type": "sensor.speedometer", "id": "speed"},
        ]  # fmt: skip

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        truth = input_data["truth"][1]
        if self._guide is None or self._lines is None or self._driver is None:
            self._guide = guide_of(self._global_plan or [])
            path = path_of_plan(self.dense_plan)
            self._lines = _Lines(PathTracker(path), stop_points(path, load_town(truth["town"])))
            self._driver = Driver(self.config.drive, truth["sizes"][0, :2] / 2.0)
        self._guide.update(input_data["gps"][1])
        guidance = self._guide.now(float(input_data["imu"][1][6]))
        speed = max(float(input_data["speed"][1]["speed"]), 0.0)
        command = command_of(int(guidance.command))
        rows, poses = _vehicles(truth, self.config)
        speeds = np.linalg.norm(truth["velocities"][rows, :2], axis=1)
        speeds[0] = speed
        outlook = self._outlook(input_data["bev"][1], poses, speeds, goals_of(guidance), command)
        if self._lines.must_stop(truth, speed):
            return self._driver.halt(outlook.plan, speed, command)
        sizes, stands = truth["sizes"][rows[1:], :2] / 2.0, speeds[1:] < _STANDS
        vehicles = vehicle_forecasts(outlook, poses[1:].astype(np.float64), sizes, stands)
        walkers = _walkers(truth, len(outlook.plan))
        return self._driver.step(outlook.plan, [vehicles, walkers], speed, command)

    def drawings(self) -> dict[str, Drawing]:
        """Its plan and the likely forecasts."""
        return self._shown

    def _outlook(
        self, layers: NDArray[np.uint8], places: NDArray[np.float32], speeds: Floats, targets: Floats, command: int
    ) -> Outlook:
        image = torch.from_numpy(grid_layers(layers, self._drawn, self.config.grid)).float()
        poses, goals, known = (torch.from_numpy(part.astype(np.float32))[None] for part in (places, targets, speeds))
        with torch.inference_mode():
            outlook = outlook_of(self.network(image[None], poses, goals, known), poses, command, self.config.drive)
        self._shown = drawings_of(outlook, self.config.drive)
        return outlook


def bev_sensor(config: LavConfig) -> dict[str, Any]:
    """The sensor dict of true labels over a configuration's grid."""
    grid = config.grid
    return {
        "type": "sensor.lavsim.bev",
        "id": "bev",
        "attributes": {
            "layers": ",".join(LABEL_LAYERS),
            "width": round(2.0 * grid.aside * PIXELS_PER_METRE),
            "height": round((grid.ahead + grid.behind) * PIXELS_PER_METRE),
            "pixels_per_metre": PIXELS_PER_METRE,
            "ahead": (grid.ahead - grid.behind) / 2.0,
        },
    }


def _vehicles(truth: Mapping[str, Any], config: LavConfig) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Rows (R,) and poses (R, 3) of the ego and of the vehicles ahead of it within the radius, nearest first."""
    xyz, yaw = truth["xyz"], truth["yaw"]
    places = to_local(xyz[:, :2], xyz[0, :2], float(yaw[0]))
    distance = np.hypot(places[:, 0], places[:, 1])
    counts = (truth["classes"] <= ActorClass.BICYCLE) & (np.abs(xyz[:, 2] - xyz[0, 2]) < _SAME_LEVEL)
    counts &= (distance <= config.motion.radius) & (places[:, 0] > 0.0)
    counts[0] = False
    others = np.flatnonzero(counts)
    rows = np.concatenate([[0], others[np.argsort(distance[others], kind="stable")]])
    poses = np.zeros((len(rows), 3), np.float32)
    poses[:, :2] = planner_from_vehicle(places[rows])
    poses[:, 2] = wrap_angle(yaw[rows] - yaw[0])
    poses[0] = 0.0
    return rows, poses


def _walkers(truth: Mapping[str, Any], steps: int) -> Forecasts:
    """Walkers who go on as they go."""
    origin, yaw = truth["xyz"][0, :2], float(truth["yaw"][0])
    rows = np.flatnonzero(truth["classes"] == ActorClass.WALKER)
    places = planner_from_world(truth["xyz"][rows, :2], origin, yaw)
    velocities = planner_from_world(truth["velocities"][rows, :2], np.zeros(2), yaw)
    return straight_forecasts(places, velocities, steps)


class _Lines:
    """Stop lines on the way: red and yellow lights, and stop signs until it has stood before them."""

    def __init__(self, tracker: PathTracker, stops: list[StopPoint]) -> None:
        self._tracker, self._stops = tracker, stops
        self._signs_done: set[int] = set()

    def must_stop(self, truth: Mapping[str, Any], speed: float) -> bool:
        """Whether it has to brake now to stand before a line."""
        s, _ = self._tracker.update(float(truth["xyz"][0, 0]), float(truth["xyz"][0, 1]))
        front = s + float(truth["sizes"][0, 0]) / 2.0
        for number, stop in enumerate(self._stops):
            room = stop.s - stop.before - front
            if room < -_OVER_LINE:
                continue
            needed = speed * speed / (2.0 * max(room - _LINE_GAP, 0.1))
            if room > 60.0:
                return False
            if (room < _LINE_GAP + 0.5 or needed > _COMFORT) and self._holds(number, stop, truth, speed, room):
                return True
        return False

    def _holds(self, number: int, stop: StopPoint, truth: Mapping[str, Any], speed: float, room: float) -> bool:
        if stop.light >= 0:
            state = int(truth["lights"][stop.light])
            hard = speed * speed / (2.0 * max(room, 0.1)) > 2.0 * _COMFORT
            return state == LightState.RED or (state == LightState.YELLOW and not hard)
        if speed < 0.05 and room < _SIGN_REACH:
            self._signs_done.add(number)
        return number not in self._signs_done
