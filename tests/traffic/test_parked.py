"""Parked cars stand in their bays, off the road, and apart from each other."""

from functools import cache

import numpy as np
import pytest
import shapely

from lavsim.geometry import box_corners
from lavsim.map.town_files import build_town, load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.traffic.parked import BAY_LENGTH, park_cars, parking_bays
from lavsim.types import ActorIds, LaneType, Role
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.motion import RESTING
from lavsim.world.world import World

TOWN = "us_large_a"
EGO = BLUEPRINTS["vehicle.lincoln.mkz_2017"]


def empty_world(x: float = -500.0, y: float = -500.0) -> World:
    world = World()
    world.spawn(1, EGO, np.array([x, y, 0.0]), 0.0, Role.EGO)
    return world


@cache
def parked(town: str = TOWN, share: float = 1.0, seed: int = 0) -> tuple[World, tuple[int, ...]]:
    world = empty_world()
    return world, tuple(park_cars(load_town(town), world, Draws.of_seed(seed), share).tolist())


def outlines(world: World, rows: tuple[int, ...]) -> np.ndarray:
    pose, sizes = world.pose[list(rows)], world.table.sizes[list(rows)]
    return box_corners(pose[:, 0], pose[:, 1], pose[:, 2], sizes[:, 0], sizes[:, 1])


@pytest.mark.parametrize("name", ["us_large_a", "eu_small_b", "us_center"])
def test_cars_keep_off_driving_lanes_crosswalks_and_each_other(name: str) -> None:
    town = load_town(name)
    world, rows = parked(name)
    assert len(rows) > 20
    corners = outlines(world, rows)
    shapes = np.array([shapely.Polygon(c) for c in corners])
    lanes = np.flatnonzero(town.lanes.type == LaneType.DRIVING)
    road = shapely.union_all([shapely.Polygon(town.lane_polygon(int(lane))).buffer(0) for lane in lanes])
    # Whoever stands on the road by no more than 5 cm is clear of it once it is drawn 5 cm narrower.
    assert not shapely.intersects(shapes, road.buffer(-0.05)).any()
    for polygon in town.crosswalks:
        assert not shapely.intersects(shapes, shapely.Polygon(polygon)).any()
    tree = shapely.STRtree(shapes)
    assert all(len(tree.query(shape, predicate="intersects")) == 1 for shape in shapes)


def test_cars_stand_along_their_lane_inside_its_width() -> None:
    town = load_town(TOWN)
    world, rows = parked()
    corners = outlines(world, rows).reshape(-1, 2)
    hits = town.nearest(corners, LaneType.PARKING)
    assert np.all(np.abs(hits.offset) <= hits.width / 2.0 + 0.01)
    middle = town.nearest(world.pose[list(rows), :2], LaneType.PARKING)
    turned = np.mod(world.pose[list(rows), 2] - middle.yaw + np.pi, 2.0 * np.pi) - np.pi
    assert np.abs(turned).max() < 0.02


def test_they_are_parked_actors_at_rest_with_ids_of_their_own() -> None:
    world, rows = parked()
    assert set(world.table.roles[list(rows)].tolist()) == {Role.PARKED}
    assert np.all(world.motion[list(rows)] == RESTING)
    ids = world.table.ids[list(rows)]
    assert len(set(ids.tolist())) == len(ids)
    assert ids.min() >= ActorIds.PARKED
    assert ids.max() < ActorIds.SCENARIOS
    assert len({world.table.blueprints[row] for row in rows}) > 5
    before = world.pose[: world.count].copy()
    for _ in range(5):
        world.step()
    assert np.array_equal(world.pose[: world.count], before)
    assert not len(world._contacts.rows)


def test_more_cars_leave_those_of_a_smaller_share_where_they_were() -> None:
    few, some = parked(share=0.3), parked(share=0.6)
    bays = len(parking_bays(load_town(TOWN)))
    assert len(few[1]) / bays == pytest.approx(0.3, abs=0.1)
    assert len(some[1]) / bays == pytest.approx(0.6, abs=0.1)
    first, second = (
        {int(w.table.ids[row]): (w.table.blueprints[row], w.pose[row].tolist()) for row in rows}
        for w, rows in (few, some)
    )
    assert all(second[actor] == car for actor, car in first.items())
    assert set(parked(share=0.3, seed=1)[0].table.ids) != set(few[0].table.ids)
    assert len(parked(share=0.0)[1]) == 0


def test_nobody_parks_where_somebody_stands() -> None:
    town = load_town(TOWN)
    bay = parking_bays(town)[3]
    world = empty_world(bay.position[0], bay.position[1])
    rows = park_cars(town, world, Draws.of_seed(0), 1.0)
    ids = world.table.ids[rows] - ActorIds.PARKED
    assert bay.number not in ids
    assert len(rows) >= len(parked()[1]) - 3


def slot_town(repeat: int = 4) -> TownMap:
    """A road along y = 0 with a row of spaces across it, 2.5 m wide, to its right; the first stands on the road."""
    from lavsim.map.write import write_network
    from lavsim.towns.layout import Layout

    layout = Layout("slots")
    layout.street("Main Street", (0.0, 0.0), (120.0, 0.0), speed=50)
    text = write_network(layout.network()).decode()
    spaces = "".join(
        f'<object id="{900 + k}" type="parkingSpace" s="{20 + 3 * k}" t="{-12.0 if k else -2.0}" hdg="1.5707963" '
        f'length="5.0" width="2.5" height="0" zOffset="0" orientation="none"><parkingSpace access="car"/></object>'
        for k in range(repeat)
    )
    text = text.replace("<objects>", f"<objects>{spaces}", 1)
    return build_town("slots", text.encode())


def test_spaces_drawn_as_objects_are_taken_but_not_on_the_road() -> None:
    town = slot_town()
    assert len(town.parking) == 4
    bays = parking_bays(town)
    assert len(bays) == 3
    world = empty_world()
    rows = park_cars(town, world, Draws.of_seed(0), 1.0)
    assert len(rows) == 3
    assert np.allclose(np.abs(np.cos(world.pose[rows, 2])), 0.0, atol=1e-6)


def test_a_town_without_parking_has_none() -> None:
    from tests.worlds import straight

    assert parking_bays(straight()) == ()
    assert len(park_cars(straight(), empty_world(), Draws.of_seed(0), 1.0)) == 0
    assert BAY_LENGTH == 6.0
