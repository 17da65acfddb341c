"""The walkable network of towns: sidewalks, corners, crosswalks."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from lavsim.map.footways import FootwayKind, Footways, get_footways
from lavsim.map.lane import DRIVABLE
from lavsim.map.town_files import load_town, town_names
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType
from tests import worlds
from tests.map.shared import MAPS, needs_maps

REAL = ("Town01", "Town02", "Town04", "Town06", "Town07", "Town10HD")


def ways_across(footways: Footways) -> list[int]:
    return [e for e in range(len(footways)) if footways.kind[e] != FootwayKind.SIDEWALK]


def check(town: TownMap, footways: Footways) -> None:
    """What holds in every town."""
    ground = town.drivable_area(DRIVABLE)
    shapely.prepare(ground)
    for edge in range(len(footways)):
        line = footways.line(edge)
        a, b = footways.ends[edge]
        assert np.allclose(line[[0, -1], :3], footways.nodes[[a, b]])
        assert np.allclose(np.hypot(*np.diff(line[:, :2], axis=0).T).sum(), footways.length[edge])
        assert (line[:, 4] > 0.3).all()
        if footways.kind[edge] == FootwayKind.SIDEWALK:
            continue
        low, high = footways.kerb[edge]
        assert 0.0 < low < high < footways.length[edge]
        along = np.arange(len(line)) * footways.step[edge]
        for kerb in (low, high):
            place = shapely.Point(np.interp(kerb, along, line[:, 0]), np.interp(kerb, along, line[:, 1]))
            assert not ground.contains(place), "who waits stands off the driven lanes"
        rows = slice(footways.crossed_first[edge], footways.crossed_first[edge + 1])
        assert (footways.crossed_way[rows, 0] >= low - 1e-6).all()
        assert (footways.crossed_way[rows, 1] <= high + 1e-6).all()
        lanes = footways.crossed_lane[rows]
        assert (town.lanes.type[lanes] & DRIVABLE > 0).all()
        assert (footways.crossed_u[rows, 1] <= town.lanes.length[lanes] + 1e-6).all()


def test_a_road_without_sidewalks_has_no_footways() -> None:
    footways = get_footways(worlds.arc())
    assert (len(footways), len(footways.nodes), footways.reachable) == (0, 0, 1.0)


def test_a_crossing_has_four_corners_and_four_crosswalks() -> None:
    town = worlds.crossing()
    footways = get_footways(town)
    check(town, footways)
    crosswalks = footways.where(FootwayKind.CROSSING)
    assert len(crosswalks) == 4
    assert footways.reachable == 1.0
    for edge in crosswalks:
        rows = slice(footways.crossed_first[edge], footways.crossed_first[edge + 1])
        lanes, lights = footways.crossed_lane[rows], footways.crossed_light[rows]
        assert len(lanes) == 2, "one towards the junction, one away from it"
        towards = [k for k in range(2) if any(town.lanes.junction[n] >= 0 for n in town.lanes.successors(lanes[k]))]
        assert len(towards) == 1
        assert lanes[towards[0]] in town.lights[lights[towards[0]]].approach
        assert lights[1 - towards[0]] == -1
        assert footways.lights(int(edge)) == [int(lights[towards[0]])]


def test_crosswalks_without_lights_name_none() -> None:
    footways = get_footways(worlds.crossing(lights=False))
    crosswalks = footways.where(FootwayKind.CROSSING)
    assert len(crosswalks) == 4
    assert all(not footways.lights(int(edge)) for edge in crosswalks)


def test_the_two_sides_of_a_straight_road_meet_only_where_one_jaywalks() -> None:
    footways = get_footways(worlds.straight(200.0))
    assert len(footways.where(FootwayKind.CROSSING)) == 0
    assert footways.reachable == pytest.approx(0.5)
    jaywalks = footways.where(FootwayKind.JAYWALK)
    assert len(jaywalks) > 3
    for edge in jaywalks:
        (xa, ya), (xb, yb) = footways.nodes[footways.ends[edge], :2]
        assert abs(xa - xb) < 0.5, "straight across"
        assert ya * yb < 0.0


@pytest.mark.parametrize("name", town_names())
def test_bundled_towns_can_be_walked_through(name: str) -> None:
    town = load_town(name)
    footways = get_footways(town)
    check(town, footways)
    drawn = float(town.lanes.length[town.lanes.where(LaneType.SIDEWALK)].sum())
    walked = float(footways.length[footways.where(FootwayKind.SIDEWALK)].sum())
    assert walked > 0.9 * drawn
    if name == "us_rural":  # three villages with nothing to walk on between them
        assert footways.reachable > 0.3
    else:
        assert footways.reachable > 0.99
        assert len(footways.where(FootwayKind.CROSSING)) > 0.9 * len(town.crosswalks)


@needs_maps
@pytest.mark.parametrize("name", REAL)
def test_carlas_towns_can_be_walked_through(name: str) -> None:
    if not (MAPS / f"{name}.xodr").exists():
        pytest.skip(f"needs {name}.xodr in maps/carla of LAVSIM_SHARED or ../shared")
    town = load_town(name, [MAPS])
    footways = get_footways(town)
    check(town, footways)
    if town.crosswalks and len(footways):
        assert len(footways.where(FootwayKind.CROSSING)) > 0.7 * len(town.crosswalks)


def test_footways_are_made_once() -> None:
    town = load_town("eu_small_a")
    assert get_footways(town) is get_footways(town)
