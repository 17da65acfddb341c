"""Weather as state that sensors read, with CARLA's fields, and its change along a route."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Weather:
    """CARLA's weather parameters.

    Attributes:
        cloudiness: 0 to 100.
        precipitation: Rain, 0 to 100.
        precipitation_deposits: Puddles, 0 to 100.
        wind_intensity: 0 to 100.
        sun_azimuth_angle: [deg], clockwise from +x seen from above.
        sun_altitude_angle: [deg], -90 to 90; below 0 is night.
        fog_density: 0 to 100.
        fog_distance: Where fog starts [m].
        fog_falloff: Density change with height.
        wetness: 0 to 100.
    """

    cloudiness: float = 30.0
    precipitation: float = 0.0
    precipitation_deposits: float = 0.0
    wind_intensity: float = 10.0
    sun_azimuth_angle: float = 0.0
    sun_altitude_angle: float = 70.0
    fog_density: float = 0.0
    fog_distance: float = 0.75
    fog_falloff: float = 0.1
    wetness: float = 0.0

    def to_array(self) -> NDArray[np.float32]:
        """The fields in order, `(10,)` float32: how a Snapshot and a log hold them."""
        return np.array([getattr(self, f.name) for f in fields(self)], dtype=np.float32)

    @staticmethod
    def from_array(values: NDArray[np.float32]) -> Weather:
        return Weather(*(float(v) for v in values))

    @property
    def is_night(self) -> bool:
        return self.sun_altitude_angle < 0.0


@dataclass(frozen=True)
class WeatherKeyframe:
    """Weather at a share of the route.

    Attributes:
        percentage: Route driven [0 to 100].
        weather: What holds there; linear in between, constant outside.
    """

    percentage: float
    weather: Weather


def weather_at(keyframes: Sequence[WeatherKeyframe], percentage: float) -> Weather:
    """The weather after `percentage` of the route, interpolated between keyframes sorted by percentage."""
    if not keyframes:
        return Weather()
    marks = [frame.percentage for frame in keyframes]
    values = {
        f.name: float(np.interp(percentage, marks, [getattr(frame.weather, f.name) for frame in keyframes]))
        for f in fields(Weather)
    }
    return replace(Weather(), **values)
