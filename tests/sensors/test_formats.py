"""Every sensor's reading in the leaderboard's (else CARLA's) format: dtype, shape, order, units and frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, make_sensor
from lavsim.sensors.collision import COLLISION_DTYPE
from lavsim.sensors.lane_invasion import INVASION_DTYPE
from lavsim.sensors.lidar import SEMANTIC_DTYPE
from lavsim.sensors.obstacle import OBSTACLE_DTYPE
from lavsim.types import Tag
from lavsim.world.snapshot import CONTACT_DTYPE, Snapshot
from tests import worlds
from tests.prisms import box
from tests.scenes import plain, street
from tests.snapshots import EGO, Body, snapshot_of

DRAWS = Draws.of_seed(0)
CAMERA = {"width": 40, "height": 30, "fov": 70.0}

# Reference `leaderboard.md` 4.5 and, for what it does not allow, `carla.md` 6: shape (None: any), dtype, by key.
FORMATS: dict[str, Any] = {
    "sensor.camera.rgb": ((30, 40, 4), "uint8"),
    "sensor.camera.depth": ((30, 40, 4), "uint8"),
    "sensor.camera.semantic_segmentation": ((30, 40, 4), "uint8"),
    "sensor.camera.instance_segmentation": ((30, 40, 4), "uint8"),
    "sensor.lidar.ray_cast": ((None, 4), "float32"),
    "sensor.lidar.ray_cast_semantic": ((None,), SEMANTIC_DTYPE),
    "sensor.other.radar": ((None, 4), "float32"),
    "sensor.other.gnss": ((3,), "float64"),
    "sensor.other.imu": ((7,), "float64"),
    "sensor.speedometer": {"speed": ((), "float64")},
    "sensor.opendrive_map": {"opendrive": ((), str)},
    "sensor.other.collision": ((None,), COLLISION_DTYPE),
    "sensor.other.lane_invasion": ((None,), INVASION_DTYPE),
    "sensor.other.obstacle": ((None,), OBSTACLE_DTYPE),
}


def sensor(kind: str, **keys: Any):  # type: ignore[no-untyped-def]
    return make_sensor({"type": kind, "id": "s", "z": 1.0, **keys})


def read(kind: str, snapshot: Snapshot | list[Snapshot], scene: Scene, **keys: Any) -> Any:
    history = snapshot if isinstance(snapshot, list) else [snapshot]
    return sensor(kind, **keys).read(history, scene, DRAWS)


def has_format(data: Any, want: tuple[Any, Any]) -> bool:
    shape, dtype = want
    if dtype is str:
        return isinstance(data, str)
    array = np.asarray(data)
    fits = array.ndim == len(shape) and all(w in (None, g) for w, g in zip(shape, array.shape, strict=True))
    return fits and array.dtype == np.dtype(dtype)


@pytest.mark.parametrize("kind", list(FORMATS))
def test_reading_has_the_leaderboards_format(kind: str) -> None:
    scene = Scene(worlds.straight(60.0))
    history = [snapshot_of([replace(EGO, x=20.0 + t, y=1.75), Body(1000, 40.0, 1.75)], tick=t) for t in (0, 1)]
    keys = CAMERA if "camera" in kind else {}
    data = read(kind, history, scene, **keys)
    want = FORMATS[kind]
    pairs = [(data, want)] if isinstance(want, tuple) else [(data[key], want[key]) for key in want]
    assert all(has_format(*pair) for pair in pairs)
    if isinstance(want, dict):
        assert set(data) == set(want)


def test_every_sensor_of_carlas_has_a_format_here() -> None:
    assert {kind for kind in SENSORS if not kind.startswith("sensor.lavsim.")} == set(FORMATS)


def test_camera_channels_are_blue_green_red_alpha() -> None:
    red = plain(box(10.0, 0.0, 1.0, 30.0, 0.0, 30.0, tag=Tag.STATIC, colour=(200, 20, 20)))
    image = read("sensor.camera.rgb", snapshot_of(), red, **CAMERA, x=1.5)
    blue, green, red_channel, alpha = (int(v) for v in image[15, 20])
    assert red_channel > 2 * max(blue, green)
    assert alpha == 255
    right = plain(box(10.0, 4.0, 1.0, 4.0, 0.0, 30.0, tag=Tag.STATIC))
    tags = read("sensor.camera.semantic_segmentation", snapshot_of(), right, **CAMERA, x=1.5)[..., 2]
    assert (tags[10, :20] != Tag.STATIC).all()  # what stands to the right shows on the right
    assert (tags[10, 20:] == Tag.STATIC).any()


def test_lidar_has_right_positive_and_up_positive() -> None:
    scene = plain(box(0.0, 12.0, 30.0, 1.0, 0.0, 6.0))
    points = read("sensor.lidar.ray_cast", snapshot_of(tick=1), scene, z=2.4)
    wall = points[points[:, 2] > -2.3]
    np.testing.assert_allclose(wall[:, 1], 11.5, atol=1e-4)
    assert points[:, 2].min() == pytest.approx(-2.4, abs=1e-4)
    assert (points[:, 3] > 0.0).all()
    assert (points[:, 3] <= 1.0).all()


def test_radar_is_depth_altitude_azimuth_velocity() -> None:
    """A wall of a lorry 20 m ahead and to the right comes nearer with 6 m/s; the ego drives with 4 m/s."""
    lorry = Body(1000, 24.0, 3.0, speed=-6.0, size=(4.0, 30.0, 8.0), blueprint="static.prop.container", kind=7)
    snapshot = snapshot_of([replace(EGO, speed=4.0), lorry])
    found = read("sensor.other.radar", snapshot, plain(), x=2.0, yaw=0.0, fov=30)
    assert found.dtype == np.float32
    assert 60 <= len(found) <= 75  # int(1500 / 20) rays; some miss
    depth, altitude, azimuth, velocity = found.T.astype(float)
    far = depth * np.cos(altitude) * np.cos(azimuth)
    target = np.abs(far - 20.0) < 0.01
    assert target.mean() > 0.5
    np.testing.assert_allclose(velocity[target], -10.0 * (np.cos(altitude) * np.cos(azimuth))[target], atol=0.05)
    np.testing.assert_allclose(velocity[~target], -4.0 * (np.cos(altitude) * np.cos(azimuth))[~target], atol=0.05)
    assert np.abs(azimuth).max() <= np.radians(15.0) + 1e-6
    assert np.abs(altitude).max() <= np.radians(15.0) + 1e-6
    assert (altitude[depth * np.sin(altitude) < -0.99] < 0.0).all()  # the ground lies below


def test_radar_looks_to_the_side_it_is_turned_to_and_takes_the_keys_of_both_generations() -> None:
    right = plain(box(0.0, 12.0, 200.0, 1.0, 0.0, 60.0))
    found = read("sensor.other.radar", snapshot_of(), right, yaw=60.0, horizontal_fov=40, vertical_fov=2)
    depth, altitude, azimuth, _ = found.T.astype(float)
    assert np.abs(altitude).max() <= np.radians(1.0) + 1e-6
    wall = depth * np.sin(azimuth + np.radians(60.0)) * np.cos(altitude)
    assert (np.abs(wall - 11.5) < 0.01).mean() > 0.95
    assert azimuth.min() < -0.2 < 0.2 < azimuth.max()
    few = read("sensor.other.radar", snapshot_of(), right, yaw=90.0, attributes={"points_per_second": 200, "range": 5})
    assert len(few) < 10


def test_turning_ego_sees_still_walls_move_past_its_mount() -> None:
    snapshot = snapshot_of(ego_motion=(0.0, 0.0, 0.0, 0.0, 0.0, 0.5))
    ahead = plain(box(20.0, 0.0, 1.0, 80.0, 0.0, 60.0))
    found = read("sensor.other.radar", snapshot, ahead, x=0.0, y=2.0, fov=4)
    # Turning right about the origin, a mount on the right goes back: what lies ahead goes away.
    np.testing.assert_allclose(found[found[:, 0] > 15.0, 3], 1.0, atol=0.02)


def test_collisions_are_the_egos_own_with_the_others_class() -> None:
    contacts = np.array([(1, 1000, 900.0, 2400, 0), (1000, 1001, 5.0, 0, 0), (0, 1, 300.0, 0, 1060)], CONTACT_DTYPE)
    wall = plain(box(0.0, 1.5, 20.0, 0.5, 0.0, 2.0, tag=Tag.WALL))
    snapshot = replace(snapshot_of([EGO, Body(1000, 5.0), Body(1001, 9.0)]), contacts=contacts)
    events = read("sensor.other.collision", snapshot, wall)
    assert events["other_actor"].tolist() == [1000, 0]
    assert events["tag"].tolist() == [Tag.VEHICLE, Tag.WALL]
    np.testing.assert_allclose(events["normal_impulse"], [[-900.0, 0.0, 0.0], [0.0, -300.0, 0.0]], atol=0.1)
    assert len(read("sensor.other.collision", snapshot_of(), wall)) == 0


@pytest.mark.parametrize(("x", "y0", "y1", "kinds"), [
    (50.0, 1.4, 0.9, ["broken"]),  # over the line in the middle
    (50.0, 1.75, 1.75, []),  # along the lane
    (50.0, 1.4, 1.3, []),  # not yet there
])  # fmt: skip
def test_lane_invasion_tells_the_marks_that_were_crossed(x: float, y0: float, y1: float, kinds: list[str]) -> None:
    scene = Scene(worlds.straight(100.0))
    history = [snapshot_of([replace(EGO, x=x + t, y=y, size=(4.6, 2.2, 1.5))], tick=t) for t, y in enumerate((y0, y1))]
    events = read("sensor.other.lane_invasion", history, scene)
    assert events["kind"].tolist() == kinds
    assert len(read("sensor.other.lane_invasion", history[:1], scene)) == 0


def test_lane_invasion_spares_the_road_below() -> None:
    scene = Scene(worlds.straight(100.0))
    history = [snapshot_of([replace(EGO, x=50.0 + t, y=y, z=8.0)], tick=t) for t, y in enumerate((1.4, 0.9))]
    assert len(read("sensor.other.lane_invasion", history, scene)) == 0


def test_obstacle_is_the_first_thing_ahead_within_the_balls_way() -> None:
    wall = plain(box(12.0, 0.0, 1.0, 20.0, 0.0, 3.0, tag=Tag.WALL), box(4.0, 0.0, 1.0, 1.0, 2.5, 4.0))
    keys = {"x": 2.5, "attributes": {"distance": 20}}
    found = read("sensor.other.obstacle", snapshot_of(), wall, **keys)
    assert (int(found["other_actor"][0]), int(found["tag"][0])) == (0, Tag.WALL)
    assert found["distance"][0] == pytest.approx(11.5 - 2.5 - 0.5, abs=0.01)
    car = snapshot_of([EGO, Body(1000, 9.0, 1.3)])  # its side lies 0.35 m off the line: only the ball's edge meets it
    assert read("sensor.other.obstacle", car, wall, **keys)["other_actor"].tolist() == [1000]
    aside = snapshot_of([EGO, Body(1000, 9.0, 1.6)])
    assert read("sensor.other.obstacle", aside, wall, **keys)["other_actor"].tolist() == [0]
    alone = {"x": 2.5, "attributes": {"distance": 20, "only_dynamics": True}}
    assert len(read("sensor.other.obstacle", aside, wall, **alone)) == 0
    assert len(read("sensor.other.obstacle", snapshot_of(), wall, x=2.5)) == 0  # 5 m by default


def test_gnss_takes_carlas_attributes_and_its_newer_convention() -> None:
    quiet = {f"noise_{axis}_stddev": 0.0 for axis in ("lat", "lon", "alt")}
    snapshot, scene = snapshot_of([replace(EGO, x=100.0, y=-50.0)]), plain()
    old = read("sensor.other.gnss", snapshot, scene, attributes=quiet)
    np.testing.assert_allclose(old, [50.0 / 111_319.49, 100.0 / 111_319.49, 1.0], atol=1e-8)
    new = read("sensor.other.gnss", snapshot, scene, attributes=quiet | {"convention": "0.9.16", "noise_alt_bias": 3})
    np.testing.assert_allclose(new, [-50.0 / 111_274.963, 100.0 / 111_274.963, 4.0], atol=1e-9)


def test_speedometer_counts_the_climb() -> None:
    snapshot = snapshot_of([replace(EGO, pitch=0.1, speed=10.0)])
    uphill = replace(snapshot, velocity=np.array([[1000, 0, 100]], np.int32))
    expected = 10.0 * np.cos(0.1) + np.sin(0.1)
    assert read("sensor.speedometer", uphill, street())["speed"] == pytest.approx(expected, abs=1e-3)


def test_map_sensor_gives_the_towns_text() -> None:
    town = load_town("eu_small_a")
    text = read("sensor.opendrive_map", snapshot_of(), Scene(town))["opendrive"]
    assert text == town.xodr
    assert text.lstrip().startswith("<?xml")
