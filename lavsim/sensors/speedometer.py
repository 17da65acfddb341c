"""The leaderboard's pseudo sensor for speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lavsim.random import Draws
from lavsim.render.frame import rotation
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.world.snapshot import Snapshot


@SENSORS.register("sensor.speedometer")
class Speedometer(Sensor):
    """{"speed": signed speed along the ego's forward axis, uphill too [m/s]}, without noise."""

    @property
    def spec(self) -> Mapping[str, ArraySpec]:
        return {"speed": ArraySpec((), np.float64, "m/s", "json")}

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> dict[str, float]:
        snapshot = history[-1]
        ahead = rotation(0.0, float(snapshot.pitch[0]), float(snapshot.yaw[0]))[:, 0]
        return {"speed": float(ahead @ snapshot.velocities[0])}
