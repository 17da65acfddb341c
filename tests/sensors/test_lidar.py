"""LiDARs of any make, and what is made of their returns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lavsim.errors import SensorError
from lavsim.random import Draws
from lavsim.render.sweep import RAIN_HIT, LidarModel
from lavsim.sensors.base import make_sensor
from lavsim.sensors.lidar import SEMANTIC_DTYPE, Lidar, between
from lavsim.types import ActorClass, Tag
from lavsim.world.weather import Weather
from tests.prisms import box
from tests.scenes import plain, street
from tests.snapshots import EGO, Body, snapshot_of

DRAWS = Draws.of_seed(0)
EVERY = {"dropoff_general_rate": 0.0, "dropoff_zero_intensity": 0.0}


def lidar(kind: str = "sensor.lidar.ray_cast", keys: dict[str, Any] | None = None, **attributes: Any) -> Lidar:
    values = {"type": kind, "id": "top", "z": 2.4, "attributes": attributes} | (keys or {})
    sensor = make_sensor(values)
    assert isinstance(sensor, Lidar)
    return sensor


def room(half: float = 20.0, height: float = 60.0):  # type: ignore[no-untyped-def]
    ends = [box(side * (half + 0.5), 0.0, 1.0, 2.0 * half + 2.0, 0.0, height) for side in (-1, 1)]
    return plain(*ends, *(box(0.0, s * (half + 0.5), 2.0 * half + 2.0, 1.0, 0.0, height) for s in (-1, 1)))


def angles(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation [deg] of points."""
    flat = np.hypot(points[:, 0], points[:, 1])
    return np.degrees(np.arctan2(points[:, 1], points[:, 0])), np.degrees(np.arctan2(points[:, 2], flat))


def test_default_is_the_leaderboards_and_keys_outside_attributes_change_nothing() -> None:
    assert lidar().model == LidarModel()
    assert lidar(keys={"channels": 8, "range": 5, "rotation_frequency": 20}).model == LidarModel()


def test_attributes_may_be_texts_as_carlas_are() -> None:
    assert lidar(channels="32", range="50", full_sweep="true").model == LidarModel(32, 50.0, full_sweep=True)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"chanels": 32}, r"no attribute of sensor 'top' 'chanels'\. Did you mean 'channels'"),
        ({"channels": 0}, r"'channels' must be 1 to 1024, got 0"),
        ({"channels": 2.5}, r"'channels' must be a whole number"),
        ({"range": -1}, r"'range' must be 0\.1 to 1000"),
        ({"horizontal_fov": 400}, r"'horizontal_fov' must be 0\.1 to 360"),
        ({"upper_fov": -40}, r"'upper_fov' must be -30 to 89, got -40"),
        ({"points_per_second": 1e9}, r"a tick must have 1 to 4000000 beams"),
        ({"full_sweep": 3}, r"'full_sweep' must be true or false"),
        ({"range": "far"}, r"'range' must be a number, got 'far'"),
        (7, r"'attributes' must be a dict"),
    ],
)
def test_bad_attributes_get_one_clear_line(attributes: Any, message: str) -> None:
    with pytest.raises(SensorError, match=message):
        make_sensor({"type": "sensor.lidar.ray_cast", "id": "top", "attributes": attributes})


@pytest.mark.parametrize(("channels", "rate", "turns"), [(16, 320_000, 10.0), (1, 20_000, 5.0), (128, 2_400_000, 20.0)])
def test_any_channels_and_rates(channels: int, rate: int, turns: float) -> None:
    sensor = lidar(channels=channels, points_per_second=rate, rotation_frequency=turns, upper_fov=5, lower_fov=-5,
                   **EVERY)  # fmt: skip
    points = sensor.read([snapshot_of(tick=1)], room(), DRAWS)
    columns = round(rate * 0.05 / channels)
    assert len(points) == channels * columns
    azimuth, elevation = angles(points)
    assert len(np.unique(elevation.round(2))) == channels
    swept = np.unwrap(np.radians(azimuth[:columns]))
    assert np.degrees(swept[-1] - swept[0]) == pytest.approx(turns * 18.0 * (columns - 1) / columns, abs=0.01)


def test_sector_is_swept_as_carla_does() -> None:
    """Azimuths are fmod(start + j * step, fov) - fov / 2, and `start` goes on by the part swept."""
    sensor = lidar(horizontal_fov=90, rotation_frequency=8, channels=2, points_per_second=4_000, upper_fov=1,
                   lower_fov=-1, **EVERY)  # fmt: skip
    for tick in (0, 1, 2, 3):
        azimuth, _ = angles(sensor.read([snapshot_of(tick=tick)], room(), DRAWS))
        expected = np.fmod((tick * 0.4 % 1.0) * 90.0 + np.arange(100) * 8.0 * 90.0 * 0.05 / 100, 90.0) - 45.0
        np.testing.assert_allclose(azimuth[:100], expected, atol=1e-3)


def test_full_sweep_is_a_whole_turn_at_every_tick() -> None:
    sensor = lidar(full_sweep=True, **EVERY)
    for tick in (0, 1):
        points = sensor.read([snapshot_of(tick=tick)], room(20.0, 300.0), DRAWS)
        assert len(points) == 64 * 938  # round(600 000 / 10 / 64)
        azimuth, _ = angles(points[:938])
        assert azimuth[0] == pytest.approx(-180.0, abs=0.01)
        np.testing.assert_allclose(np.diff(np.unwrap(np.radians(azimuth))), 2.0 * np.pi / 938, atol=1e-4)


def test_noise_lies_along_the_ray() -> None:
    clean, noisy = (
        lidar(noise_stddev=std, **EVERY).read([snapshot_of()], room(20.0, 300.0), DRAWS) for std in (0, 0.1)
    )
    length = [np.linalg.norm(p[:, :3], axis=1) for p in (clean, noisy)]
    np.testing.assert_allclose(noisy[:, :3] / length[1][:, None], clean[:, :3] / length[0][:, None], atol=1e-5)
    error = length[1] - length[0]
    assert error.std() == pytest.approx(0.1, rel=0.02)
    assert abs(error.mean()) < 0.003
    assert (noisy[:, 3] == clean[:, 3]).all()  # CARLA moves the point after it has worked out the intensity


def test_rain_loses_far_returns_and_adds_near_ones() -> None:
    dry, wet = snapshot_of(), snapshot_of(weather=Weather(precipitation=100.0))
    scene = room(40.0, 300.0)
    blind, felt = lidar(**EVERY), lidar(rain=True, **EVERY)
    assert (blind.read([dry], scene, DRAWS) == blind.read([wet], scene, DRAWS)).all()
    assert (felt.read([dry], scene, DRAWS) == blind.read([dry], scene, DRAWS)).all()
    sweep = felt.sweep(wet, scene, DRAWS)
    total = 64 * 469
    drops = sweep.solids == RAIN_HIT
    distance = np.linalg.norm(sweep.points[:, :3], axis=1)
    assert 0.015 < drops.sum() / total < 0.04
    assert distance[drops].max() <= 12.0
    assert np.median(sweep.points[drops, 3]) < np.median(sweep.points[~drops, 3])
    assert 0.06 < 1.0 - len(sweep.points) / total < 0.2


def test_motion_bends_what_stands_still_only_where_it_is_switched_on() -> None:
    """Towards a wall at 20 m/s: 1 m a tick."""
    scene = plain(box(20.0, 0.0, 1.0, 60.0, 0.0, 6.0))
    history = [snapshot_of([replace(EGO, x=float(tick), speed=20.0)], tick=tick) for tick in (1, 2)]
    still, moving = lidar(**EVERY), lidar(motion=True, **EVERY)
    assert (still.history, moving.history) == (0, 1)
    frozen, bent = (s.read(history, scene, DRAWS) for s in (still, moving))
    frozen, bent = (points[points[:, 2] > -2.0, 0] for points in (frozen, bent))
    np.testing.assert_allclose(frozen, 17.5, atol=1e-3)
    assert 0.3 < np.ptp(bent) < 1.0
    assert 17.5 < bent.min() < bent.max() < 18.5  # between where it was and where it is
    resting = [snapshot_of([EGO], tick=tick) for tick in (1, 2)]
    np.testing.assert_allclose(moving.read(resting, scene, DRAWS), still.read(resting, scene, DRAWS), atol=1e-4)
    assert (moving.read(history[-1:], scene, DRAWS) == still.read(history, scene, DRAWS)).all()  # the first tick


def test_moments_between_ticks_turn_the_short_way() -> None:
    before = snapshot_of([EGO, Body(1000, 5.0, yaw=3.1)], tick=1)
    after = snapshot_of([EGO, Body(1000, 6.0, yaw=-3.1), Body(1001, 9.0)], tick=2)
    half = between(before, after, 0.5)
    assert half.xyz[1, 0] == pytest.approx(5.5)
    assert abs(half.yaw[1]) == pytest.approx(np.pi, abs=1e-3)
    assert half.xyz[2, 0] == pytest.approx(9.0)


def test_semantic_lidar_tells_class_actor_and_incidence_of_every_beam() -> None:
    sensor = lidar("sensor.lidar.ray_cast_semantic", noise_stddev=0.5)
    walker = Body(100_000, 8.0, -3.0, kind=ActorClass.WALKER, size=(0.5, 0.5, 1.8))
    snapshot = snapshot_of([EGO, Body(1000, 12.0, -1.0), walker])
    records = sensor.read([snapshot], street(), DRAWS)
    assert records.dtype == SEMANTIC_DTYPE
    assert records.dtype.itemsize == 24
    plainly = lidar(**EVERY).read([snapshot], street(), DRAWS)
    assert len(records) == len(plainly)  # no drop-off, no noise
    np.testing.assert_array_equal(records["x"], plainly[:, 0])
    assert {Tag.ROAD, Tag.VEHICLE, Tag.PEDESTRIAN, Tag.BUILDING, Tag.SIDEWALK} <= set(records["ObjTag"].tolist())
    assert set(records["ObjTag"][records["ObjIdx"] == 1000].tolist()) == {Tag.VEHICLE}
    assert set(records["ObjTag"][records["ObjIdx"] == 100_000].tolist()) == {Tag.PEDESTRIAN}
    ground = np.abs(records["z"] + 2.4) < 1e-4
    distance = np.sqrt(records["x"] ** 2 + records["y"] ** 2 + records["z"] ** 2)
    np.testing.assert_allclose(records["CosAngle"][ground], 2.4 / distance[ground], rtol=1e-3)
    house = records["ObjTag"] == Tag.BUILDING
    front = house & (np.abs(np.abs(records["y"]) - 11.0) < 1e-3)
    np.testing.assert_allclose(records["CosAngle"][front], np.abs(records["y"][front]) / distance[front], rtol=1e-3)


def test_raster_counts_the_points_of_the_cloud_where_they_lie() -> None:
    keys = {"x": 0.5, "y": 0.2, "z": 2.4, "yaw": 25.0, "pixels_per_metre": 2.0, "bins": 5, "low": -0.25, "high": 2.25}
    raster = make_sensor({"type": "sensor.lavsim.lidar_raster", "id": "top", **keys})
    cloud = lidar(keys={"x": 0.5, "y": 0.2, "z": 2.4, "yaw": 25.0}, full_sweep=True)
    snapshot = snapshot_of([replace(EGO, x=3.0, y=-1.0, yaw=0.7), Body(1000, 14.0, 6.0, yaw=0.7)])
    reading = raster.read([snapshot], street(), DRAWS)
    points = cloud.read([snapshot], street(), DRAWS).astype(np.float64)
    c, s = np.cos(np.radians(25.0)), np.sin(np.radians(25.0))
    x, y = 0.5 + c * points[:, 0] - s * points[:, 1], 0.2 + s * points[:, 0] + c * points[:, 1]
    edges = [-0.25 + 0.5 * np.arange(6), np.arange(-10.0, 70.1, 0.5), np.arange(-40.0, 40.1, 0.5)]
    expected, _ = np.histogramdd(np.stack([points[:, 2] + 2.4, x, y], axis=1), edges)
    expected = np.minimum(expected[:, ::-1], 255)  # row 0 lies ahead
    assert reading["histogram"].shape == (5, 160, 160)
    difference = np.abs(reading["histogram"].astype(int) - expected)
    assert difference.sum() <= 0.001 * expected.sum()  # points on the border of two cells
    assert (reading["occupancy"] == (reading["histogram"].sum(axis=0) > 0)).all()
    ahead = reading["histogram"][1, :130, 72:85]  # the body of the car, half a metre up
    assert ahead.sum() > 30


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"pixels_per_metre": 0}, "'pixels_per_metre' must be positive"),
        ({"bins": 0}, "'bins' must be 1 to 64"),
        ({"ahead": -20}, "the image must have 1 to 4096 pixels a side"),
        ({"low": 4.0}, "'low' must be below 'high'"),
        ({"attributes": {"motion": True}}, "'motion' is for point clouds"),
    ],
)
def test_bad_rasters_get_one_clear_line(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(SensorError, match=message):
        make_sensor({"type": "sensor.lavsim.lidar_raster", "id": "top", **keys})
