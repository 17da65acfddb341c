"""Background walkers: on sidewalks, at kerbs, across roads, round each other."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from lavsim.map.footways import FootwayKind, get_footways
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.traffic.population import Traffic
from lavsim.traffic.walkers import Walkers
from lavsim.types import DT, ActorIds, Control, LaneType, LightState, Role
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.lights import TrafficLights
from lavsim.world.motion import RESTING
from lavsim.world.world import World
from tests import worlds

CAR = BLUEPRINTS["vehicle.seat.leon"]
FAR = np.array([-5e3, -5e3, 0.0])


def make_world(ego: NDArray[np.float64] = FAR) -> World:
    world = World()
    world.spawn(1, BLUEPRINTS["vehicle.lincoln.mkz_2017"], ego, 0.0, Role.EGO)
    return world


class Kerb:
    """A crossing of four arms around (0, 0) with one walker at the southern kerb of the western arm's crosswalk."""

    def __init__(self, lights: bool = False, speed: float = 1.4) -> None:
        self.town = worlds.crossing(lights=lights)
        self.footways = get_footways(self.town)
        self.world = make_world()
        self.walkers = Walkers(self.town, self.world, Draws.of_seed(0), 1)
        self.states = np.full(len(self.town.lights), int(LightState.RED), np.uint8)
        self.row = int(self.walkers.rows[0])
        crosswalks = self.footways.where(FootwayKind.CROSSING)
        self.edge = int(min(crosswalks, key=lambda e: self.footways.line(e)[:, 0].mean()))
        self.forward = bool(self.footways.line(self.edge)[0, 1] > 0.0)
        self._stand(speed)

    def _stand(self, speed: float) -> None:
        walker = self.walkers._walkers[0]
        line, length = self.footways.line(self.edge), float(self.footways.length[self.edge])
        kerb = float(self.footways.kerb[self.edge, 0 if self.forward else 1])
        along = np.arange(len(line)) * self.footways.step[self.edge]
        walker["edge"], walker["u"], walker["forward"], walker["pause"] = self.edge, kerb, self.forward, 0
        walker["speed"], walker["share"] = speed, 0.2
        walker["next"], walker["next_forward"] = self._beyond(), 1
        self.world.pose[self.row, :2] = [np.interp(kerb, along, line[:, k]) for k in range(2)]
        self.length = length

    def _beyond(self) -> int:
        """A sidewalk at the other end of the crosswalk that begins there."""
        node = self.footways.ends[self.edge, 1 if self.forward else 0]
        return next(int(e) for e in self.footways.edges_at(int(node)) if self.footways.ends[e, 0] == node)

    def car(self, before: float, speed: float, northern: bool = False) -> int:
        """A car that comes to the crosswalk, its front `before` metres of the walkers' way; its row."""
        x = float(self.footways.line(self.edge)[:, 0].mean())
        place = np.array([x + before + 2.1, -1.75, 0.0]) if northern else np.array([x - before - 2.1, 1.75, 0.0])
        number = ActorIds.of_scenario(0) + self.world.count
        row = self.world.spawn(number, CAR, place, np.pi if northern else 0.0, Role.SCENARIO).row
        self.world.body[row, 0], self.world.command[row, 0] = speed, speed
        self.world.velocity[row, 0] = -speed if northern else speed
        return row

    def tick(self, seconds: float = DT) -> None:
        for _ in range(round(seconds / DT)):
            self.walkers.control(self.states.copy())
            self.world.drive_ego(Control(brake=1.0))
            self.world.step()

    @property
    def is_on_road(self) -> bool:
        return abs(float(self.world.pose[self.row, 1])) < 3.4

    @property
    def is_across(self) -> bool:
        return float(self.world.pose[self.row, 1]) < -3.4


def test_who_finds_the_road_free_crosses_at_once() -> None:
    scene = Kerb()
    assert scene.world.pose[scene.row, 1] > 3.5
    scene.tick(2.0)
    assert scene.is_on_road
    scene.tick(5.0)
    assert scene.is_across


@pytest.mark.parametrize("northern", [False, True])
def test_who_sees_a_car_coming_waits_until_it_has_passed(northern: bool) -> None:
    scene = Kerb()
    car = scene.car(30.0, 8.0, northern)
    x = scene.world.pose[scene.row, 0]
    while (scene.world.pose[car, 0] - x) * (-1.0 if northern else 1.0) < 0.0:
        scene.tick()
        # While a car passes on the far lane one may be on the near one.
        assert scene.world.pose[scene.row, 1] > 0.3 if northern else not scene.is_on_road
    scene.tick(7.0)
    assert scene.is_across
    assert scene.world.touched[scene.row] < 0


@pytest.mark.parametrize(("before", "speed"), [(3.0, 0.0), (55.0, 4.0)])
def test_a_car_that_stands_or_is_far_off_holds_nobody_up(before: float, speed: float) -> None:
    scene = Kerb()
    scene.car(before, speed)
    scene.tick(2.0)
    assert scene.is_on_road


def test_who_walks_slowly_lets_a_car_pass_that_a_fast_one_does_not() -> None:
    went = []
    for speed in (0.9, 1.9):
        scene = Kerb(speed=speed)
        scene.car(70.0, 8.0, northern=True)
        scene.tick(2.0)
        went.append(scene.is_on_road)
    assert went == [False, True]


def test_with_lights_one_waits_for_red_and_goes_then() -> None:
    scene = Kerb(lights=True)
    own = scene.footways.lights(scene.edge)
    scene.states[own] = LightState.GREEN
    scene.tick(10.0)
    assert not scene.is_on_road
    scene.states[own] = LightState.YELLOW
    scene.tick(2.0)
    assert not scene.is_on_road
    scene.states[own] = LightState.RED
    scene.tick(2.0)
    assert scene.is_on_road


def test_nobody_sets_out_late_in_the_red() -> None:
    scene = Kerb(lights=True)
    scene.walkers._walkers[0]["patience"] = 100_000
    own = scene.footways.lights(scene.edge)
    scene.walkers._walkers[0]["pause"] = 100_000
    scene.states[own] = LightState.GREEN
    scene.tick(1.0)
    scene.states[own] = LightState.RED
    red = float(scene.walkers._signals.red[own[0]])
    scene.tick(red - 2.0)
    scene.walkers._walkers[0]["pause"] = 0
    scene.tick(1.5)
    assert not scene.is_on_road


def test_a_car_at_its_red_light_holds_nobody_up_but_one_that_runs_it_does() -> None:
    went = []
    for speed in (3.0, 16.0):
        scene = Kerb(lights=True)
        scene.states[scene.footways.lights(scene.edge)] = LightState.GREEN
        scene.tick(0.2)
        scene.states[scene.footways.lights(scene.edge)] = LightState.RED
        scene.car(22.0, speed)
        scene.tick(1.0)
        went.append(scene.is_on_road)
    assert went == [True, False]


def test_who_waits_too_long_goes_another_way() -> None:
    scene = Kerb()
    car = scene.car(-1.0, 0.0)  # it stands on the crosswalk
    scene.tick(15.0)
    assert not scene.is_on_road
    scene.tick(18.0)
    assert np.hypot(*(scene.world.pose[scene.row, :2] - scene.world.pose[car, :2])) > 5.0


def test_who_is_on_the_road_hurries_from_a_car_that_does_not_brake() -> None:
    scene = Kerb()
    scene.tick(1.1)
    scene.car(10.0, 10.0)
    scene.tick(0.4)
    assert scene.is_on_road
    assert np.hypot(*scene.world.velocity[scene.row, :2]) > 2.2
    scene.tick(3.0)
    assert scene.world.touched[scene.row] < 0


class Crowd:
    """A town with walkers alone."""

    def __init__(self, town: TownMap, count: int, seed: int = 0, jaywalking: float = 0.0) -> None:
        self.town, self.world = town, make_world()
        self.walkers = Walkers(town, self.world, Draws.of_seed(seed), count, jaywalking)
        self.lights = len(town.lights)

    @property
    def places(self) -> NDArray[np.float64]:
        return self.world.pose[self.walkers.rows, :2]

    def tick(self) -> None:
        """Lights change every 20 s."""
        state = (LightState.RED, LightState.GREEN)[self.world.tick // 400 % 2]
        self.walkers.control(np.full(self.lights, int(state), np.uint8))
        self.world.drive_ego(Control(brake=1.0))
        self.world.step()


def ground_of(town: TownMap) -> shapely.Geometry:
    """Sidewalks and crosswalks, as the map draws them."""
    lanes = [shapely.Polygon(town.lane_polygon(int(k))) for k in town.lanes.where(LaneType.SIDEWALK)]
    parts = [*lanes, *(shapely.Polygon(polygon) for polygon in town.crosswalks)]
    ground = shapely.union_all([shapely.make_valid(part).buffer(0.3) for part in parts])
    shapely.prepare(ground)
    return ground


@pytest.mark.parametrize(("name", "count"), [("eu_small_a", 80), ("us_large_a", 120)])
def test_three_minutes_of_walking_on_the_ground_for_it_and_nobody_stuck(name: str, count: int) -> None:
    scene = Crowd(load_town(name), count)
    ground = ground_of(scene.town)
    anchor, since = scene.places.copy(), np.zeros(count, int)
    crossed = np.zeros(count, bool)
    for tick in range(3600):
        scene.tick()
        crossed |= scene.walkers._walkers["crossing"] > 0
        moved = np.hypot(*(scene.places - anchor).T) > 0.5
        anchor[moved] = scene.places[moved]
        since[moved | (scene.walkers._walkers["since"] >= 0)] = tick
        assert tick - since.min() < 600, "who does not wait at a kerb walks on within half a minute"
        if tick % 20 == 0:
            assert shapely.contains_xy(ground, *scene.places.T).all()
    assert (scene.world.touched[scene.walkers.rows] < 0).all()
    assert crossed.sum() > count / 4


@pytest.mark.slow
@pytest.mark.parametrize(("name", "vehicles"), [("eu_small_a", 100), ("us_large_a", 150)])
def test_ten_minutes_among_traffic_touch_nobody(name: str, vehicles: int) -> None:
    town = load_town(name)
    world, draws = make_world(), Draws.of_seed(0)
    traffic, walkers = Traffic(town, world, draws, vehicles), Walkers(town, world, draws, 100)
    lights, ground = TrafficLights(len(town.lights), town.light_groups), ground_of(town)
    anchor, since = world.pose[walkers.rows, :2].copy(), np.zeros(100, int)
    for tick in range(12_000):
        states = lights.states(tick * DT)
        traffic.control(states)
        walkers.control(states)
        world.drive_ego(Control(brake=1.0))
        world.step()
        places = world.pose[walkers.rows, :2]
        moved = np.hypot(*(places - anchor).T) > 0.5
        anchor[moved] = places[moved]
        since[moved | (walkers._walkers["since"] >= 0)] = tick
        assert tick - since.min() < 1200
        if tick % 20 == 0:
            assert shapely.contains_xy(ground, *places.T).all()
    assert (world.touched[walkers.rows] < 0).all()


def test_nobody_leaves_the_sidewalk_of_a_road_without_crosswalks_but_jaywalkers_do() -> None:
    sides = []
    for jaywalking in (0.0, 1.0):
        scene = Crowd(worlds.straight(200.0), 20, jaywalking=jaywalking)
        assert len(scene.walkers) == 20
        before = np.sign(scene.places[:, 1])
        for _ in range(2400):
            scene.tick()
        sides.append(int((np.sign(scene.places[:, 1]) != before).sum()))
        assert (np.abs(scene.places[:, 0] - 100.0) < 101.0).all()
    assert sides[0] == 0
    assert sides[1] > 3


def test_two_that_meet_pass_each_other() -> None:
    scene = Crowd(worlds.straight(200.0), 2)
    walkers, ground = scene.walkers._walkers, scene.walkers._ground
    start = int(walkers[0]["edge"])
    for k, forward in enumerate((1, 0)):
        walkers[k]["edge"], walkers[k]["forward"], walkers[k]["share"], walkers[k]["speed"] = start, forward, 0.0, 1.4
        walkers[k]["next"], walkers[k]["next_forward"] = start, 1 - forward
        edge = ground.edge[start]
        row = edge["first"] + (2 if forward else edge["last"] - edge["first"] - 2)
        walkers[k]["u"] = (row - edge["first"]) * edge["step"]
        scene.world.pose[scene.walkers.rows[k], :2] = ground.points[row, :2]
    apart = []
    first = scene.places.copy()
    for _ in range(int(np.hypot(*(first[1] - first[0])) / 1.4 / DT)):
        scene.tick()
        apart.append(np.hypot(*(scene.places[1] - scene.places[0])))
    assert 0.4 < min(apart) < 1.2
    assert np.hypot(*(scene.places[0] - first[0])) > 0.6 * np.hypot(*(first[1] - first[0]))


def test_one_walks_round_what_stands_on_the_sidewalk() -> None:
    scene = Crowd(worlds.straight(200.0), 1)
    rows = scene.walkers.rows
    x, y, yaw = scene.world.pose[rows[0]]
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    cone = BLUEPRINTS["static.prop.trafficcone01"]
    place = np.array([x, y]) + 5.0 * ahead
    scene.world.spawn(ActorIds.of_scenario(0), cone, np.array([*place, 0.0]), 0.0, Role.PROP)
    for _ in range(240):
        scene.tick()
    assert (scene.places[0] - place) @ ahead > 3.0
    assert scene.world.touched[rows[0]] < 0


def test_who_was_knocked_down_is_left_alone() -> None:
    scene = Crowd(worlds.straight(200.0), 1)
    row = int(scene.walkers.rows[0])
    scene.world.motion[row] = RESTING
    before = scene.places.copy()
    for _ in range(40):
        scene.tick()
    assert np.allclose(scene.places, before)
    assert not scene.world.command[row].any()


def test_walkers_are_adults_and_children_of_both_kinds_spread_over_town() -> None:
    scene = Crowd(load_town("us_large_a"), 300)
    table, rows = scene.world.table, scene.walkers.rows
    assert len(rows) == 300
    sizes, counts = np.unique(table.sizes[rows], axis=0, return_counts=True)
    boxes = {
        tuple(size): count for size, count in zip(sizes.astype(float).round(2).tolist(), counts.tolist(), strict=True)
    }
    assert set(boxes) == {(0.38, 0.38, 1.86), (0.38, 0.38, 1.3), (0.5, 0.5, 1.1)}
    assert 0.1 < 1.0 - boxes[0.38, 0.38, 1.86] / 300 < 0.2
    speeds = scene.walkers._walkers["speed"]
    assert 0.8 < speeds.min() < speeds.max() <= 1.9
    assert 1.3 < np.median(speeds) < 1.5
    gaps = np.hypot(*(scene.places[:, None] - scene.places[None]).transpose(2, 0, 1)) + 1e3 * np.eye(300)
    assert gaps.min() >= 2.0
    assert np.ptp(scene.places, axis=0).min() > 600.0
    assert (table.roles[rows] == Role.TRAFFIC).all()


def test_nobody_is_spawned_where_the_ego_stands() -> None:
    town = load_town("eu_small_a")
    walkers = Walkers(town, free := make_world(), Draws.of_seed(0), 40)
    place = free.pose[walkers.rows[7], :2]
    world = make_world(np.array([*place, 0.0]))
    others = Walkers(town, world, Draws.of_seed(0), 40)
    assert np.hypot(*(world.pose[others.rows, :2] - place).T).min() > 3.0
    kept = np.hypot(*(free.pose[walkers.rows, :2] - place).T) > 3.5
    assert np.array_equal(world.pose[others.rows][kept], free.pose[walkers.rows][kept])


def test_actors_far_away_and_more_walkers_change_nobody() -> None:
    town = load_town("eu_small_a")
    alone, beside, more = Crowd(town, 30), Crowd(town, 30), Crowd(town, 31)
    beside.world.spawn(ActorIds.of_scenario(0), CAR, np.array([4e3, 4e3, 0.0]), 0.0, Role.SCENARIO)
    for _ in range(400):
        alone.tick()
        beside.tick()
    assert alone.places.tobytes() == beside.places.tobytes()
    fields = ["key", "speed", "share", "patience", "pause", "jaywalks"]
    fresh = Crowd(town, 30)
    assert np.array_equal(fresh.walkers._walkers[fields], more.walkers._walkers[fields][:30])
    assert np.array_equal(fresh.places, more.places[:30])


def test_towns_without_sidewalks_have_no_walkers() -> None:
    scene = Crowd(worlds.arc(), 10)
    assert len(scene.walkers) == 0
    scene.tick()
