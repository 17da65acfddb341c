"""What stands beside the roads stays off them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from lavsim.geometry import forward
from lavsim.map.scenery import build_scenery
from lavsim.map.town_map import TownMap, load_town
from lavsim.types import LaneType, Tag
from tests import worlds


def footprints(town: TownMap, rows: np.ndarray) -> list[shapely.Polygon]:
    prisms = town.scenery.prisms
    return [shapely.Polygon(prisms.vertices[k, : prisms.count[k]]) for k in rows]


def lanes_of(town: TownMap, types: int) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(town.lane_polygon(int(k))).buffer(0) for k in town.lanes.where(types)])


@pytest.fixture(scope="module")
def town() -> TownMap:
    return load_town("eu_small_a")


def test_there_is_a_town_beside_the_roads(town: TownMap) -> None:
    prisms = town.scenery.prisms
    assert 500 <= len(prisms) <= 2000
    tags = set(prisms.tag.tolist())
    assert {Tag.BUILDING, Tag.POLE, Tag.TRAFFIC_LIGHT, Tag.VEGETATION} <= tags
    walls = (prisms.tag == Tag.BUILDING) & (prisms.z0 == 0.0)
    assert prisms.z1[walls].min() >= 4.0
    assert prisms.z1[walls].max() <= 15.0


def test_no_house_stands_on_a_lane_of_any_kind_or_in_another_house(town: TownMap) -> None:
    prisms = town.scenery.prisms
    houses = footprints(town, np.flatnonzero((prisms.tag == Tag.BUILDING) & (prisms.z0 == 0.0)))
    ground = lanes_of(town, -1)
    assert min(ground.distance(house) for house in houses) >= 0.99
    tree = shapely.STRtree(houses)
    first, second = tree.query(houses, predicate="intersects")
    assert (first == second).all()


def test_nothing_at_all_stands_on_a_driven_lane(town: TownMap) -> None:
    prisms = town.scenery.prisms
    low = np.flatnonzero(prisms.z0 < 2.5)
    driven = lanes_of(town, int(LaneType.DRIVING))
    assert not any(driven.intersects(shape) for shape in footprints(town, low))


def test_every_light_has_a_head_that_looks_at_its_approach(town: TownMap) -> None:
    prisms = town.scenery.prisms
    for light in town.lights:
        housing = np.flatnonzero((prisms.light == light.index) & (prisms.lamp < 0) & (prisms.tag == Tag.TRAFFIC_LIGHT))
        lamps = np.flatnonzero((prisms.light == light.index) & (prisms.lamp >= 0))
        assert len(housing) == 1
        assert sorted(prisms.lamp[lamps].tolist()) == [0, 1, 2]
        assert prisms.z0[housing[0]] == pytest.approx(2.6)
        assert prisms.z1[housing[0]] == pytest.approx(3.7)
        heights = prisms.z0[lamps[np.argsort(prisms.lamp[lamps])]]
        assert (np.diff(heights) < 0).all()  # red on top
        look = forward(light.yaw)
        face = (prisms.vertices[housing[0], :4] @ look).max()
        assert (prisms.vertices[lamps, :4] @ look).max() == pytest.approx(face + 0.05)
        assert (prisms.vertices[lamps, :4] @ look).min() == pytest.approx(face)


def test_the_same_map_gives_the_same_scenery() -> None:
    town = worlds.tee()
    first, second = build_scenery(town).prisms, build_scenery(town).prisms
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.colour.tobytes() == second.colour.tobytes()


def test_another_map_gives_other_scenery() -> None:
    first, second = worlds.tee(arm=80.0).scenery.prisms, worlds.tee(arm=90.0).scenery.prisms
    assert first.vertices.tobytes() != second.vertices.tobytes()


def test_a_road_without_sidewalks_still_gets_some() -> None:
    assert len(worlds.two_lanes().scenery.prisms) > 0
