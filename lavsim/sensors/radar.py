"""Radar: a few rays in random directions within a cone, with the speed of what they meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.beams import NO_HIT, cast_rays
from lavsim.render.frame import Pose
from lavsim.render.scene import Scene
from lavsim.sensors.base import DEGREES, SENSORS, ArraySpec, Sensor, SensorConfig, attribute
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot

Floats = NDArray[np.float64]
_UNSET = -1.0


@dataclass(frozen=True)
class RadarConfig(SensorConfig):
    """The keys of leaderboard 1.0 (`fov`) and 2.x (`horizontal_fov`, `vertical_fov`); CARLA's names as attributes.

    Attributes:
        fov: Both openings of the cone [rad] (degrees in the dict), where the next two are not given.
        horizontal_fov, vertical_fov: Openings [rad].
        reach: [m] (`range`).
        points_per_second: Rays, most of which come back.
    """

    fov: float = field(default=math.radians(30.0), metadata={DEGREES: True})
    horizontal_fov: float = field(default=_UNSET, metadata={DEGREES: True})
    vertical_fov: float = field(default=_UNSET, metadata={DEGREES: True})
    reach: float = attribute("range", 100.0)
    points_per_second: int = attribute("points_per_second", 1500)

    def problem(self) -> str | None:
        for key, value in (("horizontal_fov", self.openings[0]), ("vertical_fov", self.openings[1])):
            if not 0.0 < value < math.pi:
                return f"{key!r} must be more than 0 and less than 180 degrees, got {math.degrees(value):g}"
        if not 0.1 <= self.reach <= 1000.0:
            return f"'range' must be 0.1 to 1000, got {self.reach:g}"
        return None if self.rays >= 1 else f"'points_per_second' must be at least 20, got {self.points_per_second}"

    @property
    def openings(self) -> tuple[float, float]:
        """Horizontal and vertical [rad]."""
        across, up = self.horizontal_fov, self.vertical_fov
        return (self.fov if across == _UNSET else across, self.fov if up == _UNSET else up)

    @property
    def rays(self) -> int:
        """Sent in one tick."""
        return int(self.points_per_second * DT)


@SENSORS.register("sensor.other.radar")
class Radar(Sensor):
    """Detections (N, 4) float32 in the order of the leaderboard's wrapper: depth, altitude, azimuth, velocity.

    The wrapper turns CARLA's records (velocity, azimuth, altitude, depth) round. Velocity [m/s] is that of the target
    relative to the sensor along the ray: negative for what comes nearer, as CARLA's code has it, whatever its
    documentation says. Depth is in metres, angles in rad; azimuth is positive to the right, altitude upward.
    """

    config_type = RadarConfig
    config: RadarConfig

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None, 4), np.float32, "m, rad, rad, m/s")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.float32]:
        snapshot = history[-1]
        pose = self.config.mount.pose(snapshot)
        local = self._rays(snapshot.tick, draws)
        world = local @ pose.axes.T
        distance, hit = np.empty(len(world)), np.empty(len(world), np.int32)
        limit = np.full(len(world), self.config.reach)
        actors = scene.actors(snapshot)
        cast_rays(
            pose.origin, world, limit, distance, hit, scene.statics, actors, scene.terrain.heights, self.config.reach
        )
        met = np.flatnonzero(hit != NO_HIT)
        owner = hit[met] - len(scene.statics.corners)
        ids = np.where(owner >= 0, actors.instance[np.maximum(owner, 0)] if len(actors.instance) else 0, 0)
        relative = _velocities(snapshot, ids) - _own_velocity(snapshot, pose)
        forward, right, up = local[met].T
        return np.stack(
            [
                distance[met],
                np.arctan2(up, np.hypot(forward, right)),
                np.arctan2(right, forward),
                np.sum(relative * world[met], axis=1),
            ],
            axis=1,
        ).astype(np.float32)

    def _rays(self, tick: int, draws: Draws) -> Floats:
        """(N, 3) directions in the sensor's frame: evenly over radius and angle of an ellipse, as CARLA draws them."""
        count = self.config.rays
        unit = self.draws(draws).uniform(tick, 2 * count)
        radius, angle = unit[:count], 2.0 * np.pi * unit[count:]
        across, upward = (np.tan(opening / 2.0) for opening in self.config.openings)
        rays = np.stack([np.ones(count), across * radius * np.cos(angle), upward * radius * np.sin(angle)], axis=1)
        directions: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return directions


def _velocities(snapshot: Snapshot, ids: NDArray[np.int32]) -> Floats:
    """(N, 3) velocities of the actors `ids`, 0 for the static world [m/s]."""
    order = np.argsort(snapshot.ids, kind="stable")
    row = order[np.minimum(np.searchsorted(snapshot.ids, ids, sorter=order), len(order) - 1)]
    return np.where((snapshot.ids[row] == ids)[:, None], snapshot.velocities[row], 0.0)


def _own_velocity(snapshot: Snapshot, pose: Pose) -> Floats:
    """(3,) velocity of the mount [m/s]: the ego's, and what its turning adds."""
    ahead, aside, _ = pose.origin - snapshot.xyz[0]
    turning = float(snapshot.ego_motion[5])
    own: Floats = snapshot.velocities[0] + turning * np.array([-aside, ahead, 0.0])
    return own
