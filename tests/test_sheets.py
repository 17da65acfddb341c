"""Contact sheets by weather."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from lavsim.map.town_files import load_town
from lavsim.sheets import moment, weather_sheets
from lavsim.world.weather import Weather
from lavsim.world.weather_presets import WEATHERS_LAV


def test_each_weather_gets_a_sheet_of_both_looks(tmp_path: Path) -> None:
    town = load_town("eu_small_a")
    chosen = {name: WEATHERS_LAV[name] for name in ("ClearNoon", "HardRainNight")}
    paths = list(weather_sheets(town, chosen, tmp_path))
    assert [p.name for p in paths] == ["eu_small_a-ClearNoon.png", "eu_small_a-HardRainNight.png"]
    noon, night = (cv2.imread(str(path)).astype(float) for path in paths)
    assert noon.shape == night.shape
    assert noon[20:300].mean() > 2.5 * night[20:300].mean()  # the row of `fast`
    assert np.abs(noon[20:308] - noon[334:622]).mean() > 3.0  # `full` looks otherwise


def test_the_moment_is_before_a_light_under_the_weather_asked_for() -> None:
    weather = Weather(cloudiness=77.0)
    history = moment(load_town("eu_small_a"), weather)
    assert [s.weather.cloudiness for s in history] == [77.0, 77.0]
    stops = np.array([(s.x, s.y) for light in load_town("eu_small_a").lights for s in light.stop_lines])
    assert np.hypot(*(stops - history[-1].ego.xy).T).min() < 30.0
