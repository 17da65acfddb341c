"""Background drivers: followers, obstacles, and a town's traffic as a whole."""

import math

import numpy as np
import pytest

from lavsim.map.town_files import load_town, town_names
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.traffic.drivers import Driver, draw_driver
from lavsim.traffic.following import idm_acceleration
from lavsim.traffic.obstacles import MOVING, Boxes, enter_moving, make_grid, obstacle_at
from lavsim.traffic.population import Traffic
from lavsim.types import DT, Control, LightState, Role
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.lights import TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather
from lavsim.world.world import World

DRIVER = np.array(Driver().traits)


def boxes_at(*poses: tuple[float, float, float, float, float]) -> Boxes:
    """Cars at (x, y, yaw, vx, vy)."""
    values = np.array(poses, dtype=float)
    velocity = np.column_stack([values[:, 3:], np.zeros(len(values))])
    return Boxes(
        np.ones(len(values), bool),
        values[:, :3].copy(),
        velocity,
        np.tile([2.3, 0.95], (len(values), 1)),
        np.zeros(len(values)),
        values[:, 3].copy(),
        np.zeros(len(values), bool),
    )


def gap_ahead(boxes: Boxes, x: float, time: float = 0.0) -> tuple[float, float]:
    """What blocks a path along +x at (x, 0), as row 0 sees it."""
    grid = make_grid(np.array([-100.0, -100.0, 100.0, 100.0]), len(boxes.present))
    enter_moving(grid, boxes, np.full(len(boxes.present), MOVING, np.uint8), 1.7)
    gap, speed, _row = obstacle_at(grid, boxes, 0, (x, 0.0, 0.0), time, 1.3)
    return gap, speed


OWN = (0.0, 0.0, 0.0, 8.0, 0.0)


def test_a_car_on_the_path_is_the_leader() -> None:
    gap, speed = gap_ahead(boxes_at(OWN, (20.0, 0.5, 0.0, 5.0, 0.0)), 17.0)
    assert gap == pytest.approx(20.0 - 2.3 - 17.0)
    assert speed == pytest.approx(5.0)


@pytest.mark.parametrize("y", [3.5, -3.5])
def test_a_car_in_the_next_lane_is_not(y: float) -> None:
    assert math.isinf(gap_ahead(boxes_at(OWN, (20.0, y, 0.0, 5.0, 0.0)), 19.0)[0])


def test_oncoming_traffic_in_its_own_lane_blocks_nobody() -> None:
    assert math.isinf(gap_ahead(boxes_at(OWN, (20.0, -3.5, math.pi, -8.0, 0.0)), 19.0, 2.0)[0])


def test_a_car_on_the_bridge_above_blocks_nobody() -> None:
    boxes = boxes_at(OWN, (20.0, 0.0, 0.0, 5.0, 0.0))
    boxes.height[1] = 5.0
    assert math.isinf(gap_ahead(boxes, 19.0)[0])


def test_a_crossing_car_blocks_where_it_will_be() -> None:
    crossing = boxes_at(OWN, (20.0, -10.0, math.pi / 2, 0.0, 6.0))
    assert math.isinf(gap_ahead(crossing, 20.0, 0.0)[0])
    assert gap_ahead(crossing, 20.0, 1.7)[0] < 0.0


def test_idm_reaches_its_free_speed_and_keeps_its_gap() -> None:
    speed = 0.0
    for _ in range(2000):
        speed += idm_acceleration(speed, 10.0, math.inf, 0.0, DRIVER) * DT
    assert speed == pytest.approx(10.0, abs=0.05)
    place, speed = 0.0, 10.0
    for _ in range(2000):
        speed = max(0.0, speed + idm_acceleration(speed, 10.0, 60.0 - place, speed, DRIVER) * DT)
        place += speed * DT
    assert 1.5 < 60.0 - place < 2.6


def test_equilibrium_flow_is_that_of_theory() -> None:
    """At speed v a column keeps s0 + v T of gap; 1,500 to 2,200 vehicles/h/lane."""
    flow = 0.0
    for speed in np.linspace(1.0, 13.0, 60):
        gap = Driver().min_gap + speed * Driver().headway
        assert idm_acceleration(speed, 14.0, gap, 0.0, DRIVER) == pytest.approx(0.0, abs=1e-3)
        flow = max(flow, 3600.0 * speed / (gap + 4.5))
    assert 1500.0 < flow < 2200.0


def test_a_driver_depends_on_its_id_alone() -> None:
    draws = Draws.of_seed(5)
    assert draw_driver(draws, 1003) == draw_driver(draws, 1003)
    assert draw_driver(draws, 1003) != draw_driver(draws, 1004)


class Town:
    """A town with traffic, and an ego that stands far from all roads."""

    def __init__(self, count: int, seed: int = 0, name: str = "eu_small_a") -> None:
        self.town: TownMap = load_town(name)
        self.world = World()
        self.world.spawn(1, BLUEPRINTS["vehicle.lincoln.mkz_2017"], np.array([-5e3, -5e3, 0.0]), 0.0, Role.EGO)
        self.lights = TrafficLights(len(self.town.lights), self.town.light_groups)
        self.traffic = Traffic(self.town, self.world, Draws.of_seed(seed), count)

    def tick(self) -> Snapshot:
        states = self.lights.states(self.world.tick * DT)
        self.traffic.control(states)
        self.world.drive_ego(Control(brake=1.0))
        self.world.step()
        return self.world.publish(states, Weather(), np.zeros(0, HAZARD_DTYPE))


def test_five_minutes_of_traffic_without_contact_on_its_lanes_and_moving() -> None:
    scene = Town(40)
    assert len(scene.traffic) == 40
    driven = np.zeros(41)
    for tick in range(6000):
        snapshot = scene.tick()
        assert not len(snapshot.contacts), snapshot.contacts
        driven += snapshot.speeds * DT
        if tick % 100 == 0:
            hits = scene.town.nearest(snapshot.xy[1:])
            assert np.abs(hits.offset).max() < 0.3
    assert np.median(driven[1:]) > 300.0
    assert (driven[1:] > 20.0).all() or np.sum(driven[1:] < 20.0) <= 2


@pytest.mark.parametrize("name", town_names())
def test_ninety_seconds_of_dense_traffic_without_contact(name: str) -> None:
    scene = Town(100, name=name)
    for _ in range(1800):
        snapshot = scene.tick()
        assert not len(snapshot.contacts), snapshot.contacts
    assert snapshot.speeds.mean() > 1.0


def test_who_comes_to_a_stop_sign_stands_before_it_goes() -> None:
    scene = Town(100, name="us_rural")
    stops = [lane for sign in scene.town.signs if sign.kind == "stop" for lane in sign.lanes]
    fleet = scene.traffic._fleet
    stood = np.full(len(fleet.lane), -1000)
    before = fleet.lane.copy()
    passed = 0
    for tick in range(2400):
        snapshot = scene.tick()
        stood[snapshot.speeds[1:] < 0.15] = tick
        for i in np.flatnonzero((fleet.lane != before) & np.isin(fleet.lane, stops)):
            if tick > 400:  # some were spawned behind the line
                passed += 1
                assert tick - stood[i] < 200, "it stood at the line within the last ten seconds"
        before = fleet.lane.copy()
    assert passed > 10


def test_nobody_enters_a_junction_at_red() -> None:
    scene = Town(40, seed=1)
    lanes = scene.town.lanes
    before = None
    entered = 0
    for _ in range(3000):
        snapshot = scene.tick()
        fleet = scene.traffic._fleet
        if before is not None:
            for i in np.flatnonzero(fleet.lane != before):
                light = lanes.light[fleet.lane[i]]
                if lanes.junction[fleet.lane[i]] >= 0 and lanes.junction[before[i]] < 0 and light >= 0:
                    entered += 1
                    assert snapshot.lights[light] != LightState.RED
        before = fleet.lane.copy()
    assert entered > 50


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    digests = []
    for seed in (0, 0, 1):
        scene = Town(25, seed)
        for _ in range(300):
            snapshot = scene.tick()
        digests.append(snapshot.pose.tobytes() + snapshot.velocity.tobytes())
    assert digests[0] == digests[1] != digests[2]


def test_more_vehicles_leave_the_drivers_of_the_others_as_they_were() -> None:
    few, many = Town(10), Town(20)
    assert np.array_equal(few.traffic._fleet.driver, many.traffic._fleet.driver[:10])
    assert np.array_equal(few.traffic._fleet.key, many.traffic._fleet.key[:10])
    assert few.world.table.blueprints == many.world.table.blueprints[:11]
