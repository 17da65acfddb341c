"""Deadlocks: circles of drivers that wait for each other, and the last resort."""

import numpy as np

from lavsim.traffic.deadlock import LOOK_EVERY, find_deadlocks
from lavsim.traffic.fleet import NOBODY, RED_LIGHT, make_fleet
from lavsim.traffic.network import lanes_of
from lavsim.types import Role
from tests import worlds
from tests.traffic.stage import FAR, Stage, minor_crossing

EAST = 3


def verdict(still: list[int], blame: list[int]) -> tuple[int, list[int]]:
    """Slots taken out, and who is given the right to go, for drivers in rows 1, 2, … that wait for rows."""
    fleet = make_fleet(len(still))
    fleet.row[:] = 1 + np.arange(len(still))
    fleet.lane[:] = EAST
    fleet.still[:], fleet.stuck[:], fleet.blame[:] = still, still, blame
    slots = np.append(-1, np.arange(len(still) + 1)).astype(np.int32)
    slots[-1] = -1  # the last row is nobody's
    out = find_deadlocks(lanes_of(worlds.straight(200.0)), fleet, slots, 0)
    return out, np.flatnonzero(fleet.granted > 0).tolist()


def test_a_circle_is_broken_by_giving_one_the_right_to_go() -> None:
    out, granted = verdict([300, 300, 300], [2, 3, 1])
    assert out == -1
    assert len(granted) > 0


def test_a_queue_before_a_red_light_is_no_deadlock() -> None:
    assert verdict([3000, 3000, 3000], [2, 3, RED_LIGHT]) == (-1, [])


def test_a_queue_whose_head_moves_is_no_deadlock() -> None:
    assert verdict([3000, 0], [2, NOBODY]) == (-1, [])


def test_who_has_stood_longest_without_a_reason_is_taken_out() -> None:
    assert verdict([1900, 2000], [2, NOBODY])[0] == 1
    assert verdict([1700, 1700], [2, NOBODY])[0] == -1


def test_time_at_a_red_light_does_not_count() -> None:
    fleet = make_fleet(1)
    fleet.row[:], fleet.lane[:] = 1, EAST
    slots = np.array([-1, 0], np.int32)
    lanes = lanes_of(worlds.straight(200.0))
    for tick in range(0, 4000, LOOK_EVERY):
        fleet.still[:] = tick
        fleet.blame[:] = RED_LIGHT if tick % 1000 < 600 else NOBODY
        assert find_deadlocks(lanes, fleet, slots, tick) == -1


def test_waiting_for_the_ego_is_borne_for_longer() -> None:
    assert verdict([2000], [2])[0] == -1
    assert verdict([4000], [2])[0] == 0


def test_a_driver_that_is_walled_in_vanishes_and_another_appears_elsewhere_with_a_new_id() -> None:
    town = minor_crossing()
    west = Stage(town, []).lane_from(-60.0, 1.75)
    stage = Stage(town, [(west, 30.0)])
    stage.traffic._places = np.array([[west, 30.0], [Stage(town, []).lane_from(60.0, -1.75), 40.0]])
    for side in (-1.9, 1.9, 0.0):
        wall = stage.put(west, 42.0, blueprint="static.prop.container", role=Role.PROP)
        stage.world.pose[wall.row, 1] += side
    stage.run(60.0)
    assert stage.traffic.dissolved == 0
    before = stage.fleet.row[0]
    stage.run(140.0)
    assert stage.traffic.dissolved == 1
    assert stage.fleet.row[0] != before
    assert stage.world.table.ids[stage.fleet.row[0]] == 1001
    assert not stage.world.present[before]
    assert len(stage.traffic) == 1
    assert np.hypot(*(stage.world.pose[0, :2] - FAR)) < 1.0
