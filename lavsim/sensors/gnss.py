"""Satellite positions with the leaderboard's noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import geolocation
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorConfig, attribute
from lavsim.world.snapshot import Snapshot

NOISE_STD = 5e-6  # latitude, longitude [deg]: 0.56 m; altitude [m]. Leaderboard wrapper.
NEW_METRES_PER_DEGREE = 111_274.963  # of CARLA 0.9.16, in both directions


@dataclass(frozen=True)
class GnssConfig(SensorConfig):
    """CARLA's attributes, which the leaderboard fixes, and which of CARLA's two conversions is used.

    Attributes:
        noise_lat, noise_lon, noise_alt: Standard deviations [deg, deg, m] (`noise_lat_stddev` …).
        bias_lat, bias_lon, bias_alt: [deg, deg, m] (`noise_lat_bias` …).
        convention: "mercator", that of CARLA up to 0.9.15 and of the leaderboard, or "0.9.16", whose latitude grows
            to the south. Source: reference `carla.md` 1.3.
    """

    noise_lat: float = attribute("noise_lat_stddev", NOISE_STD)
    noise_lon: float = attribute("noise_lon_stddev", NOISE_STD)
    noise_alt: float = attribute("noise_alt_stddev", NOISE_STD)
    bias_lat: float = attribute("noise_lat_bias", 0.0)
    bias_lon: float = attribute("noise_lon_bias", 0.0)
    bias_alt: float = attribute("noise_alt_bias", 0.0)
    convention: str = attribute("convention", "mercator")

    def problem(self) -> str | None:
        if self.convention not in ("mercator", "0.9.16"):
            return f"'convention' must be 'mercator' or '0.9.16', got {self.convention!r}"
        if min(self.noise_lat, self.noise_lon, self.noise_alt) < 0.0:
            return "standard deviations of noise can't be negative"
        return None


@SENSORS.register("sensor.other.gnss")
class Gnss(Sensor):
    """(3,) float64: latitude [deg], longitude [deg], altitude [m] of the mount."""

    config_type = GnssConfig
    config: GnssConfig

    @property
    def spec(self) -> ArraySpec:
        return ArraySpec((3,), np.float64, "deg, deg, m", "json")

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> NDArray[np.float64]:
        snapshot, c = history[-1], self.config
        x, y, z = c.mount.pose(snapshot).origin
        if c.convention == "mercator":
            latitude, longitude = geolocation(x, y, *scene.geo_reference)
        else:
            latitude, longitude = (
                reference + place / NEW_METRES_PER_DEGREE
                for reference, place in zip(scene.geo_reference, (y, x), strict=True)
            )
        noise = self.draws(draws).normal(snapshot.tick, 3) * (c.noise_lat, c.noise_lon, c.noise_alt)
        return np.array([latitude, longitude, z], np.float64) + noise + (c.bias_lat, c.bias_lon, c.bias_alt)
