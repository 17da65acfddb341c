"""A background driver on the route: the intelligent driver model behind whatever covers the path, lights and signs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from agents.baselines.route_agent import Pose, RouteAgent, obstacles
from agents.behavior.manner import Manner
from agents.behavior.path import STEP
from agents.behavior.road import limits_along, stop_points
from agents.behavior.speed import following, speed_profile, stopping
from agents.behavior.sweep import sweep
from lavsim.types import LightState

LOOK = 45.0  # [m]
MARGIN = 0.35  # [m] kept free on either side
LINE_GAP = 1.0  # [m]
LIMIT_SHARE = 0.7  # CARLA's traffic drives at 70 % of the limit
AHEAD_TIMES = (0.0, 1.0, 2.0)  # [s] others are taken to keep their velocity
YELLOW_BRAKE = 3.5  # [m/s²]


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "NpcDriver"


class NpcDriver(RouteAgent):
    """Drives as the simulator's own traffic does: follows what is on its path now or within two seconds."""

    def begin(self) -> None:
        self._manner = Manner(limit_share=LIMIT_SHARE)
        self._profile = speed_profile(self.path, limits_along(self.path, self.town), self._manner)
        stops = stop_points(self.path, self.town)
        self._lights = [stop for stop in stops if stop.light >= 0]
        self._signs = [stop for stop in stops if stop.light < 0]
        self._halted = 0

    def acceleration(self, pose: Pose, truth: Mapping[str, Any]) -> float:
        wanted = max(self.path.at(self._profile, pose.s + 0.5 * pose.speed), 1.0)
        gap, leader = self._leader(pose, truth)
        bounds = [following(pose.speed, gap, leader, wanted, self._manner)]
        bounds.append(self._light(pose, truth["lights"]))
        bounds.append(self._sign(pose))
        return min(bounds)

    def _leader(self, pose: Pose, truth: Mapping[str, Any]) -> tuple[float, float]:
        """Gap to what covers the path first [m], and its speed along it [m/s]."""
        start = max(int(pose.s / STEP), 0)
        stop = min(start + int(LOOK / STEP), len(self.path))
        others = obstacles(truth)
        if not len(others) or stop - start < 2:
            return 1e3, pose.speed
        yaw, velocity = truth["yaw"][others], truth["velocities"][others, :2]
        moved = truth["xyz"][others, None, :2] + velocity[:, None] * np.array(AHEAD_TIMES)[None, :, None]
        poses = np.concatenate([moved, np.broadcast_to(yaw[:, None, None], (*moved.shape[:2], 1))], axis=2)
        half = truth["sizes"][others, :2].astype(np.float64) / 2.0
        xy, heading = self.path.xy[start:stop].copy(), self.path.heading[start:stop].copy()
        first, _last = sweep(
            xy, heading, pose.half_length, float(truth["sizes"][0, 1]) / 2.0, poses, half, np.full(len(others), MARGIN)
        )
        places = np.where(first >= 0.0, first, np.inf).min(axis=1)
        nearest = int(np.argmin(places))
        if not math.isfinite(places[nearest]):
            return 1e3, pose.speed
        course = self.path.at(self.path.yaw, (start + float(places[nearest])) * STEP)
        along = float(velocity[nearest] @ (math.cos(course), math.sin(course)))
        return max(float(places[nearest]) * STEP - (pose.s - start * STEP), 0.0), max(along, 0.0)

    def _light(self, pose: Pose, lights: Any) -> float:
        for stop in self._lights:
            room = stop.s - stop.before - pose.s - pose.half_length - LINE_GAP
            if room > LOOK:
                break
            state = int(lights[stop.light])
            can_stop = pose.speed**2 < 2.0 * YELLOW_BRAKE * max(room, 0.0)
            if room > -2.0 and (state == LightState.RED or (state == LightState.YELLOW and can_stop)):
                return stopping(pose.speed, room, self._manner)
        return math.inf

    def _sign(self, pose: Pose) -> float:
        while self._halted < len(self._signs):
            room = self._signs[self._halted].s - pose.s - pose.half_length - LINE_GAP
            if room >= -2.0 and not (pose.speed < 0.05 and room < 1.5):
                return stopping(pose.speed, room, self._manner) if room < LOOK else math.inf
            self._halted += 1
        return math.inf
