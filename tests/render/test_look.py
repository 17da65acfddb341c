"""What colours must show in any weather."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lavsim.random import Draws
from lavsim.render.paint import is_blink_on
from lavsim.render.sheet import CAMERAS
from lavsim.types import VehicleLight
from lavsim.world.weather import Weather
from tests.scenes import plain, street
from tests.snapshots import EGO, Body, snapshot_of

FRONT = CAMERAS[1][1]
DRAWS = Draws.of_seed(5)


def test_noise_belongs_to_camera_and_tick_and_is_small() -> None:
    clean = FRONT.colour(snapshot_of(tick=3), street()).astype(int)
    one, again, other = (
        FRONT.colour(snapshot_of(tick=3), street(), DRAWS.stream(name)).astype(int) for name in ("a", "a", "b")
    )
    later = FRONT.colour(snapshot_of(tick=4), street(), DRAWS.stream("a")).astype(int)
    assert (one == again).all()
    for image in (one, other, later):
        inside = (clean[..., :3] > 20) & (clean[..., :3] < 235)
        error = (image - clean)[..., :3][inside]
        assert 0.8 < error.std() < 3.0
        assert abs(error.mean()) < 0.1
    assert (one != other).mean() > 0.3
    assert (one != later).mean() > 0.3
    rows = (one - clean)[60:120, :, 1].astype(float)
    assert abs(np.corrcoef(rows[:-1].ravel(), rows[1:].ravel())[0, 1]) < 0.05  # no stripes


def test_indicators_blink_at_one_and_a_half_hertz_with_the_tick() -> None:
    shining = [is_blink_on(tick) for tick in range(40)]  # 2 s
    assert sum(a and not b for a, b in pairwise(shining)) == 3
    assert 18 <= sum(shining) <= 22
    car = Body(1000, 12.0, 0.0, colour=(90, 90, 90), lights=int(VehicleLight.LEFT_BLINKER))
    on, off, none = (
        FRONT.colour(snapshot_of([EGO, body], tick=tick), plain())[..., :3].astype(int)
        for body, tick in ((car, 0), (car, 8), (replace(car, lights=0), 0))
    )
    left, right = slice(100, 128), slice(128, 156)
    assert (np.abs(on - none)[:, left].max(axis=2) > 60).sum() > 4
    assert (np.abs(on - none)[:, right].max(axis=2) > 60).sum() == 0
    assert (off == none).all()


@pytest.mark.parametrize(("field", "value"), [("wetness", 90.0), ("precipitation_deposits", 90.0)])
def test_water_darkens_the_road_more_than_the_grass(field: str, value: float) -> None:
    dry, wet = (FRONT.colour(snapshot_of(weather=w), street()) for w in (Weather(), Weather(**{field: value})))
    tags, _ = FRONT.labels(snapshot_of(), street())
    loss = {tag: wet[tags == tag][:, :3].mean() / dry[tags == tag][:, :3].mean() for tag in (7, 22)}
    assert loss[7] < 0.75 < loss[22] < 1.0
