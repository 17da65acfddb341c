"""Values of the single sensors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lavsim.geometry import geolocation
from lavsim.random import Draws
from lavsim.render.ground import Surface
from lavsim.sensors.base import Sensor, make_sensor
from lavsim.sensors.gnss import Gnss
from lavsim.sensors.lidar import Lidar
from lavsim.types import ActorClass, Tag
from lavsim.world.blueprints import BLUEPRINTS
from tests.prisms import box
from tests.scenes import plain, street
from tests.snapshots import EGO, Body, snapshot_of

DRAWS = Draws.of_seed(0)
BARE = plain()


def sensor(kind: str, **keys: Any) -> Sensor:
    return make_sensor({"type": kind, "id": "s", **keys})


def test_gnss_is_the_leaderboards_projection_with_its_noise() -> None:
    snapshots = [snapshot_of([replace(EGO, x=120.0, y=-45.0)], tick=t) for t in range(400)]
    gnss = sensor("sensor.other.gnss", z=2.4)
    assert isinstance(gnss, Gnss)
    error = np.array([gnss.read([s], BARE, DRAWS) for s in snapshots]) - [*geolocation(120.0, -45.0), 2.4]
    np.testing.assert_allclose(error.std(axis=0), 5e-6, rtol=0.15)
    assert np.abs(error.mean(axis=0)).max() < 1e-6
    assert geolocation(0.0, -10.0)[0] > 0.0  # north is -y


@pytest.mark.parametrize(("yaw", "compass"), [(-np.pi / 2, 0.0), (0.0, np.pi / 2), (np.pi / 2, np.pi), (-2.0, 5.854)])
def test_compass_is_clockwise_from_north(yaw: float, compass: float) -> None:
    reading = sensor("sensor.other.imu").read([snapshot_of([replace(EGO, yaw=yaw)])], BARE, DRAWS)
    assert reading[6] == pytest.approx(compass, abs=1e-3)


def test_imu_at_rest_shows_gravity_and_in_a_turn_what_the_snapshot_says() -> None:
    motions = ((0.0,) * 6, (1.5, -0.7, 0.2, 0.01, 0.02, 0.3))
    rest, turn = (sensor("sensor.other.imu").read([snapshot_of(ego_motion=m)], BARE, DRAWS) for m in motions)
    np.testing.assert_allclose(rest[:6], [0, 0, 9.81, 0, 0, 0], atol=0.06)
    np.testing.assert_allclose(turn[:6] - rest[:6], motions[1], atol=1e-6)


def test_imu_on_a_slope_and_on_a_turned_mount() -> None:
    climbing = snapshot_of([replace(EGO, pitch=0.2)])
    reading = sensor("sensor.other.imu").read([climbing], BARE, DRAWS)
    np.testing.assert_allclose(reading[:3], [9.81 * np.sin(0.2), 0.0, 9.81 * np.cos(0.2)], atol=0.06)
    aside = sensor("sensor.other.imu", yaw=90.0).read([snapshot_of(ego_motion=(2, 0, 0, 0, 0, 0))], BARE, DRAWS)
    np.testing.assert_allclose(aside[:3], [0.0, -2.0, 9.81], atol=0.06)


def test_speedometer_is_negative_in_reverse() -> None:
    for speed in (7.5, -2.0):
        reading = sensor("sensor.speedometer").read([snapshot_of([replace(EGO, speed=speed, yaw=1.0)])], BARE, DRAWS)
        assert reading["speed"] == pytest.approx(speed, abs=0.02)


def test_truth_holds_who_is_near_with_the_ego_first() -> None:
    bodies = [EGO, Body(1000, 30.0), Body(1001, 99.0, 20.0), Body(1002, -60.0)]
    reading = sensor("sensor.lavsim.truth").read([snapshot_of(bodies)], BARE, DRAWS)
    assert list(reading["ids"]) == [1, 1000, 1002]
    assert list(sensor("sensor.lavsim.truth", radius=40).read([snapshot_of(bodies)], BARE, DRAWS)["ids"]) == [1, 1000]


def test_truth_counts_what_is_seen_only_when_asked() -> None:
    wall = plain(box(8.0, -6.0, 1.0, 8.0, 0.0, 6.0))
    bodies = [EGO, Body(1000, 15.0, 1.0), Body(1001, 15.0, -6.0), Body(1002, -15.0, 0.0), Body(1003, 45.0, 4.0)]
    snapshot = snapshot_of(bodies)
    plainly = sensor("sensor.lavsim.truth").read([snapshot], wall, DRAWS)
    assert "pixels" not in plainly
    seeing = sensor("sensor.lavsim.truth", visibility=True)
    reading = seeing.read([snapshot], wall, DRAWS)
    assert set(reading) == set(seeing.spec)  # type: ignore[arg-type]
    for key in ("lidar_hits", "pixels"):
        ahead, hidden, behind, far = reading[key][1:]
        assert hidden == 0  # behind the wall
        assert min(ahead, behind) > 5 * far > 0
    assert reading["lidar_hits"][0] == 0  # the LiDAR looks over its own roof


def test_depth_camera_has_carlas_code() -> None:
    scene = plain(box(21.5, 0.0, 2.0, 30.0, 0.0, 30.0))
    image = sensor("sensor.camera.depth", x=0.5, z=1.0, width=20, height=20, fov=60).read([snapshot_of()], scene, DRAWS)
    blue, green, red = (image[5, 10, c].astype(int) for c in range(3))
    assert (red + 256 * green + 65536 * blue) / (2**24 - 1) * 1000.0 == pytest.approx(20.0, abs=1e-3)
    up = sensor("sensor.camera.depth", z=40.0, pitch=60, width=4, height=4, fov=40).read([snapshot_of()], BARE, DRAWS)
    assert (up == 255).all()


def test_tag_and_instance_cameras_have_carlas_channels() -> None:
    keys = {"x": 1.5, "z": 2.4, "width": 64, "height": 64, "fov": 60}
    snapshot = snapshot_of([EGO, Body(70_003, 12.0)])
    tags = sensor("sensor.camera.semantic_segmentation", **keys).read([snapshot], BARE, DRAWS)
    assert set(np.unique(tags[..., 2])) == {Tag.SKY, Tag.ROAD, Tag.VEHICLE, Tag.TERRAIN}
    assert (tags[..., :2] == 0).all()
    image = sensor("sensor.camera.instance_segmentation", **keys).read([snapshot], BARE, DRAWS)
    vehicle = image[..., 2] == Tag.VEHICLE
    assert set((image[vehicle, 1].astype(int) + 256 * image[vehicle, 0].astype(int)).tolist()) == {70_003 & 0xFFFF}


def test_lidar_points_fall_on_what_the_camera_calls_them() -> None:
    scene = street()
    bodies = [EGO, Body(1000, 16.0, 0.5, yaw=0.3), Body(1001, 24.0, -2.5, kind=ActorClass.TRUCK, size=(7.9, 2.9, 3.4)),
              Body(100000, 11.0, 3.0, kind=ActorClass.WALKER, size=(0.5, 0.5, 1.8))]  # fmt: skip
    camera = sensor("sensor.camera.rgb", x=1.5, z=2.4, width=512, height=512, fov=80).view  # type: ignore[attr-defined]
    lidar = sensor("sensor.lidar.ray_cast", x=1.5, z=2.4)
    assert isinstance(lidar, Lidar)
    for tick in (0, 1):
        snapshot = snapshot_of(bodies, tick=tick)
        tags, instance = camera.labels(snapshot, scene)
        sweep = lidar.sweep(snapshot, scene, DRAWS)
        points = lidar.config.mount.pose(snapshot).to_world(sweep.points[:, :3].astype(np.float64))
        column, row, depth = camera.project(points, snapshot).T
        seen = (depth > 1.0) & (column >= 0) & (column < 512) & (row >= 0) & (row < 512)
        at = row[seen].astype(int), column[seen].astype(int)
        actors = scene.actors(snapshot)
        owner = np.where(sweep.solids >= 0, np.concatenate([scene.statics.instance, actors.instance])[sweep.solids], 0)
        assert (instance[at] == owner[seen]).mean() > 0.99
        tag_of_ground = tags[at][sweep.solids[seen] < 0]
        assert np.isin(tag_of_ground, [Tag.ROAD, Tag.ROAD_LINE, Tag.SIDEWALK, Tag.TERRAIN]).mean() > 0.99
        assert (owner[seen] == 1000).any()


@pytest.mark.parametrize("blueprint", ["vehicle.lincoln.mkz_2017", "vehicle.lincoln.mkz_2020"])
def test_lidar_on_the_lav_mount_looks_over_its_own_car(blueprint: str) -> None:
    lidar = sensor("sensor.lidar.ray_cast", z=2.4)
    assert isinstance(lidar, Lidar)
    ego = replace(EGO, blueprint=blueprint, size=BLUEPRINTS[blueprint].size)
    for tick in (0, 1):
        assert (lidar.sweep(snapshot_of([ego], tick=tick), BARE, DRAWS).solids < len(BARE.statics.corners)).all()


def test_lidar_of_a_turned_and_moved_ego_sees_the_same_in_its_own_frame() -> None:
    lidar = sensor("sensor.lidar.ray_cast", z=2.4)
    here = lidar.read([snapshot_of([EGO, Body(1000, 10.0, 3.0)], tick=1)], BARE, DRAWS)
    c, s = np.cos(0.5), np.sin(0.5)
    there = [replace(EGO, x=5.0, y=-4.0, yaw=0.5), Body(1000, 5.0 + 10 * c - 3 * s, -4.0 + 10 * s + 3 * c, yaw=0.5)]
    moved = lidar.read([snapshot_of(there, tick=1)], BARE, DRAWS)
    assert abs(len(moved) - len(here)) < 30
    car = [points[points[:, 2] > -2.3][:, :3].mean(axis=0) for points in (here, moved)]
    np.testing.assert_allclose(car[0], car[1], atol=0.05)


def test_surface_outside_the_raster_is_terrain() -> None:
    scene = plain(surface=Surface.ROAD, reach=5.0)
    keys = {"x": 0.0, "z": 2.0, "width": 32, "height": 32, "fov": 90}
    tags = sensor("sensor.camera.semantic_segmentation", **keys).read([snapshot_of()], scene, DRAWS)[..., 2]
    assert Tag.TERRAIN in tags[17]
