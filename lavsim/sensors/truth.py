"""Privileged state: who is where, for experts and labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from lavsim.render.camera_view import CameraView
from lavsim.render.frame import Mount
from lavsim.render.scene import Scene
from lavsim.render.sweep import LidarModel, cast_sweep
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot

_ROOF = Mount(z=2.4)
_LIDAR = LidarModel(general_drop=0.0, zero_drop=0.0, full_sweep=True)
_EYES = tuple(CameraView(256, 160, np.pi / 2.0, Mount(z=2.4, yaw=k * np.pi / 2.0)) for k in range(4))


@dataclass(frozen=True)
class TruthConfig(SensorConfig):
    """Attributes:
    radius: Actors farther than this from the ego are left out [m].
    visibility: Also count what a LiDAR and a camera see of each actor; costs as much as these sensors do.
    """

    radius: float = 100.0
    visibility: bool = False

    def problem(self) -> str | None:
        return None if self.radius > 0.0 else f"'radius' must be positive [m], got {self.radius:g}"


@SENSORS.register("sensor.lavsim.truth")
class Truth(Sensor):
    """Poses, velocities and kinds of all actors around the ego (row 0), and the states of all traffic lights.

    With `visibility`, "lidar_hits" counts the returns from each actor of a whole turn of the leaderboard's LiDAR over
    the ego's roof, before drop-off, and "pixels" those of four cameras there, 256 x 160 and 90 degrees each.
    """

    config_type = TruthConfig
    config: TruthConfig
    privileged = True

    @property
    def spec(self) -> Mapping[str, ArraySpec]:
        seen = {"lidar_hits": ArraySpec((None,), np.int32, "returns"), "pixels": ArraySpec((None,), np.int32, "px")}
        return {
            "tick": ArraySpec((), np.int64, "tick", "json"),
            "time": ArraySpec((), np.float64, "s", "json"),
            "town": ArraySpec((), str, "name", "text"),
            "ids": ArraySpec((None,), np.int32, "actor id"),
            "classes": ArraySpec((None,), np.uint8, "ActorClass"),
            "roles": ArraySpec((None,), np.uint8, "Role"),
            "sizes": ArraySpec((None, 3), np.float32, "m"),
            "xyz": ArraySpec((None, 3), np.float64, "m"),
            "yaw": ArraySpec((None,), np.float64, "rad"),
            "velocities": ArraySpec((None, 3), np.float64, "m/s"),
            "vehicle_lights": ArraySpec((None,), np.int32, "VehicleLight"),
            "lights": ArraySpec((None,), np.uint8, "LightState"),
            "ego_speed": ArraySpec((), np.float64, "m/s", "json"),
            "hazards": ArraySpec((None,), HAZARD_DTYPE, "index, flags"),
            **(seen if self.config.visibility else {}),
        }

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> dict[str, Any]:
        snapshot = history[-1]
        offset = snapshot.xy - snapshot.xy[0]
        near = np.flatnonzero(np.sum(offset * offset, axis=1) <= self.config.radius**2)
        seen = {}
        if self.config.visibility:
            seen = {"lidar_hits": lidar_hits(snapshot, scene)[near], "pixels": pixels(snapshot, scene)[near]}
        return {
            "tick": snapshot.tick,
            "time": snapshot.time,
            "town": scene.name,
            "ids": snapshot.ids[near],
            "classes": snapshot.classes[near],
            "roles": snapshot.roles[near],
            "sizes": snapshot.sizes[near],
            "xyz": snapshot.xyz[near],
            "yaw": snapshot.yaw[near],
            "velocities": snapshot.velocities[near],
            "vehicle_lights": snapshot.state[near, 0],
            "lights": snapshot.lights.copy(),
            "ego_speed": snapshot.ego.forward_speed,
            "hazards": snapshot.hazards.copy(),
            **seen,
        }


def lidar_hits(snapshot: Snapshot, scene: Scene) -> NDArray[np.int32]:
    """(N,) returns from each actor of the snapshot."""
    actors = scene.actors(snapshot)
    sweep = cast_sweep(_LIDAR, _ROOF.pose(snapshot), snapshot.tick, Draws(0), scene.statics, actors,
                       heights=scene.terrain.heights)  # fmt: skip
    rows = sweep.solids - len(scene.statics.corners)
    return _count(snapshot, actors.instance[rows[rows >= 0]])


def pixels(snapshot: Snapshot, scene: Scene) -> NDArray[np.int32]:
    """(N,) pixels of each actor of the snapshot."""
    ids = [view.labels(snapshot, scene)[1].ravel() for view in _EYES]
    return _count(snapshot, np.concatenate(ids))


def _count(snapshot: Snapshot, seen: NDArray[np.int32]) -> NDArray[np.int32]:
    """How often each actor's id is among `seen`."""
    found, times = np.unique(seen, return_counts=True)
    at = np.minimum(np.searchsorted(found, snapshot.ids), max(len(found) - 1, 0))
    if not len(found):
        return np.zeros(len(snapshot.ids), np.int32)
    return np.where(found[at] == snapshot.ids, times[at], 0).astype(np.int32)
