"""Kerb stones: along the road, never on it, open at crosswalks, and found by a LiDAR."""

from __future__ import annotations

import numpy as np
import shapely

from lavsim.map.lane import DRIVABLE
from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.render.kerbs import HEIGHT, WIDTH, kerb_quads
from lavsim.render.scene import Scene
from lavsim.sensors.base import make_sensor
from lavsim.sensors.lidar import Lidar
from lavsim.types import LaneType, Tag
from tests import worlds
from tests.snapshots import EGO, Body, snapshot_of

TOWN = load_town("eu_small_a")


def test_a_straight_street_has_its_stones_on_both_sides() -> None:
    quads = kerb_quads(worlds.straight(60.0))
    lanes = worlds.straight(60.0).lanes
    if not (lanes.type == LaneType.SIDEWALK).any():
        assert len(quads) == 0
        return
    length = np.hypot(*(quads[:, 1, :2] - quads[:, 0, :2]).T)
    assert length.sum() > 100.0


def test_stones_lie_on_the_sidewalk_and_off_the_road_and_the_crosswalks() -> None:
    quads = kerb_quads(TOWN)
    assert len(quads) > 300
    np.testing.assert_allclose(quads[..., 2], HEIGHT)
    middle = quads[..., :2].mean(axis=1)
    driven = TOWN.nearest(middle, DRIVABLE)
    assert (driven.distance > driven.width / 2.0).mean() > 0.99
    walked = TOWN.nearest(middle, LaneType.SIDEWALK)
    assert (np.abs(walked.distance - walked.width / 2.0) < WIDTH + 0.1).mean() > 0.98
    crossed = shapely.union_all([shapely.Polygon(polygon) for polygon in TOWN.crosswalks])
    ends = quads[..., :2].reshape(-1, 2)
    assert shapely.contains_xy(crossed, ends[:, 0], ends[:, 1]).mean() < 0.01


def test_no_long_stretch_of_sidewalk_is_without_stones() -> None:
    quads = kerb_quads(TOWN)
    length = np.hypot(*(quads[:, 1, :2] - quads[:, 0, :2]).T).sum()
    sidewalks = TOWN.lanes.length[TOWN.lanes.type == LaneType.SIDEWALK].sum()
    assert length > 0.85 * sidewalks


def test_a_lidar_finds_the_stones() -> None:
    scene = Scene(TOWN)
    lane = int(np.argmax(np.where(TOWN.lanes.type == LaneType.DRIVING, TOWN.lanes.length, 0.0)))
    x, y, z, yaw, _ = TOWN.centre([lane], [TOWN.lanes.length[lane] / 2.0])[0]
    lidar = make_sensor({"type": "sensor.lidar.ray_cast_semantic", "id": "top", "z": 2.4})
    assert isinstance(lidar, Lidar)
    ego = Body(EGO.id, x, y, z, yaw, role=EGO.role, size=EGO.size)
    for tick in (0, 1):
        found = lidar.read([snapshot_of([ego], tick=tick)], scene, Draws.of_seed(0))
        stone = (found["ObjTag"] == Tag.SIDEWALK) & (found["z"] > -2.4 + 0.01)
        assert stone.sum() > 30
        assert found["z"][stone].max() <= -2.4 + HEIGHT + 1e-3
