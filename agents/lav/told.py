"""What LAV's agents on privileged state are told: who is there, and which stop lines hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.path import PathTracker
from agents.behavior.road import StopPoint
from agents.lav.config import LavConfig
from agents.lav.driving import Forecasts, straight_forecasts
from agents.lav.frames import planner_from_vehicle, planner_from_world
from lavsim.geometry import to_local, wrap_angle
from lavsim.types import ActorClass, LightState

_SAME_LEVEL = 3.0  # [m]
_COMFORT = 3.5  # [m/s²] it brakes for a line when less would not do
_LINE_GAP, _OVER_LINE = 1.5, 2.5  # [m] kept before a stop line; over it by more, it drives on
_SIGN_REACH = 4.0  # [m] before a stop sign's line where standing counts


def told_vehicles(truth: Mapping[str, Any], config: LavConfig) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
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


def told_walkers(truth: Mapping[str, Any], steps: int) -> Forecasts:
    """Walkers who go on as they go."""
    origin, yaw = truth["xyz"][0, :2], float(truth["yaw"][0])
    rows = np.flatnonzero(truth["classes"] == ActorClass.WALKER)
    places = planner_from_world(truth["xyz"][rows, :2], origin, yaw)
    velocities = planner_from_world(truth["velocities"][rows, :2], np.zeros(2), yaw)
    return straight_forecasts(places, velocities, steps)


class StopLines:
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
