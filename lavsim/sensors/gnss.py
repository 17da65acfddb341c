"""Satellite positions with the leaderboard's noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import geolocation
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor
from lavsim.world.snapshot import Snapshot

NOISE_STD = 5e-6  # latitude, longitude [deg]: 0.56 m; altitude [m]. Leaderboard wrapper.


@SENSORS.register("sensor.other.gnss")
class Gnss(Sensor):
    """(3,) float64: latitude [deg], longitude [deg], altitude [m] of the mount."""

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((3,), np.float64, "deg, deg, m", "json")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.float64]:
        snapshot = history[-1]
        x, y, z = self.config.mount.pose(snapshot).origin
        latitude, longitude = geolocation(x, y, *scene.geo_reference)
        noise = self.draws(draws).normal(snapshot.tick, 3, std=NOISE_STD)
        return np.array([latitude, longitude, z], np.float64) + noise
