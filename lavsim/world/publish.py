"""From the world's float64 arrays to the integers of a Snapshot, in one pass."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.types import VehicleLight
from lavsim.world.motion import DRIVEN
from lavsim.world.snapshot import ANGLE_UNIT, LENGTH_UNIT, SPEED_UNIT

_LENGTH, _ANGLE, _SPEED = float(LENGTH_UNIT), float(ANGLE_UNIT), float(SPEED_UNIT)
_BEAMS = int(VehicleLight.POSITION | VehicleLight.LOW_BEAM)


@kernel
def quantise(
    rows: NDArray[np.int32],
    pose: NDArray[np.float64],
    height: NDArray[np.float64],
    velocity: NDArray[np.float64],
    motion: NDArray[np.uint8],
    lights: NDArray[np.int32],
    doors: NDArray[np.int32],
    gait: NDArray[np.float64],
    is_dark: bool,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Pose (R, 5), velocity (R, 3) and state (R, 3) of `rows`, as `lavsim.world.snapshot.Snapshot` holds them.

    Args:
        rows: Who is present.
        pose: (N, 3) x, y [m], yaw [rad].
        height: (N,) [m].
        velocity: (N, 3) vx, vy [m/s], yaw rate.
        motion: (N,) as in `lavsim.world.motion.integrate`.
        lights: (N,) `VehicleLight` bits.
        doors: (N,) `VehicleDoor` bits.
        gait: (N,) steps walked.
        is_dark: Whether everybody who drives has the low beams on.
    """
    poses = np.zeros((len(rows), 5), np.int32)
    velocities = np.zeros((len(rows), 3), np.int32)
    states = np.zeros((len(rows), 3), np.int32)
    for k in range(len(rows)):
        i = rows[k]
        poses[k, 0] = int(np.rint(pose[i, 0] / _LENGTH))
        poses[k, 1] = int(np.rint(pose[i, 1] / _LENGTH))
        poses[k, 2] = int(np.rint(height[i] / _LENGTH))
        poses[k, 3] = ((int(np.rint(pose[i, 2] / _ANGLE)) + 32768) & 65535) - 32768
        velocities[k, 0] = int(np.rint(velocity[i, 0] / _SPEED))
        velocities[k, 1] = int(np.rint(velocity[i, 1] / _SPEED))
        states[k, 0] = lights[i] | (_BEAMS if is_dark and motion[i] == DRIVEN else 0)
        states[k, 1] = doors[i]
        states[k, 2] = int((gait[i] - math.floor(gait[i])) * 256.0)
    return poses, velocities, states
