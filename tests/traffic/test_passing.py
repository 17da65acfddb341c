"""Passing on a road of one lane a side with a broken centre line."""

import numpy as np
import pytest

from lavsim.types import LightState, Role
from tests import worlds
from tests.traffic.stage import Stage

EAST, WEST = 3, 2  # lanes of `worlds.straight`


def passing(oncoming: tuple[float, float] | None = None, seconds: float = 30.0) -> tuple[Stage, list[float]]:
    """A driver behind a car that stands for good; another may come towards it, from x [m] at a speed [m/s]."""
    stage = Stage(worlds.straight(400.0), [(EAST, 60.0)])
    stage.put(EAST, 120.0, role=Role.PARKED)
    if oncoming is not None:
        stage.put(WEST, 400.0 - oncoming[0], speed=oncoming[1])
    lateral = []
    for _ in range(int(seconds * 20)):
        stage.tick()
        lateral.append(float(stage.world.pose[stage.fleet.row[0], 1]))
    return stage, lateral


def x_of(stage: Stage) -> float:
    return float(stage.world.pose[stage.fleet.row[0], 0])


def test_what_stands_in_the_lane_is_passed_over_the_broken_line() -> None:
    stage, lateral = passing()
    assert stage.contacts == 0
    assert x_of(stage) > 150.0
    assert min(lateral) < -0.5, "it went around"
    assert abs(lateral[-1] - 1.75) < 0.1, "and back"


def test_it_waits_while_somebody_comes_the_other_way() -> None:
    stage, _lateral = passing(oncoming=(190.0, 4.0), seconds=12.0)
    assert x_of(stage) < 118.0
    assert stage.contacts == 0
    stage.run(40.0)
    assert x_of(stage) > 150.0, "and goes once the other is past"
    assert stage.contacts == 0


def test_nobody_passes_a_queue_of_background_cars() -> None:
    stage = Stage(worlds.straight(200.0), [(EAST, 60.0), (EAST, 40.0)])  # the road ends: the first one stops there
    lateral = []
    for _ in range(900):
        stage.tick()
        lateral.append(np.abs(stage.world.pose[stage.fleet.row, 1] - 1.75).max())
    assert max(lateral) < 0.2


def test_a_car_that_reaches_only_a_little_into_the_lane_is_passed_inside_it() -> None:
    stage = Stage(worlds.straight(300.0), [(EAST, 40.0)])
    car = stage.put(EAST, 90.0, role=Role.PARKED)
    stage.world.pose[car.row, 1] += 2.55  # its side 0.26 m in the way
    stage.run(30.0)
    assert x_of(stage) > 120.0
    assert stage.contacts == 0


def behind_a_guest(gap: float, first: bool) -> tuple[Stage, float, float]:
    """A driver that comes up behind a guest which has stood for half a minute, before a red light.

    Args:
        gap: From the light's lane end to the guest's centre [m].
        first: Whether a background car waits at the light, ahead of the guest.

    Returns:
        The stage, how far the driver swung out and how far ahead of the guest it came [m].
    """
    town = worlds.crossing(arm=520.0)
    stage = Stage(town, [])
    lane = stage.lane_from(-250.0, 1.75)
    end = float(town.lanes.length[lane])
    cars = [(lane, 20.0)] + ([(lane, end - gap + 14.0)] if first else [])
    stage = Stage(town, cars)
    # As in CARLA's towns, whose centre lines are broken up to the junction; ours are not.
    opposite = next(k for k in range(len(town.lanes)) if town.lanes.road_id[k] == town.lanes.road_id[lane]
                    and town.lanes.lane_id[k] == -town.lanes.lane_id[lane])  # fmt: skip
    stage.traffic._lanes.opposite[[lane, opposite]] = opposite, lane
    stage.lights[:] = LightState.RED
    guest = stage.put(lane, end - gap)
    swing, ahead = 0.0, -np.inf
    for _ in range(20 * 90):
        stage.tick()
        x, y = stage.world.pose[stage.fleet.row[0], :2]
        swing, ahead = max(swing, abs(float(y - guest.xy[1]))), max(ahead, float(x - guest.xy[0]))
    return stage, swing, ahead


def test_a_guest_that_has_broken_down_is_passed() -> None:
    stage, swing, ahead = behind_a_guest(120.0, first=False)
    assert swing > 1.5
    assert ahead > 20.0
    assert stage.contacts == 0


@pytest.mark.parametrize(("gap", "first"), [(8.0, False), (23.0, True)])
def test_a_guest_that_waits_at_a_red_light_is_not_passed(gap: float, first: bool) -> None:
    _stage, swing, ahead = behind_a_guest(gap, first)
    assert swing < 0.3
    assert ahead < -5.0


def test_who_has_come_too_near_does_not_swing_out() -> None:
    stage = Stage(worlds.straight(400.0), [(EAST, 80.0)])
    guest = stage.put(EAST, 120.0)
    stage.run(60.0)
    assert stage.contacts == 0
    assert x_of(stage) < float(guest.xy[0])


@pytest.mark.parametrize(("prop", "held"), [("static.prop.dirtdebris01", False), ("static.prop.streetbarrier", True)])
def test_debris_is_driven_over_and_a_barrier_is_not(prop: str, held: bool) -> None:
    stage = Stage(worlds.straight(300.0), [(EAST, 40.0)])
    stage.put(EAST, 120.0, blueprint=prop, role=Role.PROP)
    stage.put(WEST, 175.0)  # nobody could pass over there
    stage.run(25.0)
    assert (x_of(stage) < 120.0) == held
    assert stage.contacts == 0
