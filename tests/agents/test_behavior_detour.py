"""Passing what stands in the way: when there is room, when it has to wait, and when it must not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from agents.behavior.agent import Expert
from agents.behavior.path import path_through
from agents.behavior.way import Shift, shifted
from lavsim.map.town_map import TownMap
from lavsim.types import DT, ActorClass, Role, VehicleLight
from tests import worlds
from tests.agents.test_behavior import FOLLOW, LENGTH, Other, Road, straight

FLASHING = int(VehicleLight.LEFT_BLINKER | VehicleLight.RIGHT_BLINKER)
LANE = 1.75  # [m] y of the ego's lane on a street along y = 0


class Street(Road):
    """A road with a town under it; actors have roles and lights, and the least gap counts turned boxes."""

    def truth(self) -> dict[str, Any]:
        truth = super().truth()
        for k, other in enumerate(self.others):
            truth["roles"][k + 1] = getattr(other, "role", Role.SCENARIO)
            truth["vehicle_lights"][k + 1] = getattr(other, "lights", 0)
        return truth


def expert_on(town: TownMap, y: float = LANE, length: float = 290.0) -> Expert:
    x = np.arange(5.0, length)
    points = np.stack([x, np.full(len(x), y), 0.0 * x], axis=1)
    return Expert(path_through(points, 0.0 * x, np.full(len(x), FOLLOW, np.int8)), town)


def street(others: list[Other], town: TownMap | None = None, y: float = LANE, speed: float = 8.0) -> Street:
    return Street(expert_on(town or worlds.straight(300.0), y), others, speed=speed, y=y)


def parked(x: float, y: float = LANE + 0.9, role: Role = Role.PROP, lights: int = FLASHING, **more: Any) -> Other:
    other = Other(x, y, **more)
    other.role, other.lights = role, lights  # type: ignore[attr-defined]
    return other


def test_parked_car_is_passed_and_the_lane_taken_again() -> None:
    road = street([parked(80.0)]).drive(25.0)
    assert road.closest > 0.3
    assert road.x > 150.0
    assert min(road.speeds) > 4.0
    assert road.y == pytest.approx(LANE, abs=0.1)
    assert road.expert.path is road.expert.way.base


def test_standing_car_of_the_traffic_is_waited_for() -> None:
    road = street([parked(80.0, LANE, Role.TRAFFIC, 0)]).drive(25.0)
    assert road.speed == 0.0
    assert road.x < 76.0


def test_three_obstacles_are_passed_in_one_go() -> None:
    road = street([parked(80.0), parked(90.0, LANE + 1.0), parked(97.0)]).drive(30.0)
    assert road.closest > 0.3
    assert road.x > 150.0


def test_props_on_the_lane_are_passed_and_flat_ones_driven_over() -> None:
    cones = [parked(70.0 + 3.0 * k, LANE + 0.6, kind=ActorClass.PROP, size=(0.3, 0.3, 0.9)) for k in range(5)]
    road = street(cones).drive(25.0)
    assert road.closest > 0.1
    assert road.x > 130.0
    flat = street([parked(70.0, LANE, kind=ActorClass.PROP, size=(1.5, 1.5, 0.05))]).drive(12.0)
    assert min(flat.speeds) > 6.0
    assert max(abs(offset) for offset in flat.offsets) < 0.05


@pytest.mark.parametrize("start", [120.0, 160.0, 200.0, 240.0])
def test_oncoming_traffic_goes_first_or_is_far_enough(start: float) -> None:
    comes = Other(start, -LANE, math.pi, 10.0)
    road = street([parked(80.0, LANE + 0.2), comes]).drive(40.0)
    assert road.closest > 0.3
    assert road.x > 150.0


def test_gap_in_a_stream_is_taken_without_touching_anybody() -> None:
    stream = [Other(110.0 + 25.0 * k, -LANE, math.pi, 8.0) for k in range(12)]
    road = street([parked(80.0, LANE + 0.2), *stream]).drive(60.0)
    assert road.closest > 0.3
    assert road.x > 120.0


def test_too_near_to_steer_it_drives_back_first() -> None:
    road = street([parked(70.0, LANE)], speed=0.0)
    road.x = 70.0 - 2.25 - LENGTH / 2.0 - 2.5
    road.drive(40.0)
    assert min(road.speeds) < -0.5
    assert road.closest > 0.3
    assert road.x > 100.0


def test_it_does_not_drive_back_into_who_stands_behind() -> None:
    road = street([parked(70.0, LANE), Other(55.0, LANE)], speed=0.0)
    road.x = 70.0 - 2.25 - LENGTH / 2.0 - 2.5
    road.drive(10.0)
    assert min(road.speeds) >= 0.0


def test_lane_beside_is_left_to_who_comes_from_behind() -> None:
    town = worlds.two_lanes()
    right = float(town.centre(np.array([town.lanes.where(2)[-1]]), np.array([50.0]))[0, 1])
    faster = Other(-10.0, right - 3.5, 0.0, 13.0)
    road = street([parked(80.0, right), faster], town, right).drive(25.0)
    assert road.closest > 0.3
    assert road.x > 130.0


def test_slow_bicycle_at_the_edge_is_passed() -> None:
    rider = Other(60.0, LANE + 0.96, 0.0, 2.8, ActorClass.BICYCLE, (1.8, 0.6, 1.7))
    road = street([rider]).drive(25.0)
    assert road.closest > 0.3
    assert road.x > rider.at(road.time)[0] + 20.0
    assert min(road.speeds) > 3.0


@pytest.mark.parametrize("change", [98.0, 110.0])
def test_obstacle_before_the_routes_own_lane_change_is_passed(change: float) -> None:
    """The route goes to the lane beside right behind the obstacle; it bends, the road does not."""
    town = worlds.two_lanes(300.0)
    left, right = two_lane_y(town, 0), two_lane_y(town, 1)
    x = np.arange(5.0, 290.0)
    points = np.stack([x, np.where(x < change, right, left), 0.0 * x], axis=1)
    made = Expert(path_through(points, 0.0 * x, np.full(len(x), FOLLOW, np.int8)), town)
    road = Street(made, [parked(80.0, right)], speed=8.0, y=right).drive(40.0)
    assert road.closest > 0.3
    assert road.x > 130.0
    assert min(road.speeds) > -0.01, "there is no need to drive back"


@pytest.mark.parametrize("speed", [4.0, 8.0, 12.0])
def test_it_looks_for_five_seconds_before_it_drives_against_traffic(speed: float) -> None:
    obstacle = parked(120.0, LANE, kind=ActorClass.PROP, size=(2.0, 2.0, 1.0))
    road = street([obstacle], speed=speed)
    near, over = math.inf, math.inf
    while road.x < 150.0 and road.time < 60.0:
        road.drive(DT)
        if math.hypot(road.x - obstacle.x, road.y - obstacle.y) < 30.0:
            near = min(near, road.time)
        if road.y < 0.0:
            over = min(over, road.time)
    assert road.x >= 150.0
    assert road.closest > 0.3
    assert 5.0 < over - near < 9.0
    assert min(road.speeds) > 0.5, "it comes near slowly instead of standing"


def test_lane_beside_is_taken_at_once() -> None:
    town = worlds.two_lanes(300.0)
    right = two_lane_y(town, 1)
    road = street([parked(120.0, right, kind=ActorClass.PROP, size=(2.0, 2.0, 1.0))], town, right).drive(25.0)
    assert road.x > 150.0
    assert min(road.speeds) > 5.0


def test_road_without_another_lane_is_no_detour() -> None:
    road = Road(Expert(straight(), None), [parked(80.0, 0.0)]).drive(20.0)
    assert road.speed == 0.0
    assert road.closest > 1.0


def test_shifted_path_is_smooth_and_as_far_aside_as_asked() -> None:
    base = straight(120.0)
    path = shifted(base, Shift(30.0, 50.0, 70.0, 90.0, -3.0).at(np.arange(len(base), dtype=np.float64) * 0.5))
    assert path.xy[:, 1].min() == pytest.approx(-3.0, abs=1e-6)
    assert np.abs(path.curvature).max() < 1.1 * math.pi**2 / 2.0 * 3.0 / 20.0**2
    assert np.abs(np.diff(path.yaw)).max() < 0.03
    assert (path.xy[-20:] == base.xy[-20:]).all()


BLUE = int(VehicleLight.SPECIAL1)


def two_lane_y(town: TownMap, side: int) -> float:
    """y of the left (0) or right (1) lane of `two_lanes`."""
    lanes = town.lanes.where(2)
    return float(sorted(town.centre(np.array([lane]), np.array([50.0]))[0, 1] for lane in lanes)[side])


@pytest.mark.parametrize("side", [0, 1])
def test_way_is_made_for_blue_lights_from_behind(side: int) -> None:
    town = worlds.two_lanes(600.0)
    y = two_lane_y(town, side)
    ambulance = parked(-60.0, y, Role.SCENARIO, BLUE, speed=16.0)
    road = Street(expert_on(town, y, 590.0), [ambulance], speed=8.0, y=y).drive(25.0)
    assert road.closest > 0.3
    assert ambulance.at(road.time)[0] > road.x + 30.0
    assert road.y == pytest.approx(y, abs=0.2), "back on its lane"


def test_no_way_is_made_for_a_car_without_them() -> None:
    town = worlds.two_lanes(600.0)
    y = two_lane_y(town, 1)
    faster = parked(-40.0, y, Role.SCENARIO, 0, speed=9.0)
    road = Street(expert_on(town, y, 590.0), [faster], speed=8.0, y=y).drive(8.0)
    assert max(abs(offset) for offset in road.offsets) < 0.1


def test_room_is_left_to_who_comes_over_the_line() -> None:
    invaders = [Other(100.0 + 40.0 * k, -0.25 + 0.5, math.pi, 8.0, size=(4.5, 1.9, 1.5)) for k in range(4)]
    road = street(invaders).drive(20.0)
    assert road.closest > 0.1
    assert road.x > 120.0
    assert road.y == pytest.approx(LANE, abs=0.1)


def test_nobody_over_the_line_leaves_it_in_the_middle() -> None:
    road = street([Other(100.0 + 40.0 * k, -LANE, math.pi, 8.0) for k in range(4)]).drive(20.0)
    assert max(abs(road.offsets[0] - offset) for offset in road.offsets) < 0.05
    assert min(road.speeds) > 6.0


def test_walker_who_has_stood_for_long_is_passed() -> None:
    stands = parked(70.0, LANE, Role.SCENARIO, 0, kind=ActorClass.WALKER, size=(0.5, 0.5, 1.8))
    road = street([stands]).drive(60.0)
    assert road.closest > 0.3
    assert road.x > 100.0


def test_queue_that_stays_is_passed_late_and_traffic_never() -> None:
    def queue(role: Role) -> Street:
        return street([parked(70.0 + 7.0 * k, LANE, role, 0) for k in range(3)])

    assert queue(Role.SCENARIO).drive(20.0).speed == 0.0
    assert queue(Role.SCENARIO).drive(60.0).x > 110.0
    assert queue(Role.TRAFFIC).drive(60.0).speed == 0.0


@pytest.mark.parametrize("role", [Role.SCENARIO, Role.TRAFFIC])
def test_who_pulls_out_of_a_place_beside_the_lane_lets_others_by(role: Role) -> None:
    """It stands 2.4 m beside the lane; a car comes along that at full speed."""
    x = np.arange(5.0, 290.0)
    aside = LANE + 2.4 * np.clip((35.0 - x) / 15.0, 0.0, 1.0)
    points = np.stack([x, aside, 0.0 * x], axis=1)
    yaw = np.arctan2(np.gradient(aside), np.gradient(x))
    made = Expert(path_through(points, yaw, np.full(len(x), FOLLOW, np.int8)), worlds.straight(300.0))
    comes = parked(-35.0, LANE, role, 0, speed=14.0)
    road = Street(made, [comes], speed=0.0, x=10.0, y=LANE + 2.4).drive(12.0)
    assert road.closest > 0.3
    assert road.x > 40.0
    assert comes.at(road.time)[0] > road.x
