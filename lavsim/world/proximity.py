"""Exact distances between boxes: python-fcl's door, for spawn checks and hazard triggers, not for every pair a tick."""

from __future__ import annotations

import fcl
import numpy as np
from numpy.typing import NDArray


def _box(x: float, y: float, z: float, yaw: float, size: NDArray[np.floating]) -> fcl.CollisionObject:
    length, width, height = (float(v) for v in size)
    cos, sin = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return fcl.CollisionObject(
        fcl.Box(length, width, height), fcl.Transform(rotation, np.array([x, y, z + height / 2.0]))
    )


def box_distance(
    pose_a: tuple[float, float, float, float],
    size_a: NDArray[np.floating],
    pose_b: tuple[float, float, float, float],
    size_b: NDArray[np.floating],
) -> float:
    """Shortest distance between two upright boxes [m]; 0 where they touch or overlap.

    Args:
        pose_a: x, y, z (ground level) [m] and yaw [rad] of the first box.
        size_a: Full length, width, height [m].
        pose_b: The same of the second.
        size_b: The same of the second.
    """
    first, second = _box(*pose_a, size_a), _box(*pose_b, size_b)
    distance = fcl.distance(first, second, fcl.DistanceRequest(), fcl.DistanceResult())
    return float(max(distance, 0.0))


def boxes_overlap(
    pose_a: tuple[float, float, float, float],
    size_a: NDArray[np.floating],
    pose_b: tuple[float, float, float, float],
    size_b: NDArray[np.floating],
) -> bool:
    """Whether two upright boxes share a point."""
    return bool(
        fcl.collide(_box(*pose_a, size_a), _box(*pose_b, size_b), fcl.CollisionRequest(), fcl.CollisionResult())
    )
