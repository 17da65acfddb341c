"""Weather by name: CARLA's presets of two releases, and the four of LAV's validation routes.

Source: reference `carla.md` 6.4. CARLA's -1 ("keep what was") is the default of `Weather` here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from lavsim.errors import UnknownName
from lavsim.world.weather import Weather

_ROW = tuple[float, float, float, float]  # cloudiness, precipitation, deposits, wind
_DAY: Mapping[str, _ROW] = {
    "Clear": (5.0, 0.0, 0.0, 10.0),
    "Cloudy": (60.0, 0.0, 0.0, 10.0),
    "Wet": (5.0, 0.0, 50.0, 10.0),
    "WetCloudy": (60.0, 0.0, 50.0, 10.0),
    "SoftRain": (20.0, 30.0, 50.0, 30.0),
    "MidRainy": (60.0, 60.0, 60.0, 60.0),
    "HardRain": (100.0, 100.0, 90.0, 100.0),
}
_NIGHT: Mapping[str, _ROW] = {**_DAY, "SoftRain": (60.0, 30.0, 50.0, 30.0), "MidRainy": (80.0, 60.0, 60.0, 60.0)}
_FOG_AT_NOON = {"Clear": 2.0, "HardRain": 7.0}  # 3 for the others
_FOG_AT_SUNSET = {"Clear": 2.0, "Wet": 2.0, "WetCloudy": 2.0, "SoftRain": 2.0, "HardRain": 7.0}
_FOG_AT_NIGHT = {"HardRain": 100.0}  # 60 for the others
_WET_AT_NIGHT = {"Clear": 0.0, "Cloudy": 0.0, "MidRainy": 80.0, "HardRain": 100.0}  # 60 for the others
_LOW_FOG = {"Clear", "Wet"}  # at night: it starts far off and thins out upward


def _weather(row: _ROW, altitude: float, fog: float = 0.0, wetness: float = 0.0, azimuth: float = 0.0) -> Weather:
    return Weather(
        *row, sun_azimuth_angle=azimuth, sun_altitude_angle=altitude, fog_density=fog, wetness=wetness
    )  # fmt: skip


def _of_0_9_16() -> dict[str, Weather]:
    found = {"Default": Weather()}
    for kind, row in _DAY.items():
        sunset = "MidRain" if kind == "MidRainy" else kind
        found[f"{kind}Noon"] = _weather(row, 45.0, _FOG_AT_NOON.get(kind, 3.0))
        found[f"{sunset}Sunset"] = _weather(row, 15.0, _FOG_AT_SUNSET.get(kind, 3.0))
    for kind, row in _NIGHT.items():
        night = _weather(row, -90.0, _FOG_AT_NIGHT.get(kind, 60.0), _WET_AT_NIGHT.get(kind, 60.0))
        found[f"{kind}Night"] = replace(night, fog_distance=75.0, fog_falloff=1.0) if kind in _LOW_FOG else night
    found["DustStorm"] = _weather((100.0, 0.0, 0.0, 100.0), 45.0, 2.0)
    return found


_WIND = 0.35
WEATHERS_0_9_16: Mapping[str, Weather] = _of_0_9_16()
WEATHERS_0_9_10: Mapping[str, Weather] = {
    "Default": Weather(),
    "ClearNoon": _weather((15.0, 0.0, 0.0, _WIND), 75.0),
    "CloudyNoon": _weather((80.0, 0.0, 0.0, _WIND), 75.0),
    "WetNoon": _weather((20.0, 0.0, 50.0, _WIND), 75.0),
    "WetCloudyNoon": _weather((80.0, 0.0, 50.0, _WIND), 75.0),
    "MidRainyNoon": _weather((80.0, 30.0, 50.0, 0.4), 75.0),
    "HardRainNoon": _weather((90.0, 60.0, 100.0, 1.0), 75.0),
    "SoftRainNoon": _weather((70.0, 15.0, 50.0, _WIND), 75.0),
    "ClearSunset": _weather((15.0, 0.0, 0.0, _WIND), 15.0),
    "CloudySunset": _weather((80.0, 0.0, 0.0, _WIND), 15.0),
    "WetSunset": _weather((20.0, 0.0, 50.0, _WIND), 15.0),
    "WetCloudySunset": _weather((90.0, 0.0, 50.0, _WIND), 15.0),
    "MidRainSunset": _weather((80.0, 30.0, 50.0, _WIND), 15.0),
    "HardRainSunset": _weather((80.0, 60.0, 100.0, _WIND), 15.0),
    "SoftRainSunset": _weather((90.0, 15.0, 50.0, _WIND), 15.0),
}
WEATHERS_LAV: Mapping[str, Weather] = {
    "ClearNoon": _weather((15.0, 0.0, 0.0, _WIND), 75.0),
    "CloudySunset": _weather((80.0, 0.0, 0.0, _WIND), 15.0, azimuth=270.0),
    "SoftRainDawn": _weather((90.0, 15.0, 50.0, _WIND), 5.0, azimuth=315.0),
    "HardRainNight": _weather((90.0, 60.0, 100.0, 1.0), -80.0, azimuth=225.0),
}
_TABLES = {"2.x": WEATHERS_0_9_16, "1.0": WEATHERS_0_9_10, "lav": WEATHERS_LAV}


def find_weather(name: str, generation: str = "2.x") -> Weather:
    """The preset called `name`.

    Args:
        name: CARLA's name.
        generation: "2.x" for the presets of 0.9.16, "1.0" for those of 0.9.10, "lav" for LAV's validation routes.

    Raises:
        UnknownName: no such preset or generation; the message names the nearest.
    """
    table = weathers_of(generation)
    if name not in table:
        raise UnknownName("weather", name, table)
    return table[name]


def weathers_of(generation: str) -> Mapping[str, Weather]:
    """All presets of a generation by name, as `find_weather` takes them.

    Raises:
        UnknownName: no such generation.
    """
    if generation not in _TABLES:
        raise UnknownName("generation of weathers", generation, _TABLES)
    return _TABLES[generation]
