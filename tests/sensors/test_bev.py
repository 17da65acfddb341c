"""The world from above: what lies at which pixel."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.errors import SensorError
from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.render.scene import Scene, get_scene
from lavsim.sensors.base import make_sensor
from lavsim.sensors.bev import Bev, ego_column, ego_row
from lavsim.types import ActorClass, LaneType, LightState
from lavsim.world.snapshot import Snapshot
from tests.snapshots import EGO, Body, snapshot_of

DRAWS = Draws.of_seed(0)
TOWN = "eu_small_a"


@cache
def scene() -> Scene:
    return get_scene(load_town(TOWN))


@cache
def straight() -> tuple[float, float, float]:
    """A pose in the middle of the longest lane outside junctions."""
    lanes = load_town(TOWN).lanes
    lane = int(np.argmax(np.where((lanes.type == LaneType.DRIVING) & (lanes.junction < 0), lanes.length, 0.0)))
    x, y, _, yaw, _ = load_town(TOWN).centre([lane], [lanes.length[lane] / 2.0])[0]
    return float(x), float(y), float(yaw)


def beside(ahead: float, right: float, number: int = 1000, **changes: Any) -> Body:
    """A body so far ahead and right of the straight's pose."""
    x, y, yaw = straight()
    c, s = np.cos(yaw), np.sin(yaw)
    return Body(number, x + ahead * c - right * s, y + ahead * s + right * c, yaw=yaw, **changes)


def ego() -> Body:
    x, y, yaw = straight()
    return replace(EGO, x=x, y=y, yaw=yaw)


def walker(ahead: float, right: float) -> Body:
    return beside(ahead, right, 100_000, kind=ActorClass.WALKER, size=(0.4, 0.4, 1.8))


def bev(**attributes: Any) -> Bev:
    sensor = make_sensor({"type": "sensor.lavsim.bev", "id": "bev", "attributes": attributes})
    assert isinstance(sensor, Bev)
    return sensor


def read(snapshots: Snapshot | list[Snapshot], **attributes: Any) -> np.ndarray:
    history = snapshots if isinstance(snapshots, list) else [snapshots]
    return bev(**attributes).read(history, scene(), DRAWS)


def middle(layer: np.ndarray) -> tuple[float, float]:
    """Column and row of the middle of what is set."""
    rows, columns = np.nonzero(layer)
    return float(columns.mean() + 0.5), float(rows.mean() + 0.5)


def test_ego_stands_where_lav_has_it_and_fills_its_box() -> None:
    layers = read(snapshot_of([ego()]))
    assert layers.shape == (5, 320, 320)
    assert middle(layers[1]) == pytest.approx((160.0, 280.0), abs=0.6)
    length, width, _ = EGO.size
    assert (layers[1] > 0).sum() == pytest.approx(16.0 * length * width, rel=0.2)
    assert set(np.unique(layers)) == {0, 255}


@settings(max_examples=30, deadline=None)
@given(st.floats(-8.0, 60.0), st.floats(-30.0, 30.0), st.floats(2.0, 8.0), st.floats(-10.0, 30.0), st.floats(-5.0, 5.0))
def test_a_car_shows_where_it_is(ahead: float, right: float, scale: float, shift: float, aside: float) -> None:
    sensor = bev(layers="vehicle", width=400, height=300, pixels_per_metre=scale, ahead=shift, right=aside)
    x, y, yaw = straight()
    far = replace(EGO, x=x, y=y, yaw=yaw)
    snapshot = snapshot_of([far, beside(ahead, right, size=(1.0, 1.0, 1.5))])
    column = ego_column(sensor.config) + right * scale
    row = ego_row(sensor.config) - ahead * scale
    layer = sensor.read([snapshot], scene(), DRAWS)[0]
    if 1.0 <= column < 399.0 and 1.0 <= row < 299.0 and np.hypot(ahead, right) < 40.0:
        assert layer[int(row), int(column)] == 255


def test_road_is_the_union_of_driving_lanes() -> None:
    town, sensor = load_town(TOWN), bev(layers="road,limit")
    rng = np.random.default_rng(0)
    x, y, yaw = straight()
    road, limit = sensor.read([snapshot_of([ego()])], scene(), DRAWS)
    columns, rows = rng.integers(0, 320, 800), rng.integers(0, 320, 800)
    ahead, right = (280.0 - rows - 0.5) / 4.0, (columns + 0.5 - 160.0) / 4.0
    points = np.stack([x + ahead * np.cos(yaw) - right * np.sin(yaw), y + ahead * np.sin(yaw) + right * np.cos(yaw)], 1)
    hits = town.nearest(points, LaneType.DRIVING)
    inside = hits.width / 2.0 - np.abs(hits.offset)
    clear = np.abs(inside) > 0.25
    assert clear.sum() > 500
    assert ((road[rows, columns] == 255) == (inside > 0.0))[clear].mean() > 0.995
    on = (road[rows, columns] == 255) & clear
    assert (np.abs(limit[rows, columns][on] - town.lanes.speed_limit[hits.lane[on]] * 3.6) < 1.0).mean() > 0.95


def test_marks_are_two_pixels_wide_and_broken_ones_drawn_through() -> None:
    layers = read(snapshot_of([ego()]))
    marks = np.maximum(layers[3], layers[4])
    widths = (marks[200:300] > 0).sum(axis=1)
    count = (np.diff((marks[200:300] > 0).astype(int), axis=1) == 1).sum(axis=1)
    assert (count >= 1).all()  # on each row, so no dashes
    assert np.median(widths / count) == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize(
    ("ahead", "right", "shows"),
    [(8.0, 0.5, True), (8.0, 30.0, False), (25.0, 0.0, False), (-6.0, 0.0, False), (2.0, 1.0, True)],
)
def test_pedestrians_show_as_hazards_only_on_the_road_near_and_ahead(ahead: float, right: float, shows: bool) -> None:
    layers = read(snapshot_of([ego(), walker(ahead, right)]), layers="pedestrian,walker")
    assert bool(layers[0].any()) == shows
    if shows:  # a disc of radius 0.2 m + 1 m; OpenCV fills the rim too
        assert (layers[0] > 0).sum() == pytest.approx(np.pi * (1.2 * 4.0 + 0.5) ** 2, rel=0.2)
        assert middle(layers[0]) == pytest.approx((160.0 + 4.0 * right, 280.0 - 4.0 * ahead), abs=0.7)
        assert 0 < (layers[1] > 0).sum() < 12


def test_stop_lines_carry_the_state_of_their_light() -> None:
    town = load_town(TOWN)
    stop = town.lights[0].stop_lines[0]
    x, y = stop.x - 8.0 * np.cos(stop.yaw), stop.y - 8.0 * np.sin(stop.yaw)
    here = replace(EGO, x=float(x), y=float(y), yaw=stop.yaw)
    for state, name in ((LightState.RED, "red"), (LightState.GREEN, "green"), (LightState.YELLOW, "yellow")):
        layers = read(snapshot_of([here], lights=[int(state)] * len(town.lights)), layers="red,yellow,green")
        shown = {n for n, layer in zip(("red", "yellow", "green"), layers, strict=True) if layer.any()}
        assert shown == {name}
        assert layers[("red", "yellow", "green").index(name), 248, 160] == 255
    assert not read(snapshot_of([here], lights=[LightState.OFF] * len(town.lights)), layers="red,yellow,green").any()


def test_past_moments_are_drawn_in_todays_frame() -> None:
    snapshots = [snapshot_of([beside(t, 0.0, 1), beside(20.0 - t, 3.5)], tick=t) for t in range(11)]
    sensor = bev(layers="vehicle,road", past=3, every=5)
    assert sensor.history == 15
    assert sensor.channels == ("vehicle", "road", "vehicle-1", "vehicle-2", "vehicle-3")
    layers = sensor.read(snapshots, scene(), DRAWS)
    for channel, age in ((0, 0), (2, 5), (3, 10)):
        where = layers[channel][:, 165:]  # the other car, to the right of the ego
        assert middle(where)[1] == pytest.approx(280.0 - 4.0 * age, abs=1.0)
        own = layers[channel][:, 150:165]
        assert middle(own)[1] == pytest.approx(min(280.0 + 4.0 * age, 315.5), abs=1.0)  # cut by the lower edge
    assert not layers[4].any()  # before the drive began


def test_route_is_a_line_through_its_points() -> None:
    x, y, yaw = straight()
    points = [[x + d * np.cos(yaw), y + d * np.sin(yaw)] for d in (0.0, 10.0, 50.0)]
    layer = read(snapshot_of([ego()]), layers="route", route=points)[0]
    assert (layer[90:270, 160] == 255).all()
    assert not layer[:70].any()
    assert not read(snapshot_of([ego()]), layers="route").any()


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"layers": "road,vehicles"}, r"sensor 'bev': no layer 'vehicles'\. Did you mean 'vehicle'"),
        ({"width": 0}, r"'width' must be 1 to 4096 pixels, got 0\."),
        ({"pixels_per_metre": 0}, r"'pixels_per_metre' must be 0\.1 to 100, got 0\."),
        ({"past": -1}, r"'past' must be 0 to 40, got -1\."),
        ({"every": 0}, r"'every' must be at least 1 tick, got 0\."),
        ({"route": [1.0, 2.0]}, r"'route' must be points \(x, y\)"),
        ({"hight": 320}, r"'hight'\. Did you mean 'height'"),
    ],
)
def test_bad_attribute_gets_one_clear_line(attributes: dict[str, Any], message: str) -> None:
    with pytest.raises(SensorError, match=message) as caught:
        bev(**attributes)
    assert "\n" not in str(caught.value)
