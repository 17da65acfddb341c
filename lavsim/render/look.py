"""Light, sky, air and paint of a weather, worked out once for each.

Cameras have two looks. `fast`: materials by class in the light of sun and sky, lamps, air and the noise of exposure.
`full` adds shadows, texture, wet mirrors, rain, and the light of lamps on what is around them.
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.render.ground import Surface
from lavsim.world.weather import Weather

Floats = NDArray[np.float32]

LOOKS = ("fast", "full")
SKY_STEPS = 256


class Swatch(IntEnum):
    """What a rule of `lavsim.render.shade` can show at a point of a painted face."""

    OWN = 0  # the face's own colour
    WINDOW = 1
    LIT_WINDOW = 2
    TYRE = 3
    GRILLE = 4
    PLATE = 5
    BRAKE_ON = 6
    REAR_ON = 7
    REAR_OFF = 8
    HEAD_ON = 9
    HEAD_OFF = 10
    BLINKER = 11
    FLASH = 12
    BAND_1 = 13
    BAND_2 = 14
    BAND_3 = 15


class Look(NamedTuple):
    """What the shading kernels read; colours are red, green, blue, 0 to 255, light is a factor a channel.

    Attributes:
        sun: (3,) direction towards the sun or moon.
        sunlight, ambient: (3,) light on a face across the sun, and from everywhere.
        sky: (SKY_STEPS, 3) colours over the rise of a ray (rise over run along the optical axis), 0 to 1.
        haze: (3,) what distance fades into.
        air: (3,) loss of light in air and rain [1/m], in fog [1/m], and where fog begins [m].
        ground: (S, 7) of each `Surface`: colour in the sun, share left in shadow a channel, strength of its grain.
        swatches: (S, 4) colour of each `Swatch`, and its glow: the share that fog does not take.
        night: 0 by day, 1 by night: lit windows, glowing lamps.
        noise: Standard deviation of a pixel's noise, in its values.
        wet, puddles, rain, clouds: 0 to 1.
    """

    sun: Floats
    sunlight: Floats
    ambient: Floats
    sky: Floats
    haze: Floats
    air: Floats
    ground: Floats
    swatches: Floats
    night: float
    noise: float
    wet: float
    puddles: float
    rain: float
    clouds: float


_GROUND = {
    Surface.TERRAIN: ((104, 124, 72), 0.16),
    Surface.ROAD: ((96, 97, 100), 0.06),
    Surface.SIDEWALK: ((168, 162, 152), 0.05),
    Surface.SHOULDER: ((112, 110, 106), 0.08),
    Surface.PARKING: ((104, 104, 106), 0.06),
    Surface.MEDIAN: ((98, 122, 70), 0.16),
    Surface.CROSSWALK_GAP: ((94, 95, 98), 0.06),
    Surface.CROSSWALK: ((226, 226, 222), 0.05),
    Surface.STOP_LINE: ((230, 230, 226), 0.05),
    Surface.WHITE_SOLID: ((228, 228, 224), 0.05),
    Surface.WHITE_BROKEN: ((228, 228, 224), 0.05),
    Surface.YELLOW_SOLID: ((222, 176, 52), 0.05),
    Surface.YELLOW_BROKEN: ((222, 176, 52), 0.05),
    Surface.CURB: ((150, 148, 144), 0.05),
}


# Swatches that take the daylight, and those that shine by themselves: colour, glow.
_LIT = {
    Swatch.TYRE: (30, 30, 32),
    Swatch.GRILLE: (34, 35, 38),
    Swatch.PLATE: (215, 215, 210),
    Swatch.REAR_OFF: (150, 20, 20),
    Swatch.HEAD_OFF: (215, 218, 220),
}
_SHINING = {
    Swatch.LIT_WINDOW: ((225, 180, 105), 0.2),
    Swatch.BRAKE_ON: ((255, 36, 30), 0.6),
    Swatch.REAR_ON: ((170, 18, 16), 0.4),
    Swatch.HEAD_ON: ((255, 250, 228), 0.6),
    Swatch.BLINKER: ((255, 150, 20), 0.6),
    Swatch.FLASH: ((70, 110, 255), 0.6),
    Swatch.BAND_1: ((228, 60, 52), 0.0),
    Swatch.BAND_2: ((236, 232, 224), 0.0),
    Swatch.BAND_3: ((70, 130, 200), 0.0),
}


def _swatches(ambient: NDArray[np.float64], zenith: NDArray[np.float64]) -> NDArray[np.float64]:
    table = np.zeros((len(Swatch), 4))
    table[Swatch.WINDOW, :3] = 0.22 * zenith + 0.5 * np.array([38, 44, 52]) * ambient
    for swatch, paint in _LIT.items():
        table[swatch, :3] = np.array(paint) * ambient
    for swatch, (colour, glow) in _SHINING.items():
        table[swatch] = (*colour, glow)
    return table


def _smooth(value: float, low: float, high: float) -> float:
    share = min(max((value - low) / (high - low), 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


def _mix(a: object, b: object, share: float) -> NDArray[np.float64]:
    return np.asarray(a, np.float64) * (1.0 - share) + np.asarray(b, np.float64) * share


@lru_cache(maxsize=64)
def look_of(weather: Weather) -> Look:
    """The look under `weather`."""
    altitude = weather.sun_altitude_angle
    day, low_sun = _smooth(altitude, -6.0, 12.0), 1.0 - _smooth(altitude, 2.0, 28.0)
    thick = max(weather.cloudiness, weather.precipitation) + 0.4 * weather.precipitation  # clouds that rain
    overcast = min(thick / 100.0, 1.0)
    wet = min(max(weather.wetness, weather.precipitation_deposits, weather.precipitation) / 100.0, 1.0)
    sunlight = (
        0.66 * _smooth(altitude, -1.0, 9.0) * (1.0 - 0.9 * overcast) * _mix((1, 0.97, 0.9), (1, 0.78, 0.52), low_sun)
    )
    ambient = _mix((0.15, 0.16, 0.21), _mix((0.6, 0.62, 0.66), (0.68, 0.69, 0.71), overcast), day)
    ambient = ambient * (1.0 - 0.18 * low_sun * day)
    zenith, horizon = _sky_colours(day, low_sun, overcast)
    sun = _direction(np.radians(weather.sun_azimuth_angle), np.radians(max(altitude, 4.0)))
    rise = np.linspace(0.0, 1.0, SKY_STEPS)[:, None]
    return Look(
        sun=sun.astype(np.float32),
        sunlight=sunlight.astype(np.float32),
        ambient=ambient.astype(np.float32),
        sky=(horizon * (1.0 - rise**0.7) + zenith * rise**0.7).astype(np.float32),
        haze=horizon.astype(np.float32),
        air=_air(weather).astype(np.float32),
        ground=_ground_paint(ambient, sunlight * max(float(sun[2]), 0.0), wet).astype(np.float32),
        swatches=_swatches(ambient, zenith).astype(np.float32),
        night=1.0 - day,
        noise=1.2 + 2.6 * (1.0 - day) + 0.8 * overcast + 1.2 * weather.precipitation / 100.0,
        wet=wet,
        puddles=min(weather.precipitation_deposits / 100.0, 1.0),
        rain=min(weather.precipitation / 100.0, 1.0),
        clouds=overcast,
    )


def _ground_paint(ambient: NDArray[np.float64], sunlight: NDArray[np.float64], wet: float) -> NDArray[np.float64]:
    light = ambient + sunlight
    soaked = np.array([1.0 - (0.38 if s is not Surface.TERRAIN else 0.2) * wet for s in Surface])[:, None]
    paint = np.clip(np.array([_GROUND[s][0] for s in Surface]) * light * soaked, 0.0, 255.0)
    shadow = np.broadcast_to(ambient / light, paint.shape)
    return np.column_stack([paint, shadow, [_GROUND[s][1] for s in Surface]])


def _direction(azimuth: float, altitude: float) -> NDArray[np.float64]:
    return np.array([np.cos(altitude) * np.cos(azimuth), np.cos(altitude) * np.sin(azimuth), np.sin(altitude)])


def _sky_colours(day: float, low_sun: float, overcast: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Colours of the sky overhead and at the horizon."""
    zenith = _mix((86, 138, 208), (150, 155, 163), overcast)
    horizon = _mix(_mix((192, 214, 232), (246, 178, 122), 0.7 * low_sun), (186, 189, 192), overcast)
    horizon = horizon * (1.0 - 0.2 * low_sun)
    dark = _mix((7, 9, 18), (27, 25, 27), overcast)  # clouds throw back the light of the town
    low = _mix((24, 26, 36), (42, 39, 39), overcast)
    return _mix(dark, zenith * (1.0 - 0.25 * low_sun), day), _mix(low, horizon, day)


def _air(weather: Weather) -> NDArray[np.float64]:
    """Air that is never quite clear, rain, and fog from its distance on."""
    return np.array(
        [
            0.0005 + 0.004 * weather.precipitation / 100.0,
            0.05 * (weather.fog_density / 100.0) ** 2,
            weather.fog_distance,
        ]
    )
