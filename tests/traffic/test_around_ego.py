"""Traffic that follows the ego."""

import numpy as np
import pytest

from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.traffic.around_ego import LEFT_BEHIND, left_behind, places_around
from lavsim.traffic.drivers import MIN_GAP
from lavsim.traffic.population import Traffic
from lavsim.types import Control, LightState, Role
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.world import World
from tests import worlds
from tests.traffic.stage import CAR


def test_two_appear_before_and_two_behind_the_ego_on_each_lane_of_its_direction() -> None:
    places = places_around(worlds.two_lanes(300.0), Draws.of_seed(0), 0, 150.0)
    assert sorted(u for lane, u in places if lane == 0) == pytest.approx([120.0, 135.0, 165.0, 180.0])
    assert sorted(u for lane, u in places if lane == 1) == pytest.approx([120.0, 135.0, 165.0, 180.0])


def test_oncoming_ones_appear_every_forty_metres_up_to_eighty() -> None:
    places = places_around(worlds.straight(300.0), Draws.of_seed(0), 3, 150.0)
    assert sorted(u for lane, u in places if lane == 2) == pytest.approx([70.0, 110.0])


def test_the_entries_of_a_junction_are_sources_only_when_it_is_near() -> None:
    town = worlds.crossing(120.0)
    west = int(town.nearest([[-60.0, 1.75]]).lane[0])
    entries = {int(town.nearest([p]).lane[0]) for p in ((60.0, -1.75), (1.75, 60.0), (-1.75, -60.0))}
    length = float(town.lanes.length[west])
    far = {lane for lane, _ in places_around(town, Draws.of_seed(0), west, length - 60.0)}
    assert not far & entries - {int(town.nearest([[60.0, -1.75]]).lane[0])}
    active = [
        len({k for k, _ in places_around(town, Draws.of_seed(s), west, length - 20.0)} & entries) for s in range(30)
    ]
    assert 0.6 < np.mean(active) / 3.0 < 1.0
    cars = [lane for lane, _ in places_around(town, Draws.of_seed(1), west, length - 20.0)]
    assert max(cars.count(k) for k in entries) <= 6 + 1  # and one that comes along the road


def test_who_is_far_behind_is_not_missed() -> None:
    points = np.array([[-LEFT_BEHIND - 1.0, 0.0], [LEFT_BEHIND + 1.0, 0.0], [LEFT_BEHIND + 60.0, 0.0], [-50.0, 0.0]])
    assert left_behind(points, np.zeros(2), 0.0).tolist() == [True, False, True, False]


def test_vehicles_stay_around_a_moving_ego_with_ids_that_are_never_used_again() -> None:
    town = load_town("us_large_a")
    lane = int(np.flatnonzero((town.lanes.junction < 0) & (town.lanes.type == 2) & (town.lanes.length > 150.0))[0])
    world = World()
    x, y, z, yaw = town.centre(np.array([lane]), np.array([5.0]))[0, :4]
    world.spawn(1, BLUEPRINTS[CAR], np.array([x, y, z]), float(yaw), Role.EGO)
    traffic = Traffic(town, world, Draws.of_seed(0), 250, follows_ego=True)
    assert len(traffic) > 3
    lights = np.full(len(town.lights), LightState.GREEN, np.uint8)
    u = 5.0
    for tick in range(900):
        u += 0.35
        while u > town.lanes.length[lane]:
            u -= float(town.lanes.length[lane])
            lane = int(town.lanes.successors(lane)[0])
        world.pose[0, :2] = town.centre(np.array([lane]), np.array([u]))[0, :2]
        world.pose[0, 2] = town.centre(np.array([lane]), np.array([u]))[0, 3]
        traffic.control(lights)
        world.drive_ego(Control(brake=1.0))
        world.step()
        if tick % 50 == 0:
            distance = np.hypot(*(world.pose[traffic.rows, :2] - world.ego.xy).T)
            assert distance.max() < LEFT_BEHIND + 60.0
    ids = world.table.ids
    assert len(np.unique(ids)) == len(ids) > len(traffic) + 1
    assert len(traffic) > 5
    assert (traffic._fleet.driver[traffic._fleet.row >= 0, MIN_GAP] == 10.0).all()
