"""Poses of mounts in three dimensions, with CARLA's rotations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.world.snapshot import Snapshot


def rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """`(3, 3)` matrix whose columns are the turned frame's forward, right and up axes.

    Convention:
        Angles [rad]; yaw clockwise from above, pitch positive nose up, roll positive right side down.

    Source: reference `carla.md` 1.1 (Unreal's left-handed frame).
    """
    cr, sr = np.cos(roll), np.sin(roll)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, -(cr * sp * cy + sr * sy)],
            [cp * sy, sr * sp * sy + cr * cy, cy * sr - cr * sp * sy],
            [sp, -sr * cp, cr * cp],
        ]
    )


@dataclass(frozen=True)
class Mount:
    """Where a sensor sits on its vehicle.

    Attributes:
        x, y, z: Offset ahead, right, up of the vehicle's origin (box centre in plan, ground level) [m].
        roll, pitch, yaw: [rad], as in `rotation`.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def pose(self, snapshot: Snapshot) -> Pose:
        """Where the mount of the ego is in the world."""
        body = rotation(0.0, float(snapshot.pitch[0]), float(snapshot.yaw[0]))
        origin = snapshot.xyz[0] + body @ np.array([self.x, self.y, self.z])
        return Pose(origin, body @ rotation(self.roll, self.pitch, self.yaw))


@dataclass(frozen=True)
class Pose:
    """A sensor in the world.

    Attributes:
        origin: (3,) [m].
        axes: (3, 3) world_from_sensor; columns are forward, right, up.
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]

    @property
    def is_level(self) -> bool:
        """Whether the sensor's up axis is the world's."""
        return bool(abs(self.axes[2, 2] - 1.0) < 1e-12)

    @property
    def yaw(self) -> float:
        """Heading of the forward axis [rad]."""
        return float(np.arctan2(self.axes[1, 0], self.axes[0, 0]))

    def to_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """World coordinates `(N, 3)` of sensor points `(N, 3)`."""
        return points @ self.axes.T + self.origin

    def to_sensor(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sensor coordinates `(N, 3)` (forward, right, up) of world points `(N, 3)`."""
        return (points - self.origin) @ self.axes
