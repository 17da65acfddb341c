"""Weather that is drawn anew every few seconds, after the collector of LAV: a learner sees all of it on any road."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.types import DT
from lavsim.world.weather import Weather
from lavsim.world.weather_presets import weathers_of

_SUN_STEP = 1.0 / 64.0  # [deg] the sun moves in: short numbers keep logs small

_Four = tuple[float, float, float, float]


@dataclass(frozen=True)
class RedrawnWeather:
    """Clouds, rain, puddles, fog and wetness jump at each draw; the sun moves steadily from one draw to the next.

    So a window of training frames never sees the shadows leap, and day turns to night and back.

    Attributes:
        seed: Of the draws.
        period: Time between two draws [s].

    Source: LAV's data collector (reference `lav.md` 3.6), whose sun leaps too.
    """

    seed: int = 0
    period: float = 10.0

    def __post_init__(self) -> None:
        if not self.period >= DT:
            raise ConfigError(f"the period of redrawn weather must be at least {DT:g} s, got {self.period:g}.")

    def at(self, tick: int) -> Weather:
        """The weather of a tick."""
        share, number = tick * DT / self.period, int(tick * DT / self.period)
        before, azimuth, turn, altitude, rise, after = _span(self.seed, number)
        share -= number
        return Weather(*before, _stepped(azimuth + share * turn) % 360.0, _stepped(altitude + share * rise), *after)


@lru_cache(maxsize=16)
def _span(seed: int, number: int) -> tuple[_Four, float, float, float, float, _Four]:
    """From draw `number` to the next: fields before the sun's, azimuth and turn, altitude and rise, the rest."""
    now, then = _draw(seed, number), _draw(seed, number + 1)
    turn = (then.sun_azimuth_angle - now.sun_azimuth_angle + 180.0) % 360.0 - 180.0
    rise = then.sun_altitude_angle - now.sun_altitude_angle
    return (
        (now.cloudiness, now.precipitation, now.precipitation_deposits, now.wind_intensity),
        now.sun_azimuth_angle, turn, now.sun_altitude_angle, rise,
        (now.fog_density, now.fog_distance, now.fog_falloff, now.wetness),
    )  # fmt: skip


@lru_cache(maxsize=16)
def _draw(seed: int, number: int) -> Weather:
    """Draw `number` of a drive: a preset, then sun and clouds; half of them dry, half wet and foggy."""
    draws = Draws.of_seed(seed).stream("weather")
    presets = tuple(weathers_of("1.0").values())[1:]  # CARLA's 14, without "Default"
    preset = presets[draws.integer(number, len(presets))]
    azimuth, altitude, clouds, wet, *share = draws.uniform(number, 9)[1:].tolist()
    is_dry = wet < 0.5
    return replace(
        preset,
        sun_azimuth_angle=360.0 * azimuth,
        sun_altitude_angle=100.0 * altitude - 50.0,
        cloudiness=90.0 * clouds,
        precipitation=0.0 if is_dry else 80.0 * share[0],
        precipitation_deposits=50.0 * share[1] if is_dry else 30.0 + 70.0 * share[1],
        fog_density=0.0 if is_dry else 80.0 * share[2],
        wetness=0.0 if is_dry else 100.0 * share[3],
    )


def _stepped(angle: float) -> float:
    return round(angle / _SUN_STEP) * _SUN_STEP
