"""Lane changes on a road of two lanes in one direction."""

import numpy as np
import pytest

from lavsim.types import Role, VehicleLight
from tests import worlds
from tests.traffic.stage import Stage

LEFT, RIGHT = 0, 1  # lanes of `worlds.two_lanes`


def test_who_follows_a_slow_vehicle_changes_over_in_three_to_five_seconds_with_its_indicator_on() -> None:
    stage = Stage(worlds.two_lanes(600.0), [(RIGHT, 40.0)])
    stage.put(RIGHT, 80.0, speed=3.0)
    stage.world.body[stage.fleet.row[0], 0] = 8.0
    lateral, blinking = [], 0
    for _ in range(400):
        stage.tick()
        lateral.append(stage.world.pose[stage.fleet.row[0], 1])
        blinking += bool(stage.world.lights[stage.fleet.row[0]] & VehicleLight.LEFT_BLINKER)
    assert stage.fleet.lane[0] == LEFT
    assert lateral[-1] == pytest.approx(1.75, abs=0.1)
    moving = np.flatnonzero((np.array(lateral) < 5.0) & (np.array(lateral) > 2.0))
    assert 1.0 < len(moving) / 20.0 < 5.0
    assert blinking / 20.0 > 2.5
    assert np.abs(np.diff(lateral)).max() / 0.05 < 2.2, "sideways speed [m/s]"
    assert stage.contacts == 0


def test_who_has_a_free_road_stays() -> None:
    stage = Stage(worlds.two_lanes(600.0), [(LEFT, 40.0), (RIGHT, 40.0)])
    stage.run(20.0)
    assert stage.fleet.lane.tolist() == [LEFT, RIGHT]


def test_nobody_changes_where_the_marks_forbid_it() -> None:
    stage = Stage(worlds.two_lanes(600.0, "none"), [(RIGHT, 40.0)])
    stage.put(RIGHT, 80.0, speed=3.0)
    stage.run(20.0)
    assert stage.fleet.lane[0] == RIGHT


def test_nobody_cuts_in_before_the_ego() -> None:
    stage = Stage(worlds.two_lanes(600.0), [(RIGHT, 40.0)])
    stage.put(RIGHT, 75.0, speed=3.0)
    stage.put_ego(LEFT, 34.0, speed=9.0)
    stage.world.body[stage.fleet.row[0], 0] = 8.0
    for _ in range(400):
        stage.tick()
        ahead = stage.world.pose[stage.fleet.row[0], 0] - stage.world.pose[0, 0]
        if stage.fleet.lane[0] == LEFT:
            assert not 0.0 < ahead < 12.0
            break
    assert stage.contacts == 0


def test_a_broken_down_car_is_passed_in_the_other_lane_even_from_a_standstill() -> None:
    stage = Stage(worlds.two_lanes(300.0), [(RIGHT, 40.0)])
    stage.put(RIGHT, 56.0, role=Role.PARKED)
    stage.run(25.0)
    assert stage.world.pose[stage.fleet.row[0], 0] > 100.0
    assert stage.contacts == 0


@pytest.mark.parametrize("bend", [0.0, 30.0])
@pytest.mark.parametrize("start", [95.0, 97.0])
def test_who_swings_out_close_behind_a_standing_car_stays_behind_it_also_before_a_bend(
    bend: float, start: float
) -> None:
    """Where a bend is still to come, both lanes have the same length behind them but another share of the whole."""
    stage = Stage(worlds.two_lanes(190.0, bend=bend), [(LEFT, 110.0), (LEFT, start)])
    stands, follows = stage.fleet.row
    stage.world.body[follows, 0] = 6.0
    for _ in range(200):
        stage.world.touched[stands] = stage.world.tick  # it brakes as after a contact
        stage.tick()
    assert stage.fleet.lane[1] == RIGHT
    assert stage.contacts == 0
    assert stage.world.pose[stands, 0] - stage.world.pose[follows, 0] > 5.5


def test_who_begins_to_change_further_back_gets_past_a_standing_car_before_a_bend() -> None:
    stage = Stage(worlds.two_lanes(190.0, bend=30.0), [(LEFT, 110.0), (LEFT, 84.0)])
    stands, follows = stage.fleet.row
    stage.world.body[follows, 0] = 4.0
    for _ in range(200):
        stage.world.touched[stands] = stage.world.tick
        stage.tick()
    assert stage.world.pose[follows, 0] - stage.world.pose[stands, 0] > 10.0
    assert stage.contacts == 0


@pytest.mark.parametrize("border", [99.0, 101.0, 103.0, 106.0, 108.0, 110.5])
def test_who_swings_out_close_behind_a_standing_car_stays_behind_it_also_where_a_section_begins(border: float) -> None:
    town = worlds.two_lanes(190.0, sections=(0.0, border))
    lane, u = (LEFT, 110.0) if border > 110.0 else (LEFT + 2, 110.0 - border)
    stage = Stage(town, [(lane, u), (LEFT, 97.0)])
    stands, follows = stage.fleet.row
    stage.world.body[follows, 0] = 6.0
    for _ in range(200):
        stage.world.touched[stands] = stage.world.tick
        stage.tick()
    assert stage.contacts == 0
    assert stage.world.pose[stands, 0] - stage.world.pose[follows, 0] > 5.5
