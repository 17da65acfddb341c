"""What the look `full` adds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lavsim.random import Draws
from lavsim.render.camera_view import CameraView
from lavsim.render.frame import Mount
from lavsim.render.look import look_of
from lavsim.render.shadow import corner_of, static_shadows, sun_share
from lavsim.render.sheet import CAMERAS
from lavsim.types import Tag, VehicleLight
from lavsim.world.weather import Weather
from tests.prisms import box, cast_ray
from tests.scenes import plain, street
from tests.snapshots import EGO, Body, snapshot_of

FRONT = CAMERAS[1][1]
ABOVE = CameraView(120, 120, float(np.radians(60.0)), Mount(10.0, 0.0, 30.0, pitch=-np.pi / 2.0))
AFTERNOON = Weather(cloudiness=0.0, sun_altitude_angle=40.0, sun_azimuth_angle=90.0)


def full(scene: object, weather: Weather, bodies: list[Body] | None = None, view: CameraView = FRONT) -> np.ndarray:
    image = view.colour(snapshot_of(bodies or [EGO], weather=weather), scene, None, "full")  # type: ignore[arg-type]
    return image[..., :3].astype(int)


def test_shadows_are_those_of_plain_rays_towards_the_sun() -> None:
    """Points on the ground and above it, against rays cast through the same boxes one by one."""
    rng = np.random.default_rng(2)
    boxes = [box(*rng.uniform(-30, 30, 2), *rng.uniform(2, 6, 2), 0.0, rng.uniform(1, 9), rng.uniform(0, 3))
             for _ in range(12)]  # fmt: skip
    boxes.append(box(0.0, 0.0, 3.0, 3.0, 4.0, 6.0))  # a roof with air below it
    scene, look = plain(*boxes), look_of(replace(AFTERNOON, sun_azimuth_angle=130.0))
    grid = static_shadows(scene.statics, look, *corner_of(0.0, 0.0))
    everything, agreed, dark = type(boxes[0]).concatenate(boxes), [], 0
    sun = look.sun.astype(np.float64)
    for x, y in rng.uniform(-35.0, 35.0, (400, 2)):
        for z in (0.0, 2.0):
            origin = np.array([x, y, z + 1e-3])
            _, below = cast_ray(np.array([x, y, 50.0]), np.array([1e-9, 0.0, -1.0]), everything)
            _, solid = cast_ray(origin, sun, everything)
            share = sun_share(grid.height, np.float32(grid.x), np.float32(grid.y), np.float32(grid.slope_x),
                              np.float32(grid.slope_y), np.float32(x), np.float32(y), np.float32(z))  # fmt: skip
            if share in (0.0, 1.0) and below < 0:  # not within a box
                agreed.append((share == 0.0) == (solid >= 0))
                dark += share == 0.0
    assert dark > 30
    assert np.mean(agreed) > 0.97  # what remains lies within a cell of an edge


def test_a_house_darkens_the_road_on_its_far_side_from_the_sun() -> None:
    house = box(10.0, 6.0, 8.0, 4.0, 0.0, 6.0)  # to the right; the sun stands to the right
    lit, shadowed = (full(plain(*parts), AFTERNOON, view=ABOVE) for parts in ((), (house,)))
    change = shadowed.sum(axis=2) / np.maximum(lit.sum(axis=2), 1)
    assert change[60, 58] < 0.75  # right beside it
    assert change[60, 10] == pytest.approx(1.0, abs=0.02)  # farther than it is high


def test_clouds_leave_no_shadow() -> None:
    house = box(10.0, 6.0, 8.0, 4.0, 0.0, 6.0)
    dull = Weather(cloudiness=100.0, precipitation=5.0)
    lit, beside = (full(plain(*parts), replace(dull, precipitation=0.0), view=ABOVE) for parts in ((), (house,)))
    assert abs(lit[60, 58] - beside[60, 58]).max() <= 2


def test_puddles_mirror_what_stands_behind_them() -> None:
    wet = replace(AFTERNOON, precipitation_deposits=90.0)
    wall = box(40.0, 0.0, 1.0, 60.0, 0.0, 12.0, colour=(230, 20, 20))
    dry, mirrored = full(plain(wall), AFTERNOON), full(plain(wall), wet)
    tags, _ = FRONT.labels(snapshot_of(), plain(wall))
    road = (tags == Tag.ROAD) & (np.arange(288)[:, None] < 200)
    assert (mirrored[road][:, 2] - mirrored[road][:, 1]).max() > 40
    assert (dry[road][:, 2] - dry[road][:, 1]).max() < 15


def test_rain_draws_streaks_that_move_and_belong_to_the_tick() -> None:
    rain = Weather(precipitation=80.0)
    one, again, later = (
        FRONT.colour(snapshot_of(tick=tick, weather=rain), street(), Draws.of_seed(1), "full") for tick in (4, 4, 5)
    )
    assert (one == again).all()
    assert (np.abs(one.astype(int) - later).max(axis=2) > 12).mean() > 0.005


def test_headlights_light_the_road_before_every_car_at_night() -> None:
    night = Weather(sun_altitude_angle=-60.0)
    car = Body(1000, 8.0, 0.0, yaw=0.0, colour=(90, 90, 90))
    off, on = (full(plain(), night, [EGO, replace(car, lights=int(bits))], ABOVE)
               for bits in (0, VehicleLight.LOW_BEAM))  # fmt: skip
    brighter = (on - off).sum(axis=2)
    assert brighter[20:40, 55:65].mean() > 20  # ahead of it is up
    assert brighter[80:100, 55:65].mean() < 3


def test_texture_stands_still_when_the_ego_moves() -> None:
    """The same places seen from a metre farther on have the same grain."""
    scene = plain()
    images = [full(scene, Weather(), [replace(EGO, x=x)], replace(ABOVE, mount=replace(ABOVE.mount, x=30.0 - x)))
              for x in (0.0, 1.0)]  # fmt: skip
    assert (np.abs(images[0] - images[1]) > 2).mean() < 0.01
