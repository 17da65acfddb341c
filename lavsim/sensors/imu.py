"""Accelerometer, gyroscope and compass with the leaderboard's noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.frame import rotation
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig, attribute
from lavsim.world.snapshot import Snapshot

GRAVITY = 9.81  # [m/s²]


@dataclass(frozen=True)
class ImuConfig(SensorConfig):
    """CARLA's attributes, which the leaderboard fixes.

    Attributes:
        accel_x, accel_y, accel_z: Noise of the accelerometer [m/s²] (`noise_accel_stddev_x` …).
        gyro_x, gyro_y, gyro_z: Noise of the gyroscope [rad/s] (`noise_gyro_stddev_x` …).
        gyro_bias_x, gyro_bias_y, gyro_bias_z: [rad/s] (`noise_gyro_bias_x` …).
    """

    accel_x: float = attribute("noise_accel_stddev_x", 0.001)
    accel_y: float = attribute("noise_accel_stddev_y", 0.001)
    accel_z: float = attribute("noise_accel_stddev_z", 0.015)
    gyro_x: float = attribute("noise_gyro_stddev_x", 0.001)
    gyro_y: float = attribute("noise_gyro_stddev_y", 0.001)
    gyro_z: float = attribute("noise_gyro_stddev_z", 0.001)
    gyro_bias_x: float = attribute("noise_gyro_bias_x", 0.0)
    gyro_bias_y: float = attribute("noise_gyro_bias_y", 0.0)
    gyro_bias_z: float = attribute("noise_gyro_bias_z", 0.0)

    def problem(self) -> str | None:
        return "standard deviations of noise can't be negative" if min(self.noise) < 0.0 else None

    @property
    def noise(self) -> tuple[float, ...]:
        """(6,) standard deviations."""
        return (self.accel_x, self.accel_y, self.accel_z, self.gyro_x, self.gyro_y, self.gyro_z)


@SENSORS.register("sensor.other.imu")
class Imu(Sensor):
    """(7,) float64: acceleration with gravity [m/s²], rotation rate [rad/s], compass [rad].

    Acceleration is measured along the sensor's forward, right and up axes and shows about +9.81 upward at rest. The
    rotation rate about the up axis is positive when turning right. The compass has no noise: 0 is north (-y), pi/2
    east (+x).
    """

    config_type = ImuConfig
    config: ImuConfig

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
        reading[3:6] += (self.config.gyro_bias_x, self.config.gyro_bias_y, self.config.gyro_bias_z)
        reading[:6] += self.config.noise * self.draws(draws).normal(snapshot.tick, 6)
        reading[6] = np.mod(pose.yaw + np.pi / 2.0, 2.0 * np.pi)
        return reading
