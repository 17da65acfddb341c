"""Weather as state that sensors read, with CARLA's fields, and its change along a route."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from operator import attrgetter

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
        return np.array(_values(self), dtype=np.float32)

    @staticmethod
    def from_array(values: NDArray[np.float32]) -> Weather:
        return Weather(*(float(v) for v in values))

    @property
    def is_night(self) -> bool:
        return self.sun_altitude_angle < 0.0

    @cached_property
    def calls_for_lights(self) -> bool:
        """Whether vehicles drive with low beams: low sun, thick clouds or fog, or two of them nearly so.

        Source: the thresholds of the CARLA leaderboard's `RouteLightsBehavior`.
        """
        margins = (self.sun_altitude_angle - 15.0, 80.0 - self.cloudiness, 40.0 - self.fog_density)
        return min(margins) < 0.0 or sum(margin < 10.0 for margin in margins) >= 2


CLEAR = Weather()
_values = attrgetter(*(f.name for f in fields(Weather)))  # (10,) in order


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
        return CLEAR
    after = next((k for k, frame in enumerate(keyframes) if frame.percentage >= percentage), len(keyframes))
    if after in (0, len(keyframes)):
        return keyframes[max(after - 1, 0)].weather
    first, second = keyframes[after - 1], keyframes[after]
    if first.weather == second.weather:
        return first.weather
    share = (percentage - first.percentage) / (second.percentage - first.percentage)
    return Weather(*(a + share * (b - a) for a, b in zip(_values(first.weather), _values(second.weather), strict=True)))
