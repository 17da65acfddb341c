"""Lamps: which shine, how far, and whether they are in sight."""

from __future__ import annotations

import numpy as np

from lavsim.map.prisms import Prisms
from lavsim.map.town_files import load_town
from lavsim.render.lamps import lamp_light, light_at, street_lamps, with_headlights
from lavsim.render.sheet import CAMERAS
from lavsim.render.solids import solids_of
from lavsim.types import LightState, Tag, VehicleLight
from lavsim.world.weather import Weather
from tests.prisms import box
from tests.scenes import plain, signal
from tests.snapshots import EGO, Body, snapshot_of

NIGHT = Weather(sun_altitude_angle=-60.0)
FRONT = CAMERAS[1][1]


def at(grid: object, x: float, y: float) -> float:
    return float(light_at(grid.light, np.float32(x - grid.x), np.float32(y - grid.y)))  # type: ignore[attr-defined]


def test_street_lamps_of_a_town_are_its_lamp_posts_and_no_masts_of_lights() -> None:
    lamps = street_lamps(solids_of(load_town("us_center").scenery.prisms))
    assert len(lamps) > 100
    assert set(np.round(lamps[:, 2], 2)) == {6.0}


def test_light_falls_off_around_a_lamp() -> None:
    lamps = street_lamps(solids_of(box(10.0, 5.0, 0.16, 0.16, 0.0, 6.0, tag=Tag.POLE)))
    grid = lamp_light(lamps, -80.0, -80.0)
    light = [at(grid, 10.0 + d, 5.0) for d in (0.0, 3.0, 6.0, 10.0, 20.0)]
    assert light == sorted(light, reverse=True)
    assert light[0] > 0.9
    assert light[-1] == 0.0


def test_headlights_reach_ahead_only_and_only_when_on() -> None:
    scene = plain()
    dark = lamp_light(np.zeros((0, 3)), -80.0, -80.0)
    for bits, shines in ((0, False), (int(VehicleLight.LOW_BEAM), True)):
        car = Body(1000, 0.0, 0.0, yaw=np.pi / 2, lights=bits)
        grid = with_headlights(dark, scene.actors(snapshot_of([EGO, car])))
        assert (at(grid, 0.0, 10.0) > 0.2) == shines
        assert at(grid, 0.0, -6.0) == 0.0
        assert at(grid, 12.0, 5.0) == 0.0


def test_a_lit_lamp_glows_unless_something_stands_before_it() -> None:
    lamp, screen = signal(21.5, 0.0), box(15.0, 0.0, 0.3, 3.0, 2.0, 6.0, colour=(90, 90, 90))
    halo: dict[str, int] = {}
    for name, parts in (("free", [lamp]), ("hidden", [lamp, screen])):
        red, off = (FRONT.colour(snapshot_of(lights=[state], weather=NIGHT), plain(*parts))[..., :3].astype(int)
                    for state in (LightState.RED, LightState.OFF))  # fmt: skip
        halo[name] = int((np.abs(red - off).max(axis=2) > 3).sum())
    assert halo["free"] > 30  # the lamp itself has about nine pixels
    assert halo["hidden"] == 0


def test_nothing_shines_in_a_world_without_lamps() -> None:
    assert len(street_lamps(solids_of(Prisms.empty()))) == 0
