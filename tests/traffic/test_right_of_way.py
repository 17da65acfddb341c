"""Who waits for whom at a crossing whose streets from the south and the north have yield signs."""

import pytest

from lavsim.traffic.fleet import PATH_LANES
from lavsim.traffic.right_of_way import travel_time
from lavsim.types import RoadOption
from tests.traffic.stage import Stage, minor_crossing

STRAIGHT, LEFT, RIGHT = int(RoadOption.STRAIGHT), int(RoadOption.LEFT), int(RoadOption.RIGHT)


def ways_in(stage: Stage) -> dict[str, int]:
    return {
        "west": stage.lane_from(-60.0, 1.75),
        "east": stage.lane_from(60.0, -1.75),
        "south": stage.lane_from(1.75, 60.0),
        "north": stage.lane_from(-1.75, -60.0),
    }


def stage_with(*drivers: tuple[str, float, int]) -> Stage:
    """Background drivers by the arm they come from, how far they are from its end [m], and where they turn."""
    town = minor_crossing()
    probe = Stage(town, [])
    ways = ways_in(probe)
    stage = Stage(town, [(ways[arm], town.lanes.length[ways[arm]] - before) for arm, before, _ in drivers])
    for slot, (_arm, _before, turn) in enumerate(drivers):
        stage.choose(slot, turn)
    return stage


def entered(stage: Stage, slot: int = 0) -> bool:
    return bool(stage.town.lanes.junction[stage.fleet.lane[slot]] >= 0)


def seconds_until_in(stage: Stage, slot: int = 0, most: float = 60.0) -> float:
    """Time until a driver is in the junction [s]."""
    for tick in range(int(most * 20)):
        if entered(stage, slot):
            return tick / 20.0
        stage.tick()
    return most


def test_travel_time_is_that_of_constant_acceleration_up_to_the_top_speed() -> None:
    assert travel_time(16.0, 0.0, 2.0, 20.0) == pytest.approx(4.0)
    assert travel_time(26.0, 0.0, 2.0, 4.0) == pytest.approx(2.0 + 22.0 / 4.0)
    assert travel_time(-1.0, 3.0, 2.0, 4.0) == 0.0


def test_an_empty_crossing_holds_nobody_up() -> None:
    assert seconds_until_in(stage_with(("south", 30.0, STRAIGHT))) < 8.0


def test_the_minor_street_waits_for_a_background_car_on_the_major_one() -> None:
    stage = stage_with(("south", 12.0, STRAIGHT), ("west", 45.0, STRAIGHT))
    stage.world.body[stage.fleet.row[1], 0] = 9.0
    while not entered(stage, 1):
        stage.tick()
        assert not entered(stage, 0)
    stage.run(15.0)
    assert stage.contacts == 0


def test_the_minor_street_waits_for_the_ego_on_the_major_one() -> None:
    stage = stage_with(("south", 12.0, STRAIGHT))
    west = ways_in(stage)["west"]
    stage.put_ego(west, stage.town.lanes.length[west] - 55.0, speed=10.0)
    crossed = False
    for _ in range(170):
        stage.tick()
        crossed = crossed or stage.world.pose[0, 0] > 3.0
        assert crossed or not entered(stage), "it cut in front of the ego"
    assert crossed
    stage.run(8.0)
    assert entered(stage) or stage.fleet.lane[0] != ways_in(stage)["south"]
    assert stage.contacts == 0


def test_it_does_not_wait_for_an_ego_that_is_far_enough_away() -> None:
    stage = stage_with(("south", 12.0, STRAIGHT))
    west = ways_in(stage)["west"]
    stage.put_ego(west, 1.0, speed=5.0)
    assert seconds_until_in(stage) < 6.0


def test_it_does_not_wait_for_an_ego_that_drives_away() -> None:
    stage = stage_with(("south", 12.0, STRAIGHT))
    out = int(stage.town.nearest([[40.0, 1.75]]).lane[0])
    stage.put_ego(out, 20.0, speed=5.0)
    assert seconds_until_in(stage) < 6.0


def test_it_goes_at_last_when_the_ego_only_stands_there() -> None:
    stage = stage_with(("south", 12.0, STRAIGHT))
    west = ways_in(stage)["west"]
    stage.put_ego(west, stage.town.lanes.length[west] - 6.0)
    waited = seconds_until_in(stage)
    assert 3.0 < waited < 20.0


def test_a_left_turn_waits_for_oncoming_traffic_and_takes_a_gap() -> None:
    stage = stage_with(("west", 12.0, LEFT), ("east", 14.0, STRAIGHT))
    while not entered(stage, 1):
        stage.tick()
        assert not entered(stage, 0)
    assert seconds_until_in(stage, 0) < 10.0
    stage = stage_with(("west", 12.0, LEFT), ("east", 100.0, STRAIGHT))
    assert seconds_until_in(stage, 0) < 5.0


def test_a_right_turn_from_the_major_street_waits_for_nobody() -> None:
    assert seconds_until_in(stage_with(("west", 12.0, RIGHT), ("south", 12.0, STRAIGHT))) < 5.0


def test_four_at_once_all_get_across_without_a_contact() -> None:
    stage = stage_with(
        ("west", 15.0, LEFT), ("east", 15.0, LEFT), ("south", 15.0, LEFT), ("north", 15.0, LEFT)
    )  # fmt: skip
    stage.run(40.0)
    assert stage.contacts == 0
    assert all(stage.town.lanes.junction[lane] < 0 for lane in stage.fleet.lane)
    assert (stage.fleet.path[:, 0] < 0).all()
    assert stage.fleet.path.shape[1] == PATH_LANES


def test_nobody_enters_without_room_behind_the_junction() -> None:
    stage = stage_with(("west", 15.0, STRAIGHT))
    out = int(stage.town.nearest([[40.0, 1.75]]).lane[0])
    stage.put(out, 4.0)
    stage.run(15.0)
    assert not entered(stage)
    assert stage.speed() < 0.1
