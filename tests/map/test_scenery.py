"""What stands beside the roads stays off them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from lavsim.geometry import forward, right
from lavsim.map.furniture import FAR
from lavsim.map.roadside import lane_pieces
from lavsim.map.scenery import build_scenery
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.towns.draw import TOWNS
from lavsim.types import LaneType, Tag
from tests import worlds
from tests.map.shared import MAPS, needs_maps


def footprints(town: TownMap, rows: np.ndarray) -> list[shapely.Polygon]:
    prisms = town.scenery.prisms
    return [shapely.Polygon(prisms.vertices[k, : prisms.count[k]]) for k in rows]


def lanes_of(town: TownMap, types: int) -> shapely.STRtree:
    shapes, owner = lane_pieces(town)
    return shapely.STRtree(shapes[(town.lanes.type[owner] & types) != 0])


def standing(town: TownMap, tag: Tag, below: float = 2.5) -> list[shapely.Polygon]:
    """Footprints of what has a tag and comes down lower than `below` above its ground."""
    prisms = town.scenery.prisms
    floor = town.nearest(prisms.vertices[:, 0]).points[:, 2]
    return footprints(town, np.flatnonzero((prisms.tag == tag) & (prisms.z0 - floor < below)))


def assert_all_is_off_the_lanes(town: TownMap) -> None:
    ground = lanes_of(town, -1)
    houses = np.array(standing(town, Tag.BUILDING))
    assert not len(ground.query(houses, predicate="dwithin", distance=0.98)[0])
    first, second = shapely.STRtree(houses).query(houses, predicate="overlaps")
    assert not len(first), second
    for tag in (Tag.WALL, Tag.FENCE, Tag.VEGETATION, Tag.STATIC, Tag.GUARD_RAIL):
        shapes = np.array(standing(town, tag, 2.0))
        median = lanes_of(town, int(LaneType.MEDIAN))
        for k in np.unique(ground.query(shapes, predicate="intersects")[0]) if len(shapes) else ():
            assert len(median.query(shapes[k], predicate="intersects")), (tag, shapes[k].centroid)
    driven = lanes_of(town, int(LaneType.DRIVING))
    for tag in Tag:
        shapes = np.array(standing(town, tag))
        assert not len(shapes) or not len(driven.query(shapes, predicate="intersects")[0]), tag


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


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_nothing_stands_on_a_road_and_only_posts_on_a_sidewalk(name: str) -> None:
    assert_all_is_off_the_lanes(load_town(name))


@needs_maps
@pytest.mark.parametrize("name", ["Town01", "Town02", "Town04", "Town10HD"])
def test_nor_in_the_towns_of_carla(name: str) -> None:
    town = load_town(name, [MAPS])
    assert_all_is_off_the_lanes(town)
    tags = set(town.scenery.prisms.tag.tolist())
    assert {Tag.BUILDING, Tag.POLE, Tag.TRAFFIC_LIGHT, Tag.TRAFFIC_SIGN, Tag.VEGETATION} <= tags
    assert (Tag.GUARD_RAIL in tags) == (name == "Town04")


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_a_town_has_what_belongs_there(name: str) -> None:
    town = load_town(name)
    tags = set(town.scenery.prisms.tag.tolist())
    assert {Tag.BUILDING, Tag.POLE, Tag.TRAFFIC_LIGHT, Tag.TRAFFIC_SIGN, Tag.VEGETATION, Tag.WALL} <= tags
    assert {Tag.FENCE, Tag.STATIC} <= tags
    assert (Tag.GUARD_RAIL in tags) == (name == "us_highway")
    assert len(town.scenery.prisms) < 7000


@pytest.mark.parametrize("name", ["us_large_a", "us_center"])
def test_american_heads_hang_over_their_lanes_beyond_the_crossing(name: str) -> None:
    town = load_town(name)
    prisms = town.scenery.prisms
    for light in town.lights:
        heads = np.flatnonzero((prisms.light == light.index) & (prisms.lamp < 0) & (prisms.tag == Tag.TRAFFIC_LIGHT))
        assert 1 <= len(heads) <= max(1, len(light.approach))
        assert prisms.z0[heads].min() >= 4.8
        assert prisms.z1[heads].max() <= 6.0
        for k in heads:
            middle = prisms.vertices[k, :4].mean(axis=0)
            ahead = [float((middle - (s.x, s.y)) @ forward(s.yaw)) for s in light.stop_lines]
            aside = [abs(float((middle - (s.x, s.y)) @ right(s.yaw))) for s in light.stop_lines]
            assert min(ahead) > FAR
            assert min(aside) < 1.5


def test_parking_places_lie_in_parking_lanes() -> None:
    town = load_town("us_large_a")
    places = town.scenery.parking
    assert len(places) > 200
    hits = town.nearest(places[:, :2], LaneType.PARKING)
    assert hits.distance.max() < 0.05
    assert hits.width.min() >= 1.9
    assert np.abs(np.sin(hits.yaw - places[:, 3])).max() < 0.05
    same = hits.lane[:, None] == hits.lane[None]
    apart = np.hypot(*(places[:, None, :2] - places[None, :, :2]).transpose(2, 0, 1))
    assert apart[same & ~np.eye(len(places), dtype=bool)].min() > 6.0
    assert load_town("us_rural").scenery.parking.shape == (0, 4)


def test_a_stop_sign_is_red_and_looks_at_who_has_to_stop() -> None:
    town = load_town("us_large_a")
    prisms = town.scenery.prisms
    red = np.flatnonzero((prisms.tag == Tag.TRAFFIC_SIGN) & (prisms.colour[:, 0] > 150) & (prisms.colour[:, 1] < 60))
    middle = prisms.vertices[red, :4].mean(axis=1)
    for sign in town.signs:
        if sign.kind == "stop":
            near = np.hypot(*(middle - (sign.x, sign.y)).T)
            plates = red[near < 1.0]
            assert len(plates) == 3
            approach = sign.stop_lines[0]
            assert float(forward(sign.yaw) @ forward(approach.yaw)) == pytest.approx(-1.0, abs=1e-6)
            face = middle[near < 1.0].mean(axis=0) - (sign.x, sign.y)
            assert float(face @ forward(sign.yaw)) > 0.0


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
