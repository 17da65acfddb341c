"""Ground that is not level: the search for where rays meet it, and the slopes and the bridge of a real town."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.map.prisms import Prisms
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.render.beams import GROUND_HIT
from lavsim.render.faces import DECK_FACE, UNDERSIDE
from lavsim.render.frame import Pose, rotation
from lavsim.render.ground import GroundRaster, Surface
from lavsim.render.heights import Heights, height_at, heights_at, heights_of, level_within, meet_ground
from lavsim.render.scene import Scene
from lavsim.render.solids import Material, slabs, solids_of
from lavsim.render.sweep import LidarModel, cast_sweep
from lavsim.render.terrain import terrain_of
from lavsim.render.zbuffer import NO_FACE, Pinhole, draw_visibility
from lavsim.types import LaneType, Tag
from tests.map.shared import MAPS, needs_maps
from tests.prisms import box
from tests.snapshots import EGO, Body, snapshot_of

NOTHING = solids_of(Prisms.empty())
ALL = LidarModel(general_drop=0.0, zero_drop=0.0)


def hills(seed: int, size: int = 90, steep: float = 1.0) -> Heights:
    """A plain with a rough patch in the middle, from (-20, -20)."""
    rng = np.random.default_rng(seed)
    nodes = np.zeros((size, size), np.float32)
    nodes[20:60, 30:70] = steep * rng.uniform(0.0, 1.5, (40, 40))
    return heights_of(nodes, -20.0, -20.0)


def meet(heights: Heights, origin: np.ndarray, direction: np.ndarray, limit: float) -> float:
    flat = np.hypot(*direction[:2])
    runs = np.empty(1)
    meet_ground(
        heights, origin, direction[None, :2] / flat, np.array([direction[2] / flat]), np.array([limit]), 0.0, runs
    )
    return float(runs[0])


@given(seed=st.integers(0, 5), yaw=st.floats(-3.2, 3.2), slope=st.floats(-1.0, 0.2), height=st.floats(1.6, 12.0))
@settings(max_examples=60, deadline=None)
def test_ray_meets_the_ground_where_small_steps_find_it(seed: int, yaw: float, slope: float, height: float) -> None:
    heights = hills(seed)
    origin = np.array([3.3, -7.7, height])
    steps = np.arange(0.0, 120.0, 0.002)
    places = origin[:2] + steps[:, None] * np.array([np.cos(yaw), np.sin(yaw)])
    below = origin[2] + slope * steps < heights_at(heights, places)
    expected = steps[np.argmax(below)] if below.any() else np.inf
    met = meet(heights, origin, np.array([np.cos(yaw), np.sin(yaw), slope]), 119.9)
    if np.isfinite(met) and np.isfinite(expected):
        assert met == pytest.approx(expected, abs=0.003) or met < expected  # a peak between two steps
    else:
        assert expected > 119.8 or met > 119.8
    if np.isfinite(met):
        at = origin[:2] + met * np.array([np.cos(yaw), np.sin(yaw)])
        assert height_at(heights, *at) == pytest.approx(origin[2] + slope * met, abs=1e-6)


def test_rays_along_the_grids_lines_and_beyond_its_border_end() -> None:
    heights = hills(1)
    for direction in ((1.0, 0.0, -0.2), (0.0, -1.0, -0.2), (-1.0, 1.0, -0.2), (1.0, 1.0, -0.2)):
        run = meet(heights, np.array([5.0, 5.0, 8.0]), np.array(direction), 500.0)
        assert 0.0 < run < 60.0
    assert meet(heights, np.array([-300.0, 0.0, 2.0]), np.array([-1.0, 0.0, -0.1]), 100.0) == pytest.approx(20.0)


def test_level_parts_are_known_as_such() -> None:
    heights = hills(2)
    assert level_within(heights, -15.0, -15.0, 4.0) == 0.0
    assert np.isnan(level_within(heights, 10.0, 5.0, 20.0))


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.4), (0.02, -0.05, 0.9)])
def test_lidar_and_camera_see_the_slope(angles: tuple[float, float, float]) -> None:
    heights = hills(3)
    pose = Pose(np.array([8.0, 6.0, 6.0]), rotation(*angles))
    sweep = cast_sweep(ALL, pose, 1, Draws.of_seed(0), NOTHING, NOTHING, heights=heights)
    points = pose.to_world(sweep.points[:, :3].astype(np.float64))
    np.testing.assert_allclose(points[:, 2], heights_at(heights, points[:, :2]), atol=1e-4)
    assert np.ptp(points[:, 2]) > 1.0

    lens = Pinhole(80, 60, 60.0)
    view = draw_visibility(lens, pose, NOTHING, NOTHING, heights=heights)
    agree = 0
    for row, column in np.ndindex(60, 80):
        ray = pose.axes @ np.array([1.0, (column + 0.5 - 40.0) / 60.0, -(row + 0.5 - 30.0) / 60.0])
        run = meet(heights, pose.origin, ray, 1000.0)
        depth = run / np.hypot(*ray[:2])
        agree += abs(view.inverse_depth[row, column] - 1.0 / depth) <= 0.01 / depth + 1e-9
    assert agree / 4800 > 0.998


def test_sloping_slab_is_met_from_above_below_and_the_side() -> None:
    corners = np.array([[5.0, -4.0, 3.0], [15.0, -4.0, 4.0], [15.0, 4.0, 4.0], [5.0, 4.0, 3.0]])
    slab = slabs(corners[None], 0.5, Tag.BRIDGE, (150, 150, 150))
    for origin, rise in (((10.0, 0.0, 8.0), 0.0), ((10.0, 0.0, 1.0), -0.5)):  # top, then underside
        for angles in ((0.0, 0.0, 0.0), (0.0, 0.03, 1.0)):
            pose = Pose(np.array(origin), rotation(*angles))
            sweep = cast_sweep(LidarModel(upper=60.0, lower=-60.0, general_drop=0.0, zero_drop=0.0), pose, 1,
                               Draws.of_seed(0), slab, NOTHING)  # fmt: skip
            points = pose.to_world(sweep.points[sweep.solids == 0, :3].astype(np.float64))
            assert len(points) > 500
            plane = 3.0 + 0.1 * (points[:, 0] - 5.0) + rise
            cap = np.abs(points[:, 2] - plane) < 1e-4
            side = (np.abs(np.abs(points[:, 1]) - 4.0) < 1e-4) | (np.abs(np.abs(points[:, 0] - 10.0) - 5.0) < 1e-4)
            assert (cap | side).all()
            assert cap.mean() > 0.9
    beside = Pose(np.array([0.0, 0.0, 3.0]), np.eye(3))
    view = draw_visibility(Pinhole(64, 48, 50.0), beside, slab, NOTHING)
    front = view.face[24] >= 0
    np.testing.assert_allclose(1.0 / view.inverse_depth[24][front], 5.0, rtol=1e-5)
    above = Pose(np.array([10.0, 0.0, 9.0]), rotation(0.0, -1.3, 0.0))
    assert (draw_visibility(Pinhole(64, 48, 50.0), above, slab, NOTHING).face == DECK_FACE).any()
    below = Pose(np.array([10.0, 0.0, 1.0]), rotation(0.0, 1.3, 0.0))
    view = draw_visibility(Pinhole(64, 48, 50.0), below, slab, NOTHING)
    assert UNDERSIDE in view.faces.side


def test_a_car_on_a_slope_leans_with_it() -> None:
    raster = GroundRaster.blank((-50.0, -50.0, 50.0, 50.0), Surface.ROAD)
    scene = Scene(None, raster, box(40.0, 0.0, 1.0, 1.0, 0.0, 1.0))
    level, leaning = (
        scene.actors(snapshot_of([EGO, Body(1000, 10.0, 0.0, yaw=np.pi / 2.0, pitch=pitch)])) for pitch in (0.0, 0.1)
    )
    body = np.flatnonzero((leaning.instance == 1000) & (leaning.material == Material.BODY))[0]
    np.testing.assert_allclose(leaning.tilt[body], [0.0, np.tan(0.1)], atol=2e-4)
    nose = np.array([10.0, 2.0]) - leaning.centre[body]
    assert leaning.z1[body] + leaning.tilt[body] @ nose == pytest.approx(level.z1[body] + 0.2, abs=0.001)


@cache
def town04() -> TownMap:
    return load_town("Town04", [MAPS])


@needs_maps
@pytest.mark.slow
def test_ground_of_town04_has_the_height_of_its_lanes() -> None:
    town, terrain = town04(), terrain_of(town04())
    lanes = town.lanes
    driving = np.repeat(lanes.type == LaneType.DRIVING, np.diff(lanes.first))
    points = lanes.points[driving]
    on_ground = ~np.isin(np.repeat(lanes.road_id, np.diff(lanes.first))[driving], [39])
    error = np.abs(heights_at(terrain.heights, points[:, :2]) - points[:, 2])[on_ground]
    assert np.mean(error <= 0.02) > 0.99  # the rest lies where lanes of a junction cross at two heights
    assert error.max() < 0.2
    assert terrain.decks is not None
    assert (terrain.decks.z0 > 9.0).all()
    deck = np.concatenate([lanes.points[lanes.rows(k)] for k in np.flatnonzero(lanes.road_id == 39)])
    over = deck[np.abs(deck[:, 0]) < 15.0]
    assert (heights_at(terrain.heights, over[:, :2]) < 8.5).all()  # under the deck's underside


@needs_maps
@pytest.mark.slow
def test_bridge_of_town04_is_seen_from_below_and_its_road_from_above() -> None:
    scene = Scene(town04())
    below = replace_ego(0.0, 22.0, 0.0)
    mount = Pose(np.array([0.0, 22.0, 2.4]), np.eye(3))
    view = draw_visibility(Pinhole(64, 64, 32.0), Pose(mount.origin, rotation(0.0, 1.2, 0.0)), scene.statics,
                           scene.actors(below), heights=scene.terrain.heights)  # fmt: skip
    ceiling = view.face >= 0
    assert ceiling.mean() > 0.9
    assert set(scene.statics.tag[view.faces.solid[view.face[ceiling]]]) == {Tag.BRIDGE}
    sweep = cast_sweep(LidarModel(upper=60.0, general_drop=0.0, zero_drop=0.0), mount, 1, Draws.of_seed(0),
                       scene.statics, scene.actors(below), heights=scene.terrain.heights)  # fmt: skip
    deck = len(scene.statics.corners) - len(scene.terrain.decks.corners)  # type: ignore[union-attr]
    up = sweep.points[sweep.solids >= deck, 2]
    assert np.median(up) == pytest.approx(11.0 - 1.0 - 2.4, abs=0.1)
    assert (sweep.points[sweep.solids == GROUND_HIT, 2] < 8.7).all()
    on = Pose(np.array([0.0, 22.0, 13.4]), rotation(0.0, -0.6, 0.0))
    view = draw_visibility(Pinhole(64, 64, 32.0), on, scene.statics, NOTHING, heights=scene.terrain.heights)
    assert (view.face[40:] == DECK_FACE).mean() > 0.95
    assert (view.face == NO_FACE).any()


def replace_ego(x: float, y: float, z: float):  # type: ignore[no-untyped-def]
    return snapshot_of([Body(EGO.id, x, y, z, role=EGO.role, size=EGO.size)])
