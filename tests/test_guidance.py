"""Command and goal by GNSS: LAV's rules, on plans drawn on paper."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from lavsim.geometry import EARTH_RADIUS, geolocation
from lavsim.guidance import Guide
from lavsim.types import RoadOption

FOLLOW, LEFT, RIGHT = RoadOption.LANEFOLLOW, RoadOption.LEFT, RoadOption.RIGHT
NORTH, EAST = 0.0, math.pi / 2.0  # compass


def gps(*points: tuple[float, float]) -> NDArray[np.float64]:
    """Latitudes and longitudes of world points [m] near the equator."""
    x, y = np.array(points, np.float64).T
    return np.stack(geolocation(x, y), axis=1)


def test_a_turn_is_reached_from_farther_than_the_way_on() -> None:
    for distance, command in ((4.4, LEFT), (4.6, FOLLOW)):
        guide = Guide(gps((0, 0), (50, 0), (100, 0)), [FOLLOW, LEFT, FOLLOW])
        guide.update(gps((50 - distance, 0))[0])
        assert guide.now(EAST).command == command
    for distance, command in ((2.9, FOLLOW), (3.1, LEFT)):
        guide = Guide(gps((0, 0), (50, 0), (100, 0)), [FOLLOW, LEFT, FOLLOW])
        for x in (50.0, 100.0 - distance):
            guide.update(gps((x, 0))[0])
        assert guide.now(EAST).command == command


def test_a_node_driven_past_beside_it_counts_as_reached() -> None:
    for y, command in ((5.0, LEFT), (10.5, FOLLOW)):
        guide = Guide(gps((0, 0), (50, 0), (100, 0)), [FOLLOW, LEFT, FOLLOW])
        for x in (49.0, 51.0):
            guide.update(gps((x, y))[0])
            assert guide.now(EAST).command == (command if x > 50.0 else FOLLOW)


def test_the_first_command_is_follow_whatever_the_plan_says() -> None:
    guide = Guide(gps((0, 0), (50, 0)), [RIGHT, FOLLOW])
    guide.update(gps((0, 0))[0])
    assert guide.now(EAST).command == FOLLOW


def test_the_goal_moves_on_when_near_unless_the_next_is_too_far() -> None:
    guide = Guide(gps((0, 0), (52, 0), (104, 0), (300, 0)), [FOLLOW] * 4)
    seen = []
    for x in (0.0, 31.0, 33.0, 85.0, 100.0):
        guide.update(gps((x, 0))[0])
        seen.append(guide.now(EAST).node)
    assert seen == [1, 1, 2, 2, 2]


def test_a_goal_that_lies_behind_is_no_goal_however_far_the_next_is() -> None:
    guide = Guide(gps((0, 0), (200, 0), (400, 0)), [FOLLOW] * 3)
    seen = []
    for x in (0.0, 1.0, 150.0, 190.0, 199.0, 201.0, 210.0):
        guide.update(gps((x, 0))[0])
        seen.append(guide.now(EAST).node)
    assert seen == [0, 1, 1, 1, 1, 2, 2]


@pytest.mark.parametrize(("compass", "goal"), [(NORTH, (40.0, 30.0)), (EAST, (30.0, -40.0)), (math.pi, (-40.0, -30.0))])
def test_goals_are_told_ahead_and_to_the_right(compass: float, goal: tuple[float, float]) -> None:
    guide = Guide(gps((0, 0), (30, -40), (30, -80)), [FOLLOW] * 3)
    guide.update(gps((0, 0))[0])
    now = guide.now(compass)
    assert now.goal == pytest.approx(goal, abs=1e-3)
    assert math.hypot(*now.next_goal) == pytest.approx(math.hypot(30, 80), abs=1e-3)


def test_metres_are_those_of_the_simulator_far_from_the_equator() -> None:
    lat, lon = 48.0, 11.0
    x, y = np.array([0.0, 50.0]), np.array([0.0, -20.0])
    plan = np.stack(geolocation(x, y, lat, lon), axis=1)
    guide = Guide(plan, [FOLLOW, FOLLOW])
    guide.update(plan[0])
    assert guide.now(NORTH).goal == pytest.approx((20.0, 50.0), abs=1e-2)
    assert EARTH_RADIUS == 6_378_137.0
