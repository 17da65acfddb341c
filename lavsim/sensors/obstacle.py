"""CARLA's obstacle detector: the first thing that a ball meets on its way straight ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.frame import Pose
from lavsim.render.scene import Scene
from lavsim.render.solids import Solids
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig, attribute
from lavsim.world.snapshot import Snapshot

OBSTACLE_DTYPE = np.dtype([("other_actor", "<i4"), ("tag", "u1"), ("distance", "<f4")])


@dataclass(frozen=True)
class ObstacleConfig(SensorConfig):
    """CARLA's attributes.

    Attributes:
        distance: How far the ball goes [m].
        hit_radius: Of the ball [m].
        only_dynamics: Actors alone count.
    """

    distance: float = attribute("distance", 5.0)
    hit_radius: float = attribute("hit_radius", 0.5)
    only_dynamics: bool = attribute("only_dynamics", False)

    def problem(self) -> str | None:
        for key, value in (("distance", self.distance), ("hit_radius", self.hit_radius)):
            if not 0.0 < value <= 1000.0:
                return f"{key!r} must be more than 0 and at most 1000 [m], got {value:g}"
        return None


@SENSORS.register("sensor.other.obstacle")
class Obstacle(Sensor):
    """(0 or 1,) of `OBSTACLE_DTYPE`: the nearest thing ahead but the ego, its class, and how far the ball got [m].

    The ball goes level along the sensor's heading, as footprints are swept; the road itself is no obstacle.
    """

    config_type = ObstacleConfig
    config: ObstacleConfig

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((None,), OBSTACLE_DTYPE, "id, Tag, m")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[Any]:
        snapshot = history[-1]
        pose = self.config.mount.pose(snapshot)
        groups = [scene.actors(snapshot)] + ([] if self.config.only_dynamics else [scene.statics])
        found = [(self._first(pose, solids, int(snapshot.ids[0])), solids) for solids in groups]
        (distance, row), solids = min(found, key=lambda item: item[0])
        if distance > self.config.distance:
            return np.zeros(0, OBSTACLE_DTYPE)
        return np.array([(solids.instance[row], solids.tag[row], distance)], OBSTACLE_DTYPE)

    def _first(self, pose: Pose, solids: Solids, own: int) -> tuple[float, int]:
        """Way of the ball to the first of `solids` [m], and its row; infinite if none is met."""
        radius, reach = self.config.hit_radius, self.config.distance
        eye, ahead = pose.origin, np.array([np.cos(pose.yaw), np.sin(pose.yaw)])
        near = np.hypot(*(solids.centre - eye[:2]).T) < solids.radius + reach + radius
        level = (solids.z0 < eye[2] + radius) & (solids.z1 > eye[2] - radius) & (solids.instance != own)
        path = shapely.LineString([eye[:2], eye[:2] + (reach + 1e-6) * ahead])
        best = (np.inf, -1)
        for row in np.flatnonzero(near & level).tolist():
            footprint = shapely.Polygon(solids.xy[row, : solids.corners[row]]).buffer(radius, quad_segs=16)
            met = shapely.intersection(path, footprint)
            if not met.is_empty:
                way = float(shapely.distance(shapely.Point(eye[:2]), met))
                best = min(best, (way, row))
        return best
