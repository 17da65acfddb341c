"""The textbook: pure pursuit of a point ahead, a PID for speed, a brake for whoever stands in the way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from agents.baselines.route_agent import Pose, RouteAgent, obstacles
from agents.behavior.control import pedals
from agents.behavior.manner import Manner
from agents.behavior.path import STEP
from agents.behavior.road import limits_along, stop_points
from agents.behavior.speed import speed_profile, stopping
from lavsim.types import Control, LightState
from lavsim.world.dynamics import FRONT_LENGTH, MAX_WHEEL_ANGLE, REAR_LENGTH

AHEAD_TIME, AHEAD_LEAST = 0.6, 4.0  # [s], [m] to the point pursued
HALF_LANE = 1.4  # [m] beside the path in which somebody is in the way
LOOK = 40.0  # [m]
KEEP = 4.0  # [m] behind whoever is in the way
GAIN = 1.2  # [1/s]


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "PurePursuit"


class PurePursuit(RouteAgent):
    """Privileged pure pursuit: sees where everybody is, foresees nothing.

    Source: Coulter 1992, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01.
    """

    def begin(self) -> None:
        self._manner = Manner()
        self._profile = speed_profile(self.path, limits_along(self.path, self.town), self._manner)
        self._stops = [stop for stop in stop_points(self.path, self.town) if stop.light >= 0]

    def acceleration(self, pose: Pose, truth: Mapping[str, Any]) -> float:
        wanted = GAIN * (self.path.at(self._profile, pose.s + 0.5 * pose.speed) - pose.speed)
        room = min(self._room_to_others(pose, truth), self._room_to_light(pose, truth["lights"]))
        return min(wanted, stopping(pose.speed, room, self._manner), 2.0)

    def command(self, pose: Pose, acceleration: float) -> Control:
        ahead = max(AHEAD_LEAST, AHEAD_TIME * pose.speed)
        # Seen from the ego: the point lies `ahead` along the path and its offset aside.
        aim = self.path.at(self.path.yaw, pose.s + 0.5 * ahead) - math.atan2(pose.offset, ahead) - pose.yaw
        angle = math.remainder(aim, 2.0 * math.pi)
        wheel = math.atan(2.0 * (FRONT_LENGTH + REAR_LENGTH) * math.sin(angle) / ahead)
        throttle, brake = pedals(pose.speed, acceleration)
        return Control(throttle, min(max(wheel / MAX_WHEEL_ANGLE, -1.0), 1.0), brake)

    def _room_to_others(self, pose: Pose, truth: Mapping[str, Any]) -> float:
        """Way left before the next actor whose centre is near the path [m]."""
        start = max(int(pose.s / STEP), 0)
        window = self.path.xy[start : start + int(LOOK / STEP)]
        rows = obstacles(truth)
        gap = np.linalg.norm(window[None] - truth["xyz"][rows, None, :2], axis=2)
        in_way = gap < HALF_LANE + truth["sizes"][rows, 1:2] / 2.0
        if not in_way.any():
            return math.inf
        nearest = int(np.argmax(in_way.any(axis=0)))
        return nearest * STEP - pose.half_length - KEEP

    def _room_to_light(self, pose: Pose, lights: Any) -> float:
        for stop in self._stops:
            room = stop.s - pose.s - pose.half_length
            if room > -1.0 and int(lights[stop.light]) != LightState.GREEN:
                return max(room - 1.0, 0.0) if room < LOOK else math.inf
            if room > LOOK:
                break
        return math.inf
