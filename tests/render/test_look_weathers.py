"""Every preset of CARLA and LAV's test weathers, in both looks."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from lavsim.random import Draws
from lavsim.render.look import LOOKS
from lavsim.render.sheet import CAMERAS
from lavsim.types import LightState
from lavsim.world.weather import Weather
from lavsim.world.weather_presets import WEATHERS_0_9_10, WEATHERS_0_9_16, WEATHERS_LAV
from tests.scenes import plain, signal, street
from tests.snapshots import EGO, Body, snapshot_of

TABLES = {"0.9.10": WEATHERS_0_9_10, "0.9.16": WEATHERS_0_9_16, "LAV": WEATHERS_LAV}
TELEPHOTO, FRONT = CAMERAS[3][1], CAMERAS[1][1]
DRAWS = Draws.of_seed(2)


def red_and_green(image: np.ndarray) -> tuple[int, int]:
    """How many pixels a plain threshold calls red, and green."""
    blue, green, red = (image[..., c].astype(int) for c in range(3))
    return (
        int(((red > 120) & (red - green > 60) & (red - blue > 60)).sum()),
        int(((green > 120) & (green - red > 60) & (green - blue > 20)).sum()),
    )


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("table", sorted(TABLES))
def test_red_light_is_told_from_green_at_50_metres_by_a_threshold(table: str, look: str) -> None:
    scene = plain(signal(51.5, 3.0))
    for name, weather in TABLES[table].items():
        for state in (LightState.RED, LightState.GREEN):
            image = TELEPHOTO.colour(snapshot_of(lights=[state], weather=weather), scene, DRAWS, look)
            red, green = red_and_green(image)
            assert (red >= 8, green >= 8) == (state == LightState.RED, state == LightState.GREEN), name
            assert min(red, green) == 0, name


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("table", sorted(TABLES))
def test_no_two_weathers_look_alike(table: str, look: str) -> None:
    bodies = [EGO, Body(1000, 14.0, -2.0, lights=3)]
    images: dict[Weather, np.ndarray] = {}
    for weather in TABLES[table].values():  # presets that name the same weather count once
        image = FRONT.colour(snapshot_of(bodies, weather=weather), street(), None, look)
        images[weather] = image[..., :3].astype(int)
    for a, b in combinations(images.values(), 2):
        assert np.abs(a - b).mean() > 0.4


def test_weathers_order_as_they_should() -> None:
    bright = {
        name: FRONT.colour(snapshot_of(weather=w), street())[..., :3].mean() for name, w in WEATHERS_0_9_16.items()
    }
    for kind in ("Clear", "Cloudy", "Wet", "HardRain"):
        assert bright[f"{kind}Noon"] > bright[f"{kind}Sunset"] > 2.0 * bright[f"{kind}Night"]
    assert bright["ClearNoon"] > bright["WetNoon"]
