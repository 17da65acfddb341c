"""Giving way to a vehicle on call."""

from lavsim.types import RoadOption, VehicleLight
from tests import worlds
from tests.traffic.stage import Stage, minor_crossing

EAST = 3  # lane of `worlds.straight`
AMBULANCE = "vehicle.ford.ambulance"


def test_a_driver_moves_to_the_edge_stops_and_returns_once_it_is_past() -> None:
    stage = Stage(worlds.straight(500.0), [(EAST, 60.0)])
    stage.world.body[stage.fleet.row[0], 0] = 8.0
    call = stage.put(EAST, 20.0, speed=9.0, blueprint=AMBULANCE)
    stage.world.lights[call.row] = int(VehicleLight.SPECIAL1)
    stage.world.pose[call.row, 1] -= 2.2  # it drives over the middle
    row = stage.fleet.row[0]
    most, least = 0.0, 10.0
    for _ in range(240):
        stage.tick()
        most = max(most, stage.world.pose[row, 1] - 1.75)
        least = min(least, stage.speed())
    assert most > 0.4
    assert least < 0.5
    assert stage.contacts == 0
    stage.run(15.0)
    assert stage.world.pose[call.row, 0] > stage.world.pose[row, 0]
    assert abs(stage.world.pose[row, 1] - 1.75) < 0.1
    assert stage.speed() > 5.0


def test_nobody_moves_aside_for_one_that_is_not_on_call() -> None:
    stage = Stage(worlds.straight(500.0), [(EAST, 60.0)])
    call = stage.put(EAST, 20.0, speed=4.0, blueprint=AMBULANCE)
    stage.world.pose[call.row, 1] -= 2.2
    for _ in range(200):
        stage.tick()
        assert abs(stage.world.pose[stage.fleet.row[0], 1] - 1.75) < 0.1


def test_nobody_drives_into_a_junction_to_give_way() -> None:
    town = minor_crossing()
    west = Stage(town, []).lane_from(-60.0, 1.75)
    stage = Stage(town, [(west, town.lanes.length[west] - 40.0)])
    stage.choose(0, int(RoadOption.STRAIGHT))
    call = stage.put(west, town.lanes.length[west] - 75.0, speed=2.5, blueprint=AMBULANCE)
    stage.world.lights[call.row] = int(VehicleLight.SPECIAL1)
    stage.run(8.0)
    assert stage.fleet.lane[0] == west
