"""Weather presets are those of the tables, and keyframes lie between their neighbours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.errors import UnknownName
from lavsim.world.weather import Weather, WeatherKeyframe, weather_at
from lavsim.world.weather_presets import WEATHERS_0_9_10, WEATHERS_0_9_16, WEATHERS_LAV, find_weather

# Name, cloudiness, precipitation, deposits, wind, sun altitude, fog density, wetness.
TABLE_0_9_16 = """
ClearNoon 5 0 0 10 45 2 0 | CloudyNoon 60 0 0 10 45 3 0 | WetNoon 5 0 50 10 45 3 0 | WetCloudyNoon 60 0 50 10 45 3 0
SoftRainNoon 20 30 50 30 45 3 0 | MidRainyNoon 60 60 60 60 45 3 0 | HardRainNoon 100 100 90 100 45 7 0
ClearSunset 5 0 0 10 15 2 0 | CloudySunset 60 0 0 10 15 3 0 | WetSunset 5 0 50 10 15 2 0
WetCloudySunset 60 0 50 10 15 2 0 | SoftRainSunset 20 30 50 30 15 2 0 | MidRainSunset 60 60 60 60 15 3 0
HardRainSunset 100 100 90 100 15 7 0
ClearNight 5 0 0 10 -90 60 0 | CloudyNight 60 0 0 10 -90 60 0 | WetNight 5 0 50 10 -90 60 60
WetCloudyNight 60 0 50 10 -90 60 60 | SoftRainNight 60 30 50 30 -90 60 60 | MidRainyNight 80 60 60 60 -90 60 80
HardRainNight 100 100 90 100 -90 100 100 | DustStorm 100 0 0 100 45 2 0
"""
TABLE_0_9_10 = """
ClearNoon 15 0 0 0.35 75 0 0 | CloudyNoon 80 0 0 0.35 75 0 0 | WetNoon 20 0 50 0.35 75 0 0
WetCloudyNoon 80 0 50 0.35 75 0 0 | MidRainyNoon 80 30 50 0.4 75 0 0 | HardRainNoon 90 60 100 1 75 0 0
SoftRainNoon 70 15 50 0.35 75 0 0 | ClearSunset 15 0 0 0.35 15 0 0 | CloudySunset 80 0 0 0.35 15 0 0
WetSunset 20 0 50 0.35 15 0 0 | WetCloudySunset 90 0 50 0.35 15 0 0 | MidRainSunset 80 30 50 0.35 15 0 0
HardRainSunset 80 60 100 0.35 15 0 0 | SoftRainSunset 90 15 50 0.35 15 0 0
"""


def rows(table: str) -> dict[str, tuple[float, ...]]:
    cells = [cell.split() for line in table.strip().splitlines() for cell in line.split("|")]
    return {name: tuple(map(float, values)) for name, *values in cells}


@pytest.mark.parametrize(("table", "presets"), [(TABLE_0_9_16, WEATHERS_0_9_16), (TABLE_0_9_10, WEATHERS_0_9_10)])
def test_presets_are_those_of_the_release(table: str, presets: dict[str, Weather]) -> None:
    expected = rows(table)
    assert set(presets) == {*expected, "Default"}
    for name, values in expected.items():
        w = presets[name]
        got = (w.cloudiness, w.precipitation, w.precipitation_deposits, w.wind_intensity, w.sun_altitude_angle,
               w.fog_density, w.wetness)  # fmt: skip
        assert got == values, name


def test_fog_starts_far_off_in_two_nights() -> None:
    far = {name for name, weather in WEATHERS_0_9_16.items() if weather.fog_distance == 75.0}
    assert far == {"ClearNight", "WetNight"}
    assert {WEATHERS_0_9_16[name].fog_falloff for name in far} == {1.0}
    assert {w.fog_distance for name, w in WEATHERS_0_9_16.items() if name not in far} == {0.75}


def test_the_four_weathers_of_the_validation_routes() -> None:
    got = {
        name: (w.cloudiness, w.precipitation, w.precipitation_deposits, w.wind_intensity, w.sun_azimuth_angle,
               w.sun_altitude_angle)
        for name, w in WEATHERS_LAV.items()
    }  # fmt: skip
    assert got == {
        "ClearNoon": (15, 0, 0, 0.35, 0, 75),
        "CloudySunset": (80, 0, 0, 0.35, 270, 15),
        "SoftRainDawn": (90, 15, 50, 0.35, 315, 5),
        "HardRainNight": (90, 60, 100, 1.0, 225, -80),
    }


def test_presets_are_found_by_name_and_wrong_ones_refused() -> None:
    assert find_weather("WetNoon").sun_altitude_angle == 45.0
    assert find_weather("WetNoon", "1.0").sun_altitude_angle == 75.0
    assert find_weather("SoftRainDawn", "lav").is_night is False
    with pytest.raises(UnknownName, match=r"no weather 'ClearNon'. Did you mean 'ClearNoon'"):
        find_weather("ClearNon")
    with pytest.raises(UnknownName, match="generation"):
        find_weather("ClearNoon", "3.0")


def test_weather_changes_linearly_between_keyframes_and_holds_outside() -> None:
    clear, storm = find_weather("ClearNoon"), find_weather("HardRainNight")
    frames = (WeatherKeyframe(20.0, clear), WeatherKeyframe(60.0, storm))
    assert weather_at((), 50.0) == Weather()
    assert weather_at(frames, 0.0) is clear
    assert weather_at(frames, 20.0) is clear
    assert weather_at(frames, 100.0) is storm
    middle = weather_at(frames, 40.0)
    assert middle.cloudiness == pytest.approx(52.5)
    assert middle.sun_altitude_angle == pytest.approx(-22.5)
    assert weather_at((WeatherKeyframe(0.0, clear), WeatherKeyframe(100.0, clear)), 30.0) is clear


@given(marks=st.lists(st.floats(0.0, 100.0), min_size=1, max_size=6), at=st.floats(-10.0, 110.0))
def test_weather_stays_within_its_keyframes(marks: list[float], at: float) -> None:
    names = sorted(WEATHERS_0_9_16)
    frames = [WeatherKeyframe(mark, WEATHERS_0_9_16[names[k]]) for k, mark in enumerate(sorted(marks))]
    values = np.array([frame.weather.to_array() for frame in frames])
    got = weather_at(frames, at).to_array()
    assert np.all(got >= values.min(axis=0) - 1e-4)
    assert np.all(got <= values.max(axis=0) + 1e-4)


def test_a_weather_survives_its_array() -> None:
    for weather in (*WEATHERS_0_9_16.values(), *WEATHERS_LAV.values()):
        assert np.array_equal(Weather.from_array(weather.to_array()).to_array(), weather.to_array())
