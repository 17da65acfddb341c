"""Exact distances and times to contact of boxes: python-fcl's door.

For spawn checks, hazard triggers and a few pairs a tick; who may touch whom in a tick is `lavsim.world.broadphase`'s
matter. Boxes stand upright: x, y, z (ground level) [m] and yaw [rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import fcl
import numpy as np
from numpy.typing import ArrayLike, NDArray

BoxPose = tuple[float, float, float, float]  # x, y, z (ground level) [m], yaw [rad]
CONTACT_GAP = 1e-3  # [m] boxes that close touch
_MOST_STEPS = 200  # of `time_to_contact`; it needs 3 to 30


def _transform(pose: BoxPose, height: float) -> fcl.Transform:
    x, y, z, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return fcl.Transform(rotation, np.array([x, y, z + height / 2.0]))


def _box(pose: BoxPose, size: ArrayLike) -> fcl.CollisionObject:
    length, width, height = (float(v) for v in np.asarray(size))
    return fcl.CollisionObject(fcl.Box(length, width, height), _transform(pose, height))


@lru_cache(maxsize=1024)
def _footprint(length: float, width: float) -> fcl.BVHModel:
    """A rectangle of two triangles.

    fcl measures the distance of triangles exactly, that of its own boxes not: where two boxes are aligned its GJK
    stops early in one case of twenty and answers up to 2 m too much.
    """
    x, y = length / 2.0, width / 2.0
    corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
    model = fcl.BVHModel()
    model.beginModel(4, 2)
    model.addSubModel(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    model.endModel()
    return model


class _Prism:
    """A box as fcl measures it: its footprint, and its extent in z beside it."""

    def __init__(self, pose: BoxPose, size: ArrayLike) -> None:
        length, width, self._height = (float(v) for v in np.asarray(size))
        self._base = fcl.CollisionObject(_footprint(length, width))
        self._z = 0.0
        self.place(pose)

    def place(self, pose: BoxPose) -> None:
        """Puts it elsewhere."""
        x, y, self._z, yaw = pose
        self._base.setTransform(_transform((x, y, 0.0, yaw), 0.0))

    def gap(self, other: _Prism) -> float:
        """Shortest distance [m]."""
        flat = float(fcl.distance(self._base, other._base, fcl.DistanceRequest(), fcl.DistanceResult()))
        above = max(self._z - other._z - other._height, other._z - self._z - self._height, 0.0)
        return math.hypot(max(flat, 0.0), above)


def box_distance(pose_a: BoxPose, size_a: ArrayLike, pose_b: BoxPose, size_b: ArrayLike) -> float:
    """Shortest distance between two upright boxes [m]; 0 where they touch or overlap.

    Args:
        pose_a: x, y, z (ground level) [m] and yaw [rad] of the first box.
        size_a: Full length, width, height [m].
        pose_b: The same of the second.
        size_b: The same of the second.
    """
    return _Prism(pose_a, size_a).gap(_Prism(pose_b, size_b))


def boxes_overlap(pose_a: BoxPose, size_a: ArrayLike, pose_b: BoxPose, size_b: ArrayLike) -> bool:
    """Whether two upright boxes share a point."""
    return bool(fcl.collide(_box(pose_a, size_a), _box(pose_b, size_b), fcl.CollisionRequest(), fcl.CollisionResult()))


class BoxSet:
    """Boxes that are asked about many times.

    Args:
        poses: (N, 4) x, y, z (ground level) [m], yaw [rad].
        sizes: (N, 3) full length, width, height [m].
    """

    def __init__(self, poses: NDArray[np.floating], sizes: NDArray[np.floating]) -> None:
        self._shapes = [fcl.Box(*size) for size in np.asarray(sizes, dtype=np.float64).tolist()]
        self._boxes = [
            fcl.CollisionObject(shape, _transform(tuple(pose), float(size[2])))
            for shape, pose, size in zip(self._shapes, poses.tolist(), sizes, strict=True)
        ]
        self._prisms = [_Prism(tuple(pose), size) for pose, size in zip(poses.tolist(), sizes, strict=True)]
        self._row_of = {id(shape): row for row, shape in enumerate(self._shapes)}  # contacts name shapes
        self._tree = fcl.DynamicAABBTreeCollisionManager()
        self._tree.registerObjects(self._boxes)
        self._tree.setup()

    def __len__(self) -> int:
        return len(self._boxes)

    def overlapping(self, pose: BoxPose, size: ArrayLike) -> NDArray[np.int64]:
        """Rows of the boxes that share a point with the one given, ascending."""
        request = fcl.CollisionRequest(num_max_contacts=max(8 * len(self), 1), enable_contact=True)
        data = fcl.CollisionData(request=request)
        self._tree.collide(_box(pose, size), data, fcl.defaultCollisionCallback)
        touched = {self._row_of.get(id(g), -1) for c in data.result.contacts for g in (c.o1, c.o2)}
        return np.array(sorted(touched - {-1}), dtype=np.int64)

    def distances(self, pose: BoxPose, size: ArrayLike) -> NDArray[np.float64]:
        """Shortest distance of every box to the one given (N,) [m]."""
        box = _Prism(pose, size)
        return np.array([box.gap(other) for other in self._prisms], dtype=np.float64)


@dataclass(frozen=True)
class MovingBox:
    """A box that goes straight on and turns evenly.

    Attributes:
        pose: x, y, z (ground level) [m], yaw [rad] now.
        size: Full length, width, height [m].
        velocity: x, y in the world [m/s].
        yaw_rate: [rad/s].
    """

    pose: BoxPose
    size: tuple[float, float, float]
    velocity: tuple[float, float] = (0.0, 0.0)
    yaw_rate: float = 0.0

    def at(self, time: float) -> BoxPose:
        """Where it will be after `time` [s]."""
        x, y, z, yaw = self.pose
        return x + self.velocity[0] * time, y + self.velocity[1] * time, z, yaw + self.yaw_rate * time

    @property
    def corner_speed(self) -> float:
        """How fast turning moves its farthest corner [m/s]."""
        return abs(self.yaw_rate) * math.hypot(self.size[0], self.size[1]) / 2.0


def time_to_contact(first: MovingBox, second: MovingBox, horizon: float = 10.0) -> float:
    """When two boxes first touch [s]; 0 if they do now, inf if not within `horizon` [s].

    Conservative advancement (Mirtich 1996): no point of the gap closes faster than the boxes' relative speed and what
    their turning adds, so the time to close the exact distance at that rate is free of contact.
    """
    vx, vy = first.velocity[0] - second.velocity[0], first.velocity[1] - second.velocity[1]
    fastest = math.hypot(vx, vy) + first.corner_speed + second.corner_speed
    one, other = _Prism(first.pose, first.size), _Prism(second.pose, second.size)
    time = 0.0
    for _ in range(_MOST_STEPS):
        gap = one.gap(other)
        if gap <= CONTACT_GAP:
            return time
        if fastest == 0.0:
            return math.inf
        time += gap / fastest
        if time > horizon:
            return math.inf
        one.place(first.at(time))
        other.place(second.at(time))
    return time  # they slide along each other nearer than a few millimetres
