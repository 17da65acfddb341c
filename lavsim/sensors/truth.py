"""Privileged state: who is where, for experts and labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot


@dataclass(frozen=True)
class TruthConfig(SensorConfig):
    """Attributes:
    radius: Actors farther than this from the ego are left out [m].
    """

    radius: float = 100.0

    def problem(self) -> str | None:
        return None if self.radius > 0.0 else f"'radius' must be positive [m], got {self.radius:g}"


@SENSORS.register("sensor.lavsim.truth")
class Truth(Sensor):
    """Poses, velocities and kinds of all actors around the ego (row 0), and the states of all traffic lights."""

    config_type = TruthConfig
    config: TruthConfig
    privileged = True

    @property
    def spec(self) -> Mapping[str, ArraySpec]:
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
        }

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> dict[str, Any]:
        snapshot = history[-1]
        offset = snapshot.xy - snapshot.xy[0]
        near = np.flatnonzero(np.sum(offset * offset, axis=1) <= self.config.radius**2)
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
        }
