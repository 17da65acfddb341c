"""The teacher behind the wheel: LAV's planner on true bird's-eye labels, the upper bound of what a student can learn.

Full stops are no part of its plans; what the brake network answers in the sensor agent, the truth sensor tells here:
lights, stop signs, and walkers who come into the way.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.behavior.path import PathTracker, path_of_plan
from agents.behavior.road import stop_points
from agents.lav.config import LavConfig
from agents.lav.data.arrays import grid_layers
from agents.lav.driving import Driver, Outlook, drawings_of, goals_of, guide_of, outlook_of, vehicle_forecasts
from agents.lav.frames import command_of, forward_of
from agents.lav.models.teacher import LABEL_LAYERS, MotionNetwork, make_teacher
from agents.lav.told import StopLines, told_vehicles, told_walkers
from agents.lav.weights import read_weights
from agents.privileged import PrivilegedAgent
from lavsim.drawings import Drawing
from lavsim.errors import ConfigError
from lavsim.guidance import Guide
from lavsim.map.town_files import load_town
from lavsim.sensors.bev import BevConfig
from lavsim.types import Control

Floats = NDArray[np.float64]

TEACHER = Path(__file__).parent / "trained" / "teacher-tiny.safetensors"
PIXELS_PER_METRE = 4.0  # the labels are drawn as the dataset's and made coarser as there
_STANDS = 0.3  # [m/s]


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
        self._lines: StopLines | None = None
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
            self._lines = StopLines(PathTracker(path), stop_points(path, load_town(truth["town"])))
            self._driver = Driver(self.config.drive, truth["sizes"][0, :2] / 2.0)
        self._guide.update(input_data["gps"][1])
        guidance = self._guide.now(float(input_data["imu"][1][6]))
        speed = max(float(input_data["speed"][1]["speed"]), 0.0)
        command = command_of(int(guidance.command))
        rows, poses = told_vehicles(truth, self.config)
        speeds = np.linalg.norm(truth["velocities"][rows, :2], axis=1)
        speeds[0] = speed
        outlook = self.outlook(input_data["bev"][1], poses, speeds, goals_of(guidance), command)
        if self._lines.must_stop(truth, speed):
            return self._driver.halt(outlook.plan, speed, command)
        sizes, stands = truth["sizes"][rows[1:], :2] / 2.0, speeds[1:] < _STANDS
        others = poses[1:].astype(np.float64)
        velocities = speeds[1:, None] * forward_of(others[:, 2])
        vehicles = vehicle_forecasts(outlook, others, sizes, stands, velocities, self.config.drive.leader_brakes)
        walkers = told_walkers(truth, len(outlook.plan))
        return self._driver.step(outlook.plan, {"vehicle": vehicles, "walker": walkers}, speed, command)

    def drawings(self) -> dict[str, Drawing]:
        """Its plan and the likely forecasts."""
        return self._shown

    def outlook(
        self, layers: NDArray[np.uint8], places: NDArray[np.float32], speeds: Floats, targets: Floats, command: int
    ) -> Outlook:
        """The ego's plan and others' paths.

        Args:
            layers: What the sensor of `bev_sensor` says.
            places: (R, 3) poses in the planner frame, the ego's first.
            speeds: (R,) [m/s].
            targets: (2, 2) goals [m].
            command: 0 to 5.
        """
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
