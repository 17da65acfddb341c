"""CARLA's plain data types by their attribute names, for agents that run without the `carla` package.

Angles are in degrees here, as in CARLA's Python API; inside the simulator they are radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(eq=True)
class Vector2D:
    """A vector x, y."""

    x: float = 0.0
    y: float = 0.0

    def __add__(self, other: Vector2D) -> Vector2D:
        return Vector2D(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Vector2D) -> Vector2D:
        return Vector2D(self.x - other.x, self.y - other.y)

    def __mul__(self, factor: float) -> Vector2D:
        return Vector2D(self.x * factor, self.y * factor)

    __rmul__ = __mul__

    def length(self) -> float:
        return math.hypot(self.x, self.y)


@dataclass(eq=True)
class Vector3D:
    """A vector x, y, z; also CARLA's `Location` [m]."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    def __add__(self, other: Vector3D) -> Vector3D:
        return type(self)(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vector3D) -> Vector3D:
        return type(self)(self.x - other.x, self.y - other.y, self.z - other.z)

    def __mul__(self, factor: float) -> Vector3D:
        return type(self)(self.x * factor, self.y * factor, self.z * factor)

    __rmul__ = __mul__

    def __truediv__(self, factor: float) -> Vector3D:
        return self * (1.0 / factor)

    def length(self) -> float:
        return math.sqrt(self.dot(self))

    def dot(self, other: Vector3D) -> float:
        return self.x * other.x + self.y * other.y + self.z * other.z

    def distance(self, other: Vector3D) -> float:
        """Distance to another point in all three axes."""
        return (self - other).length()


class Location(Vector3D):
    """A point in the world [m]."""


@dataclass(eq=True)
class Rotation:
    """Pitch (positive nose up), yaw (clockwise from above), roll [deg]; CARLA's field order."""

    pitch: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0

    def get_forward_vector(self) -> Vector3D:
        pitch, yaw = math.radians(self.pitch), math.radians(self.yaw)
        return Vector3D(math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch))

    def get_right_vector(self) -> Vector3D:
        pitch, yaw, roll = math.radians(self.pitch), math.radians(self.yaw), math.radians(self.roll)
        return Vector3D(
            math.cos(yaw) * math.sin(pitch) * math.sin(roll) - math.sin(yaw) * math.cos(roll),
            math.sin(yaw) * math.sin(pitch) * math.sin(roll) + math.cos(yaw) * math.cos(roll),
            -math.cos(pitch) * math.sin(roll),
        )


@dataclass(eq=True)
class Transform:
    """A pose: rotate, then translate."""

    location: Location = field(default_factory=Location)
    rotation: Rotation = field(default_factory=Rotation)

    def get_forward_vector(self) -> Vector3D:
        return self.rotation.get_forward_vector()

    def get_right_vector(self) -> Vector3D:
        return self.rotation.get_right_vector()

    def get_up_vector(self) -> Vector3D:
        ahead, right = self.get_forward_vector(), self.get_right_vector()
        # Left-handed: up = forward x right in CARLA's axes.
        return Vector3D(
            ahead.y * right.z - ahead.z * right.y,
            ahead.z * right.x - ahead.x * right.z,
            ahead.x * right.y - ahead.y * right.x,
        )

    def get_matrix(self) -> list[list[float]]:
        """4 x 4, takes points of this frame to the world."""
        axes = self.get_forward_vector(), self.get_right_vector(), self.get_up_vector(), self.location
        return [[getattr(axis, name) for axis in axes] for name in "xyz"] + [[0.0, 0.0, 0.0, 1.0]]

    def get_inverse_matrix(self) -> list[list[float]]:
        """4 x 4, takes points of the world to this frame."""
        axes = self.get_forward_vector(), self.get_right_vector(), self.get_up_vector()
        return [[a.x, a.y, a.z, -a.dot(self.location)] for a in axes] + [[0.0, 0.0, 0.0, 1.0]]

    def transform(self, point: Vector3D) -> Location:
        """World coordinates of a `point` given in this frame."""
        ahead, right, up = self.get_forward_vector(), self.get_right_vector(), self.get_up_vector()
        moved = ahead * point.x + right * point.y + up * point.z
        return Location(self.location.x + moved.x, self.location.y + moved.y, self.location.z + moved.z)


@dataclass(eq=True)
class VehicleControl:
    """What an agent returns; CARLA's field order and defaults."""

    throttle: float = 0.0
    steer: float = 0.0
    brake: float = 0.0
    hand_brake: bool = False
    reverse: bool = False
    manual_gear_shift: bool = False
    gear: int = 0
