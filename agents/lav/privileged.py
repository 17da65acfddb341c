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
from agents.lav.config import COMMANDS, TIME_STEP, LavConfig
from agents.lav.controller import STOP, Controller, StuckCounter, collides, creep_path, planned_speed
from agents.lav.data.arrays import grid_layers
from agents.lav.frames import command_of, planner_from_vehicle, planner_from_world, vehicle_from_planner
from agents.lav.models.crop import to_planner
from agents.lav.models.teacher import LABEL_LAYERS, MotionNetwork, make_teacher
from agents.lav.weights import read_weights
from agents.privileged import PrivilegedAgent
from lavsim.drawings import Drawing, polylines, scalar
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
_WALKER_REACH = 0.7  # [m] kept free around a walker
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
        self._controller = Controller(self.config.drive)
        self._stuck = StuckCounter(self.config.drive)
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
        if self._guide is None or self._lines is None:
            nodes = self._global_plan or []
            gps = np.array([[node["lat"], node["lon"]] for node, _ in nodes])
            self._guide = Guide(gps, [int(option) for _, option in nodes])
            path = path_of_plan(self.dense_plan)
            self._lines = _Lines(PathTracker(path), stop_points(path, load_town(truth["town"])))
        self._guide.update(input_data["gps"][1])
        guidance = self._guide.now(float(input_data["imu"][1][6]))
        speed = max(float(input_data["speed"][1]["speed"]), 0.0)
        command = command_of(int(guidance.command))
        rows, poses = _vehicles(truth, self.config)
        speeds = np.linalg.norm(truth["velocities"][rows, :2], axis=1)
        speeds[0] = speed
        goals = np.stack([guidance.goal, guidance.next_goal]).astype(np.float64)
        plan, others, likelihood = self._motions(input_data["bev"][1], poses, speeds, goals, command)
        # Whoever stands may pull out, but held for it the ego would not pass a parked car.
        stands = speeds[1:] < _STANDS
        others[stands] = poses[1:, None, None, :2][stands]
        control = self._controller.follow(plan, speed, command)
        halted = Control(steer=control.steer, brake=STOP.brake)
        if self._lines.must_stop(truth, speed):
            return halted  # who waits for a light is not stuck
        boxes = np.column_stack([poses[:, 2], truth["sizes"][rows, :2] / 2.0]).astype(np.float64)
        walkers = _walkers(truth, len(plan), boxes[0])
        is_hit = collides(plan, others, likelihood, boxes, self.config.drive)
        is_hit |= collides(plan, *walkers, self.config.drive)
        inch = creep_path(len(plan))
        is_free = not collides(inch, others, likelihood, boxes, self.config.drive)
        is_free &= not collides(inch, *walkers, self.config.drive)
        return self._stuck.step(halted if is_hit else control, speed, is_free)

    def drawings(self) -> dict[str, Drawing]:
        """Its plan and the likely forecasts."""
        return self._shown

    def _motions(
        self, layers: NDArray[np.uint8], places: NDArray[np.float32], speeds: Floats, targets: Floats, command: int
    ) -> tuple[Floats, Floats, Floats]:
        """The plan (T, 2), forecasts (N, 6, T, 2) of others and their likelihoods (N, 6), in the planner's frame."""
        image = torch.from_numpy(grid_layers(layers, self._drawn, self.config.grid)).float()
        poses = torch.from_numpy(places)
        goals = torch.from_numpy(planner_from_vehicle(targets).astype(np.float32))
        known = torch.from_numpy(speeds.astype(np.float32))
        with torch.inference_mode():
            motions = self.network(image[None], poses[None], goals[None], known[None])
            own = motions.refined[0, -1] if motions.refined.shape[1] else motions.coarse[0, 0]
            if command >= 4 and not self.config.drive.refined_lane_change:
                own = motions.coarse[0, 0]
            others = to_planner(motions.coarse[0, 1:], poses[1:, None])
            likelihood = torch.sigmoid(motions.commands[0, 1:])
        plan = own[command].numpy().astype(np.float64)
        found = others.numpy().astype(np.float64), likelihood.numpy().astype(np.float64)
        self._show(plan, *found)
        return plan, *found

    def _show(self, plan: Floats, others: Floats, likelihood: Floats) -> None:
        likely = likelihood >= self.config.drive.likely
        self._shown = {
            "plan": polylines([vehicle_from_planner(plan)], frame="ego"),
            "forecast": polylines(list(vehicle_from_planner(others[likely])), likelihood[likely], frame="ego"),
            "planned speed": scalar(planned_speed(plan) * 3.6, "km/h"),
        }


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


def _walkers(truth: Mapping[str, Any], steps: int, ego: Floats) -> tuple[Floats, Floats, Floats]:
    """Walkers ahead who go on as they go: forecasts (N, 6, T, 2), likelihoods (N, 6) and boxes (1 + N, 3)."""
    xyz, yaw = truth["xyz"], float(truth["yaw"][0])
    rows = np.flatnonzero(truth["classes"] == ActorClass.WALKER)
    time = TIME_STEP * np.arange(1, steps + 1)[:, None]
    world = xyz[rows, None, :2] + truth["velocities"][rows, None, :2] * time
    paths = planner_from_world(world, xyz[0, :2], yaw)
    forecasts = np.broadcast_to(paths[:, None], (len(rows), COMMANDS, steps, 2))
    boxes = np.concatenate([ego[None], np.tile([0.0, _WALKER_REACH, _WALKER_REACH], (len(rows), 1))])
    return forecasts, np.ones((len(rows), COMMANDS)), boxes


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
