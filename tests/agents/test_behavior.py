"""The expert: its path and speed, and one row for each situation it must master."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.behavior.agent import Expert
from agents.behavior.control import pedals
from agents.behavior.hazards import Ego
from agents.behavior.manner import Manner
from agents.behavior.path import STEP, PathTracker, ReferencePath, path_through
from agents.behavior.road import StopPoint
from agents.behavior.speed import following, speed_profile, stopping, time_to_cover
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.types import DT, ActorClass, LightState, RoadOption, Role
from lavsim.world.dynamics import REAR_LENGTH, speed_after, steer_curvature

Floats = NDArray[np.float64]
LENGTH, WIDTH = 4.9, 2.1
FOLLOW, LEFT = int(RoadOption.LANEFOLLOW), int(RoadOption.LEFT)


def straight(length: float = 200.0) -> ReferencePath:
    count = int(length)
    points = np.stack([np.arange(count, dtype=np.float64), np.zeros(count), np.zeros(count)], axis=1)
    return path_through(points, np.zeros(count), np.full(count, FOLLOW, np.int8))


def arc(radius: float = 20.0, turn: float = math.pi / 2.0) -> tuple[Floats, Floats]:
    """Points a metre apart on a bend to the right, and their directions."""
    yaw = np.arange(0.0, turn, 1.0 / radius)
    return np.stack([radius * np.sin(yaw), radius * (1.0 - np.cos(yaw)), 0.0 * yaw], axis=1), yaw


@dataclass
class Other:
    """Another road user that keeps its velocity, from `start` [s] on."""

    x: float
    y: float
    yaw: float = 0.0
    speed: float = 0.0
    kind: ActorClass = ActorClass.CAR
    size: tuple[float, float, float] = (4.5, 2.0, 1.5)
    start: float = 0.0

    def at(self, time: float) -> tuple[float, float, float]:
        gone = self.speed * max(time - self.start, 0.0)
        return self.x + gone * math.cos(self.yaw), self.y + gone * math.sin(self.yaw), self.speed * (time >= self.start)


def walker(x: float, y: float, yaw: float, speed: float = 0.0, start: float = 0.0) -> Other:
    return Other(x, y, yaw, speed, ActorClass.WALKER, (0.4, 0.4, 1.8), start)


@dataclass
class Road:
    """The fitted bicycle under the expert's control, among others who don't react."""

    expert: Expert
    others: list[Other] = field(default_factory=list)
    speed: float = 8.0
    x: float = 10.0
    y: float = 0.0
    yaw: float = 0.0
    lights: Callable[[float], LightState] = lambda time: LightState.GREEN
    time: float = 0.0
    closest: float = math.inf
    speeds: list[float] = field(default_factory=list)
    offsets: list[float] = field(default_factory=list)

    def truth(self) -> dict[str, Any]:
        states = [other.at(self.time) for other in self.others]
        xyz = [(self.x, self.y, 0.0), *((x, y, 0.0) for x, y, _ in states)]
        yaw = [self.yaw, *(other.yaw for other in self.others)]
        speeds = [self.speed, *(speed for _, _, speed in states)]
        return {
            "tick": round(self.time / DT),
            "time": self.time,
            "town": "none",
            "ids": np.arange(1, len(xyz) + 1, dtype=np.int32),
            "classes": np.array([0, *(int(o.kind) for o in self.others)], np.uint8),
            "roles": np.array([int(Role.EGO), *(int(Role.TRAFFIC) for _ in self.others)], np.uint8),
            "sizes": np.array([(LENGTH, WIDTH, 1.5), *(o.size for o in self.others)], np.float32),
            "xyz": np.array(xyz),
            "yaw": np.array(yaw),
            "velocities": np.array([(v * math.cos(a), v * math.sin(a), 0.0) for v, a in zip(speeds, yaw, strict=True)]),
            "vehicle_lights": np.zeros(len(xyz), np.int32),
            "lights": np.array([int(self.lights(self.time))], np.uint8),
            "ego_speed": self.speed,
        }

    def drive(self, seconds: float) -> Road:
        tracker = PathTracker(self.expert.path)
        for _ in range(round(seconds / DT)):
            truth = self.truth()
            control = self.expert.drive(truth)
            self.speed = speed_after(self.speed, control.throttle, control.brake, control.reverse)
            curvature = steer_curvature(control.steer)
            step = self.speed * DT
            heading = self.yaw + math.asin(curvature * REAR_LENGTH) + 0.5 * step * curvature
            self.x += step * math.cos(heading)
            self.y += step * math.sin(heading)
            self.yaw += step * curvature
            self.time += DT
            self.speeds.append(self.speed)
            self.offsets.append(tracker.update(self.x, self.y)[1])
            for other in self.others:
                x, y, _ = other.at(self.time)
                ahead, aside = abs(x - self.x), abs(y - self.y)
                turned = abs(math.sin(other.yaw)) > 0.7
                length, width = (other.size[1], other.size[0]) if turned else (other.size[0], other.size[1])
                gap = max(ahead - (LENGTH + length) / 2.0, aside - (WIDTH + width) / 2.0)
                self.closest = min(self.closest, gap)
        return self


def expert(path: ReferencePath | None = None, stop: float | None = None) -> Expert:
    made = Expert(path or straight(), None)
    made.stops = [] if stop is None else [StopPoint(stop, 0)]
    return made


# --- path


def test_path_leaves_out_slips_at_the_joints_of_the_plan() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1.98, 0.01, 0], [2.01, 0, 0], [3, 0, 0], [4, 0, 0]], float)
    path = path_through(points, np.zeros(7), np.full(7, FOLLOW, np.int8))
    assert path.end == pytest.approx(4.0, abs=0.01)
    assert np.abs(path.yaw).max() < 0.02


def test_path_keeps_to_a_bend_and_knows_its_curvature() -> None:
    points, yaw = arc(radius=20.0)
    path = path_through(points, yaw, np.full(len(yaw), LEFT, np.int8))
    inside = slice(6, int(path.end / STEP) - 6)
    assert np.abs(np.hypot(path.xy[inside, 0], path.xy[inside, 1] - 20.0) - 20.0).max() < 0.01
    assert path.curvature[inside] == pytest.approx(0.05, abs=0.003)


def test_lane_change_is_drawn_out() -> None:
    x = np.concatenate([np.arange(40.0), np.arange(45.0, 90.0)])
    y = np.where(x < 42.0, 0.0, 3.5)
    path = path_through(np.stack([x, y, 0.0 * x], axis=1), np.zeros(len(x)), np.full(len(x), FOLLOW, np.int8))
    assert np.abs(path.curvature).max() < 0.08
    assert path.xy[int(path.end / STEP) - 2, 1] == pytest.approx(3.5, abs=0.01)


def test_tracker_is_not_lost_where_the_path_crosses_itself() -> None:
    points, yaw = arc(radius=12.0, turn=4.0 * math.pi)
    path = path_through(points, yaw, np.full(len(yaw), FOLLOW, np.int8))
    tracker, last = PathTracker(path), -1.0
    for point in path.xy[::2]:
        s, offset = tracker.update(*point)
        assert last < s < last + 2.5
        assert abs(offset) < 0.05
        last = s


# --- speed


def test_a_changed_manner_has_a_pace_of_its_own() -> None:
    manner = Manner()
    assert manner.pace.acceleration == manner.acceleration
    assert manner.changed(acceleration=4.5).pace == manner.pace._replace(acceleration=4.5)


def test_profile_slows_down_ahead_of_a_bend() -> None:
    points, yaw = arc(radius=15.0)
    before = np.stack([np.arange(-80.0, 0.0), np.zeros(80), np.zeros(80)], axis=1)
    path = path_through(
        np.concatenate([before, points]), np.concatenate([np.zeros(80), yaw]), np.full(80 + len(yaw), FOLLOW, np.int8)
    )
    manner = Manner()
    profile = speed_profile(path, np.full(len(path), 50.0 / 3.6), manner)
    assert profile[0] == pytest.approx(0.88 * 50.0 / 3.6, abs=0.01)
    assert profile[180] == pytest.approx(math.sqrt(manner.lateral * 15.0), rel=0.05)
    assert (np.diff(profile**2) / (2.0 * STEP)).min() > -manner.comfort_braking - 1e-9


def test_following_and_stopping_are_bounded_and_monotone() -> None:
    manner = Manner()
    gaps = [following(10.0, gap, 5.0, 12.0, manner) for gap in (1.0, 4.0, 10.0, 30.0, 100.0)]
    assert gaps == sorted(gaps)
    assert gaps[0] >= -12.0
    rooms = [stopping(8.0, room, manner) for room in (0.0, 1.0, 5.0, 15.0, 60.0)]
    assert rooms == sorted(rooms)


def test_time_to_cover_matches_its_own_motion() -> None:
    assert time_to_cover(10.0, 0.0, 2.0, 100.0) == pytest.approx(math.sqrt(10.0))
    assert time_to_cover(30.0, 10.0, 1.5, 10.0) == pytest.approx(3.0)
    assert math.isinf(time_to_cover(5.0, 0.0, 0.0, 10.0))


@pytest.mark.parametrize("speed", [0.0, 3.0, 8.0, 12.5])
@pytest.mark.parametrize("wanted", [-6.0, -2.0, 0.8, 1.5])
def test_pedals_invert_the_vehicle(speed: float, wanted: float) -> None:
    throttle, brake = pedals(speed, wanted)
    got = (speed_after(speed, throttle, brake, False) - speed) / DT
    if speed + wanted * DT > 0.0:
        assert got == pytest.approx(wanted, abs=0.05)


# --- situations


def test_free_road_is_driven_at_the_profile() -> None:
    road = Road(expert(), speed=0.0).drive(12.0)
    assert road.speed == pytest.approx(0.88 * 30.0 / 3.6, abs=0.15)
    assert max(abs(o) for o in road.offsets) < 0.01


@pytest.mark.parametrize("start", [12.0, 8.0, 4.0])
def test_red_light_is_respected(start: float) -> None:
    road = Road(expert(stop=60.0), speed=start, lights=lambda time: LightState.RED).drive(15.0)
    assert road.speed == 0.0
    assert 60.0 - 3.0 < road.x + LENGTH / 2.0 < 60.0


def test_green_light_is_not() -> None:
    road = Road(expert(stop=60.0)).drive(12.0)
    assert road.x > 80.0
    assert min(road.speeds) > 6.0


def test_stop_sign_is_stood_at_once_and_then_passed() -> None:
    made = expert()
    made.signs = [StopPoint(60.0, -1)]
    road = Road(made, speed=8.0).drive(25.0)
    still = [k for k, speed in enumerate(road.speeds) if speed < 0.1]
    assert still, "it came to rest"
    assert len(still) < 3.0 / DT, "and went on"
    assert road.x > 90.0


def test_yellow_stops_who_can_and_spares_who_cannot() -> None:
    def turning(time: float) -> LightState:
        return LightState.YELLOW if time < 3.0 else LightState.RED

    stops = Road(expert(stop=45.0), lights=turning).drive(10.0)
    assert stops.x + LENGTH / 2.0 < 45.0
    goes = Road(expert(stop=16.0), lights=turning).drive(3.0)
    assert goes.x - LENGTH / 2.0 - 1.0 > 16.0, "over the line with its rear before red"


@pytest.mark.parametrize("approach", [8.0, 11.0])
def test_yellow_before_a_bend_counts_on_the_speed_of_the_bend(approach: float) -> None:
    """Whenever the light changes: at red its rear is over the line, or its front stays before it."""
    points, yaw = arc(6.5)
    straight_on = np.stack([np.arange(0.0, 60.0), np.zeros(60), np.zeros(60)], axis=1)
    corner = np.concatenate([straight_on, points + np.array([60.0, 0.0, 0.0])])
    behind = corner[-1] + np.arange(1.0, 40.0)[:, None] * (0.0, 1.0, 0.0)
    course = np.concatenate([np.zeros(60), yaw, np.full(39, math.pi / 2.0)])
    path = path_through(np.concatenate([corner, behind]), course, np.full(len(course), FOLLOW, np.int8))
    crossed = 0
    for begin in np.arange(3.5, 6.5, 0.25):

        def turning(time: float, begin: float = begin) -> LightState:
            return (LightState.GREEN, LightState.YELLOW, LightState.RED)[int(time >= begin) + int(time >= begin + 3.0)]

        road = Road(expert(path, 55.0), speed=approach, lights=turning).drive(begin + 3.0)
        view = road.expert.view
        assert view is not None
        over = view.s - LENGTH / 2.0 > 55.0
        crossed += over
        assert over or road.drive(6.0).expert.view.s + LENGTH / 2.0 < 55.0  # type: ignore[union-attr]
    assert 0 < crossed < 12


@pytest.mark.parametrize(("since", "waits"), [(2.0, True), (0.1, False)])
def test_who_was_held_up_on_the_line_leaves_it_at_yellow_only_if_there_is_time(since: float, waits: bool) -> None:
    made = expert(stop=60.0)
    ego = Ego(63.0 - LENGTH / 2.0, 0.0, 0.0, 0.0, 0.0, 8.0, LENGTH / 2.0, 0.95)
    made._time, made._yellow_since, made._goes = 10.0, {0: 10.0 - since}, {0}
    assert (made._lights(ego, [LightState.YELLOW]) < 0.5) == waits
    assert made._lights(ego, [LightState.RED]) < 0.0, "its rear has not crossed"
    assert made._lights(ego._replace(s=66.0), [LightState.RED]) == math.inf, "now it has"


@pytest.mark.parametrize(("over", "waits"), [(0.2, True), (2.5, False)])
def test_who_crawls_over_the_line_as_it_turns_yellow_stops_while_it_stands_in_nobody_s_way(
    over: float, waits: bool
) -> None:
    made = expert(stop=60.0)
    ego = Ego(60.0 + over - LENGTH / 2.0, 0.0, 0.0, 0.0, 1.8, 8.0, LENGTH / 2.0, 0.95)
    made._time = 10.0
    assert (made._lights(ego, [LightState.YELLOW]) < 0.0) == waits


def test_standing_vehicle_is_stopped_for() -> None:
    road = Road(expert(), [Other(60.0, 0.2)], speed=12.0).drive(15.0)
    assert road.speed == 0.0
    assert 1.0 < road.closest < 4.5


def test_vehicle_beside_the_lane_is_passed() -> None:
    road = Road(expert(), [Other(60.0, 2.6), Other(80.0, -3.5, math.pi, 8.0)]).drive(12.0)
    assert road.x > 90.0
    assert min(road.speeds) > 6.0


def test_leader_is_followed_at_its_speed() -> None:
    road = Road(expert(straight(400.0)), [Other(35.0, 0.0, 0.0, 4.0)], speed=7.0).drive(30.0)
    assert road.speed == pytest.approx(4.0, abs=0.3)
    assert 4.0 < road.closest < 12.0


@pytest.mark.parametrize("start", [0.0, 1.0, 2.0, 2.6])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_walker_who_steps_out_is_not_hit(start: float, side: float) -> None:
    crossing = walker(38.0, side * 4.5, -side * math.pi / 2.0, 2.0, start)
    road = Road(expert(), [crossing], speed=7.5).drive(12.0)
    assert road.closest > 0.3
    assert road.x > 60.0, "goes on afterwards"


def test_walker_on_the_pavement_is_passed() -> None:
    road = Road(expert(), [walker(40.0, 3.2, 0.0, 1.4)]).drive(12.0)
    assert min(road.speeds) > 6.0


def test_crossing_vehicle_is_let_through() -> None:
    road = Road(expert(), [Other(60.0, -40.0, math.pi / 2.0, 7.0)], speed=7.0).drive(14.0)
    assert road.closest > 0.8
    assert road.x > 70.0


def test_crossing_vehicle_that_is_far_off_is_not_waited_for() -> None:
    road = Road(expert(), [Other(40.0, -60.0, math.pi / 2.0, 7.0)], speed=7.0).drive(8.0)
    assert min(road.speeds) > 6.0


def test_junction_that_is_blocked_behind_is_not_entered() -> None:
    path = straight()
    path.options[60:100] = LEFT  # 30 m to 50 m
    blocked = Road(Expert(path, None), [Other(54.0, 0.0)]).drive(12.0)
    assert blocked.speed == 0.0
    assert blocked.x + LENGTH / 2.0 < 30.0
    free = Road(Expert(path, None), [Other(70.0, 0.0)]).drive(12.0)
    assert free.x - LENGTH / 2.0 > 50.0


def test_it_drives_away_from_who_comes_up_from_behind() -> None:
    comes = Other(-20.0, 0.0, 0.0, 9.0)
    road = Road(expert(straight(400.0)), [comes], speed=5.0, x=10.0).drive(20.0)
    assert road.closest > 0.3
    alone = Road(expert(straight(400.0)), speed=5.0).drive(20.0)
    assert max(road.speeds) > 8.8
    assert max(alone.speeds) < 7.5


def test_follower_close_behind_is_no_reason_to_stop() -> None:
    road = Road(expert(), [Other(4.0, 0.0, 0.0, 9.0)], speed=7.0)
    road.others[0].size = (4.5, 2.0, 1.5)
    control = road.expert.drive(road.truth())
    assert control.brake == 0.0


def test_route_of_the_bundled_town_is_driven_along_its_middle() -> None:
    town = load_town("eu_small_a")
    # From the first long lane through two junctions.
    lanes = town.lanes
    lane = int(
        next(k for k in range(len(lanes)) if lanes.junction[k] < 0 and lanes.length[k] > 60.0 and lanes.type[k] == 2)
    )
    start = town.waypoint_at(lane, 5.0)
    keypoints = np.array([start.xyz, start.ahead(150.0).xyz, start.ahead(300.0).xyz])
    route = get_planner(town).trace(keypoints)
    path = path_through(np.asarray(route.points), np.asarray(route.yaw), np.asarray(route.command))
    driver = Expert(path, SimpleNamespace(nearest=town.nearest, lanes=lanes, lights=(), signs=()))  # type: ignore[arg-type]
    road = Road(driver, speed=0.0, x=route.points[0, 0], y=route.points[0, 1], yaw=float(route.yaw[0])).drive(60.0)
    assert max(abs(o) for o in road.offsets[: 20 * 40]) < 0.15
    assert PathTracker(path).path.end > 250.0
