"""Accelerometer, gyroscope and compass with the leaderboard's noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.frame import rotation
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.world.snapshot import Snapshot

GRAVITY = 9.81  # [m/s²]
NOISE_STD = np.array([0.001, 0.001, 0.015, 0.001, 0.001, 0.001])  # [m/s²], [rad/s]; leaderboard wrapper


@SENSORS.register("sensor.other.imu")
class Imu(Sensor):
    """(7,) float64: acceleration with gravity [m/s²], rotation rate [rad/s], compass [rad].

    Acceleration is measured along the sensor's forward, right and up axes and shows about +9.81 upward at rest. The
    rotation rate about the up axis is positive when turning right. The compass has no noise: 0 is north (-y), pi/2
    east (+x).
    """

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((7,), np.float64, "m/s², rad/s, rad", "json")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.float64]:
        snapshot = history[-1]
        pose = self.config.mount.pose(snapshot)
        mount = rotation(self.config.roll, self.config.pitch, self.config.yaw)
        motion = snapshot.ego_motion.astype(np.float64)
        reading = np.empty(7)
        reading[:3] = mount.T @ motion[:3] + GRAVITY * pose.axes[2]
        reading[3:6] = mount.T @ motion[3:]
        reading[:6] += NOISE_STD * self.draws(draws).normal(snapshot.tick, 6)
        reading[6] = np.mod(pose.yaw + np.pi / 2.0, 2.0 * np.pi)
        return reading
