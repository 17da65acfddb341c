"""The leaderboard's pseudo sensor for speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.world.snapshot import Snapshot


@SENSORS.register("sensor.speedometer")
class Speedometer(Sensor):
    """{"speed": signed forward speed [m/s]}, without noise."""

    @property
    def spec(self) -> Mapping[str, ArraySpec]:
        return {"speed": ArraySpec((), np.float64, "m/s", "json")}

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> dict[str, float]:
        return {"speed": history[-1].ego.forward_speed}
