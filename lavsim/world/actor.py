"""A thin view of one row of the world, for authors of hazards."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lavsim.types import VehicleLight
from lavsim.world.motion import DRIVEN, WALKING

if TYPE_CHECKING:
    from lavsim.world.world import World


class VehicleDoor(IntFlag):
    """Bits of `World.doors`, one for each of CARLA's doors."""

    NONE = 0
    FRONT_LEFT = 1
    FRONT_RIGHT = 2
    REAR_LEFT = 4
    REAR_RIGHT = 8
    ALL = 15


@dataclass(frozen=True)
class Actor:
    """One actor of a world.

    Attributes:
        world: Where it is.
        row: Its row there.
    """

    world: World
    row: int

    @property
    def id(self) -> int:
        return int(self.world.table.ids[self.row])

    @property
    def xy(self) -> NDArray[np.float64]:
        return self.world.pose[self.row, :2].copy()

    @property
    def yaw(self) -> float:
        return float(self.world.pose[self.row, 2])

    @property
    def speed(self) -> float:
        """Speed over ground [m/s]."""
        return float(np.hypot(*self.world.velocity[self.row, :2]))

    @property
    def size(self) -> NDArray[np.float32]:
        return self.world.table.sizes[self.row]

    @property
    def is_present(self) -> bool:
        return bool(self.world.present[self.row])

    @property
    def box_pose(self) -> tuple[float, float, float, float]:
        """x, y, z [m] and yaw [rad] as `lavsim.world.proximity` takes them."""
        x, y, yaw = self.world.pose[self.row]
        return float(x), float(y), float(self.world.height[self.row]), float(yaw)

    @property
    def lights(self) -> VehicleLight:
        return VehicleLight(int(self.world.lights[self.row]))

    @property
    def doors(self) -> VehicleDoor:
        """Doors that stand open."""
        return VehicleDoor(int(self.world.doors[self.row]))

    def walk(self, velocity: NDArray[np.float64]) -> None:
        """Walks with `velocity` (x, y) [m/s] until told otherwise; whoever was knocked down stays down."""
        if self.world.motion[self.row] == WALKING:
            self.world.command[self.row] = velocity

    def drive(self, speed: float, curvature: float = 0.0) -> None:
        """Takes `speed` [m/s] on a path of `curvature` [1/m] until told otherwise, within 12 m/s²."""
        if self.world.motion[self.row] == DRIVEN:
            self.world.command[self.row] = speed, curvature

    def launch(self, speed: float) -> None:
        """Has `speed` ahead at once [m/s]: it comes into the world moving."""
        if self.world.motion[self.row] == DRIVEN:
            self.world.body[self.row, 0] = speed
            self.world.command[self.row] = speed, 0.0

    def switch_on(self, lights: VehicleLight) -> None:
        self.world.lights[self.row] |= int(lights)

    def switch_off(self, lights: VehicleLight) -> None:
        self.world.lights[self.row] &= ~int(lights)

    def open_door(self, door: VehicleDoor) -> None:
        self.world.doors[self.row] |= int(door)

    def close_door(self, door: VehicleDoor) -> None:
        self.world.doors[self.row] &= ~int(door)

    def remove(self) -> None:
        self.world.remove(self)
