"""LAV's frames against the formulas of its code (reference `lav.md` 1.1, 3.3)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.lav.frames import (
    command_of,
    ego_from_own,
    option_of,
    own_from_ego,
    planner_from_stored,
    planner_from_vehicle,
    planner_from_world,
    vehicle_from_planner,
    world_from_planner,
)
from lavsim.geometry import to_local
from lavsim.types import RoadOption

metres, angles = st.floats(-100.0, 100.0), st.floats(-math.pi, math.pi)


def test_the_planner_frame_is_right_and_backward() -> None:
    assert planner_from_vehicle([[10.0, 2.0]]).tolist() == [[2.0, -10.0]]
    # A BEV pixel: col = 160 + 4 x, row = 280 + 4 y; 10 m ahead lies 40 rows higher.
    x, y = planner_from_vehicle([10.0, 2.0])
    assert (160 + 4 * x, 280 + 4 * y) == (168.0, 240.0)


@given(metres, metres, angles)
def test_world_points_follow_the_formulas_of_lav(dx: float, dy: float, o: float) -> None:
    left = dx * math.sin(o) - dy * math.cos(o)
    forward = dx * math.cos(o) + dy * math.sin(o)
    origin, point = np.array([5.0, -7.0]), np.array([5.0 + dx, -7.0 + dy])
    found = planner_from_world(point, origin, o)
    assert found == pytest.approx((-left, -forward), abs=1e-9)
    assert found == pytest.approx(planner_from_stored((left, forward)), abs=1e-9)
    assert found == pytest.approx(planner_from_vehicle(to_local(point, origin, o)), abs=1e-9)
    assert world_from_planner(found, origin, o) == pytest.approx(point, abs=1e-9)


@given(metres, metres, angles, metres, metres, angles, angles)
def test_own_frames_turn_by_relative_headings(
    x: float, y: float, yaw: float, px: float, py: float, ego_yaw: float, own_yaw: float
) -> None:
    """R(-heading)(p - p0) of planner points is what the vehicle itself sees, in its own planner frame."""
    place, heading = planner_from_world((x, y), (0.0, 0.0), ego_yaw), own_yaw - ego_yaw
    point = planner_from_world((px, py), (0.0, 0.0), ego_yaw)
    own = own_from_ego(point, place, heading)
    assert own == pytest.approx(planner_from_world((px, py), (x, y), own_yaw), abs=1e-9)
    c, s = math.cos(heading), math.sin(heading)
    assert own == pytest.approx(np.array([[c, s], [-s, c]]) @ (point - place), abs=1e-9)
    assert ego_from_own(own, place, heading) == pytest.approx(point, abs=1e-9)


@given(metres, metres)
def test_the_vehicle_frame_comes_back(ahead: float, right: float) -> None:
    assert vehicle_from_planner(planner_from_vehicle((ahead, right))).tolist() == [ahead, right]


def test_commands_count_from_left() -> None:
    options = [RoadOption.LEFT, RoadOption.RIGHT, RoadOption.STRAIGHT, RoadOption.LANEFOLLOW,
               RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT]  # fmt: skip
    assert [command_of(option) for option in options] == list(range(6))
    assert [option_of(command) for command in range(6)] == options
    assert command_of(RoadOption.VOID) == 3
