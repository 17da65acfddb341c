"""What the look and the pictures must show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from lavsim.random import Draws
from lavsim.render.birdseye import draw_snapshot
from lavsim.render.camera_view import CameraView
from lavsim.render.canvas import Canvas, write_png
from lavsim.render.frame import Mount, rotation
from lavsim.render.ground import GroundRaster, Surface
from lavsim.render.shapes import Look, parts_of
from lavsim.render.sheet import CAMERAS, LIDAR_MOUNT, draw_sheet
from lavsim.sensors.base import make_sensor
from lavsim.sensors.camera import ColourCamera
from lavsim.sensors.suites import LAV
from lavsim.types import ActorClass, LightState, Tag, VehicleLight
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.weather import Weather
from tests.prisms import box
from tests.scenes import plain, signal, street
from tests.snapshots import EGO, Body, snapshot_of

FRONT = CAMERAS[1][1]
TELEPHOTO = CAMERAS[3][1]


def reddest(image: np.ndarray) -> float:
    """Largest lead of red over green."""
    return float((image[..., 2].astype(int) - image[..., 1]).max())


@pytest.mark.parametrize("weather", [Weather(), Weather(sun_altitude_angle=-80.0), Weather(fog_density=60.0)])
def test_red_light_is_told_from_green_at_50_metres(weather: Weather) -> None:
    scene = plain(signal(51.5, 3.0))
    looks = {
        state: TELEPHOTO.colour(snapshot_of(lights=[state], weather=weather), scene)
        for state in (LightState.RED, LightState.GREEN)
    }
    lead = looks[LightState.RED].astype(int) - looks[LightState.GREEN]
    lamps = np.abs(lead).max(axis=2) > 60
    assert lamps.sum() >= 12  # two lamps of 0.28 m: 3 to 4 px each way
    assert reddest(looks[LightState.RED]) > 120.0
    assert reddest(looks[LightState.GREEN]) < 60.0


def test_brake_lights_shine() -> None:
    scene = plain()
    car = Body(1000, 12.0, 0.0, colour=(90, 90, 90))
    off, on = (
        FRONT.colour(snapshot_of([EGO, replace(car, lights=bits)]), scene) for bits in (0, int(VehicleLight.BRAKE))
    )
    assert reddest(on) > reddest(off) + 60.0


def test_night_is_darker_than_day_and_fog_hides_what_is_far() -> None:
    scene, far = street(), box(90.0, 0.0, 1.0, 4.0, 0.0, 4.0, colour=(200, 30, 30))
    day, night = (FRONT.colour(snapshot_of(weather=Weather(sun_altitude_angle=a)), scene) for a in (60.0, -60.0))
    assert night[..., :3].mean() < 0.4 * day[..., :3].mean()
    clear, fog = (TELEPHOTO.colour(snapshot_of(weather=Weather(fog_density=d)), plain(far)) for d in (0.0, 90.0))
    assert reddest(fog) < 0.3 * reddest(clear)


def test_images_of_one_pass_agree() -> None:
    bodies = [EGO, Body(1000, 15.0, 0.0), Body(100000, 12.0, 3.0, kind=ActorClass.WALKER, size=(0.4, 0.4, 1.8))]
    images = FRONT.render(snapshot_of(bodies), street(), Draws.of_seed(0))
    assert images.colour.shape == (288, 256, 4)
    assert (images.colour[..., 3] == 255).all()
    assert set(np.unique(images.instance)) == {0, 1000, 100000}
    assert (images.tags[images.instance == 1000] == Tag.VEHICLE).all()
    assert (images.tags[images.instance == 100000] == Tag.PEDESTRIAN).all()
    assert ((images.depth == 1000.0) == (images.tags == Tag.SKY)).all()
    assert images.depth[images.instance == 1000].min() == pytest.approx(15.0 - 2.25 - 1.5, abs=0.1)


def test_own_body_is_outside_the_lav_cameras_and_inside_one_behind_the_roof() -> None:
    snapshot = snapshot_of()
    for _, view in CAMERAS:
        assert (view.labels(snapshot, street())[1] != EGO.id).all()
    behind = CameraView(256, 128, float(np.radians(110.0)), Mount(-1.5, 0.0, 2.0))
    assert (behind.labels(snapshot, street())[1] == EGO.id).any()


def test_road_line_lies_in_the_middle_of_the_front_image() -> None:
    tags, _ = FRONT.labels(snapshot_of(), street())
    below = np.nonzero(tags[250] == Tag.ROAD_LINE)[0]
    assert 118 <= below.min() <= below.max() <= 137
    assert tags[250, 60] == Tag.ROAD
    assert (tags[100:140] == Tag.BUILDING).any()


@pytest.mark.parametrize("name", sorted(BLUEPRINTS))
def test_shapes_fill_their_box_and_stay_inside(name: str) -> None:
    blueprint = BLUEPRINTS[name]
    every = parts_of(blueprint.actor_class, Look(*blueprint.size, (100, 100, 100), name, 7))
    parts = [part for part in every if part.is_there(doors=0)]
    length, width, height = blueprint.size
    for part in parts:
        assert abs(part.x) + part.length / 2.0 <= length / 2.0 + 1e-6
        assert abs(part.y) + part.width / 2.0 <= width / 2.0 + 1e-6
        assert 0.0 <= part.z0 < part.z1 <= height + 1e-6
    assert max(p.x + p.length / 2.0 for p in parts) >= 0.32 * length
    assert max(p.z1 for p in parts) == pytest.approx(height)
    assert min(p.z0 for p in parts) == 0.0


def test_rotation_is_carlas() -> None:
    axes = rotation(0.0, np.radians(10.0), np.radians(30.0))
    np.testing.assert_allclose(axes[:, 0], [0.853, 0.492, 0.174], atol=1e-3)
    np.testing.assert_allclose(axes[:, 1], [-0.5, 0.866, 0.0], atol=1e-3)
    np.testing.assert_allclose(axes[:, 2], [-0.150, -0.087, 0.985], atol=1e-3)


def test_ground_raster_knows_what_lies_where() -> None:
    raster: GroundRaster = street().ground
    points = np.array([[10.0, 0.05], [10.0, 2.0], [10.0, -5.0], [10.0, 12.0], [999.0, 0.0]])
    assert list(raster.at(points)) == [
        Surface.WHITE_SOLID, Surface.ROAD, Surface.SIDEWALK, Surface.TERRAIN, Surface.TERRAIN
    ]  # fmt: skip


def test_canvas_puts_the_heading_up_and_right_to_the_right() -> None:
    canvas = Canvas.facing(5.0, 7.0, 0.5, (100, 80), 2.0, ahead=0.75)
    ahead, right = np.array([np.cos(0.5), np.sin(0.5)]), np.array([-np.sin(0.5), np.cos(0.5)])
    points = np.array([[5.0, 7.0], [5.0, 7.0] + 10.0 * ahead, [5.0, 7.0] + 10.0 * right])
    np.testing.assert_allclose(canvas.pixels(points), [[50, 60], [50, 40], [70, 60]], atol=1e-9)


def test_picture_from_above_shows_the_other_car_where_it_is() -> None:
    bodies = [replace(EGO, yaw=0.3, x=2.0), Body(1000, 12.0, 1.0, colour=(0, 255, 0))]
    snapshot = snapshot_of(bodies)
    canvas = draw_snapshot(street(), snapshot, (400, 400), 50.0)
    column, row = np.floor(canvas.pixels(snapshot.xy)[1]).astype(int)
    assert tuple(canvas.image[row, column]) == (0, 255, 0)
    column, row = np.floor(canvas.pixels(np.array([[16.0, 16.0]]))[0]).astype(int)
    blue, green, red = (int(v) for v in canvas.image[row, column])
    assert (red, green, blue) == (150, 140, 130)  # the house


def test_contact_sheet_is_a_picture_and_the_same_each_time(tmp_path: Path) -> None:
    history = [snapshot_of([EGO, Body(1000, 14.0)], tick=t, lights=[0]) for t in (0, 1)]
    sheet = draw_sheet(street(), history)
    write_png(sheet, tmp_path / "sheet.png")
    assert (cv2.imread(str(tmp_path / "sheet.png")) == sheet).all()
    assert (draw_sheet(street(), history) == sheet).all()
    assert sheet.std() > 30.0


def test_sheet_has_the_cameras_and_the_lidar_of_the_lav_suite() -> None:
    sensors = [make_sensor(values) for values in LAV]
    assert [s.view for s in sensors if isinstance(s, ColourCamera)] == [view for _, view in CAMERAS]
    assert next(s.config.mount for s in sensors if "lidar" in s.config.type) == LIDAR_MOUNT
