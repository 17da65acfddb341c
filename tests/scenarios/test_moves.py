"""Followers and flows keep to their line, brake where told to, and vanish at its end."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from lavsim.geometry import right
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves.cross import meets_parked, ride
from lavsim.scenarios.moves.flow import ActorFlow
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.moves.lead import lead
from lavsim.scenarios.moves.opposing import oncoming_line
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.wait import first_of, in_turn, seconds, together, until
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, along_lane, line_ahead
from lavsim.simulation import Simulation
from lavsim.types import DT, Control, Role
from lavsim.world.blueprints import find_blueprint
from tests.drives import hazard, straight_drive

STAND = Control(brake=1.0)


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


class Tried(Scenario):
    """Runs whatever the test wants."""

    Config = Nothing
    wanted: Callable[[Scenario, Stage], Script]

    def fits(self, site: Site) -> str | None:
        return None

    def place(self, stage: Stage) -> None:
        """Nothing."""

    def script(self, stage: Stage) -> Script:
        return type(self).wanted(self, stage)


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Route files may name it as long as a test of this file runs."""
    assert ("2.x", "DynamicObjectCrossing") in SCENARIOS
    monkeypatch.setitem(SCENARIOS._entries, ("2.x", "Tried"), Tried)


def try_out(script: Callable[[Scenario, Stage], Script], ticks: int) -> Simulation:
    """A drive whose ego stands at the start of a straight lane, where the hazard runs `script`."""
    Tried.wanted = staticmethod(script)
    simulation = Simulation(straight_drive(scenarios=(hazard("Tried", 0),)))
    for _ in range(ticks):
        simulation.tick(STAND)
    return simulation


def test_a_follower_keeps_to_its_lane_at_its_speed_and_stops_at_the_end() -> None:
    seen: list[tuple[float, float, float]] = []

    def script(scenario: Scenario, stage: Stage) -> Script:
        start, _ = along_lane(stage.anchor, 20.0)
        car = lead(scenario, stage, "vehicle.audi.tt", start, 8.0, length=60.0)
        while not car.finished:
            car.step()
            yield
            hit = stage.town.nearest(car.actor.xy)
            seen.append((float(hit.offset[0]), car.actor.speed, car.travelled))
        assert car.line.length == pytest.approx(60.0, abs=1.0)

    try_out(script, 250)
    offset, speed, travelled = np.array(seen).T
    assert np.abs(offset).max() < 0.1
    assert speed.max() == pytest.approx(8.0, abs=0.01)
    assert travelled[-1] == pytest.approx(60.0, abs=1.2)


def test_a_follower_that_keeps_its_distance_stops_behind_what_stands_and_others_do_not() -> None:
    gaps: dict[bool, float] = {}

    def script(scenario: Scenario, stage: Stage, keeps: bool) -> Script:
        start, _ = along_lane(stage.anchor, 20.0)
        wall, _ = along_lane(stage.anchor, 70.0)
        parked = park(scenario, stage, "vehicle.audi.tt", wall)
        car = lead(scenario, stage, "vehicle.audi.tt", start, 12.0, keeps_distance=keeps)
        for _ in range(200):
            car.step()
            yield
        gaps[keeps] = stage.world.distance(car.actor, parked)

    for keeps in (True, False):
        try_out(partial(script, keeps=keeps), 210)
    assert 1.5 < gaps[True] < 5.0
    assert gaps[False] < 0.5


@pytest.mark.parametrize("blocked", [True, False])
def test_a_crossing_is_given_up_before_what_does_not_move_and_ends_elsewhere(blocked: bool) -> None:
    """A bicycle that pushed on into a standing queue kept the road shut for the rest of the drive."""
    ends: list[tuple[float, float]] = []

    def script(scenario: Scenario, stage: Stage) -> Script:
        start, _ = along_lane(stage.anchor, 20.0)
        wall, _ = along_lane(stage.anchor, 30.0)
        if blocked:
            park(scenario, stage, "vehicle.carlamotors.carlacola", wall)
        bicycle = scenario.spawn(stage, "vehicle.bh.crossbike", start.xyz, start.yaw, Role.SCENARIO)
        begun, ticks = bicycle.xy, 0
        for _ in ride(bicycle, 5.0, 25.0):
            ticks += 1
            yield
        ends.append((ticks * DT, float(np.hypot(*(bicycle.xy - begun)))))
        yield

    try_out(script, 400)
    seconds_taken, metres = ends[0]
    assert (10.0 < seconds_taken < 16.0) if blocked else (5.0 < seconds_taken < 6.0)
    assert (metres < 12.0) if blocked else metres == pytest.approx(25.0, abs=0.5)


@pytest.mark.parametrize(("role", "brakes"), [(Role.TRAFFIC, True), (Role.EGO, False)])
def test_a_rider_brakes_before_a_queue_but_not_for_the_ego(role: Role, brakes: bool) -> None:
    speeds: list[float] = []

    def script(scenario: Scenario, stage: Stage) -> Script:
        start, _ = along_lane(stage.anchor, 20.0)
        wall, _ = along_lane(stage.anchor, 36.0)
        stands = scenario.spawn(stage, "vehicle.audi.tt", wall.xyz, wall.yaw, role)
        bicycle = scenario.spawn(stage, "vehicle.bh.crossbike", start.xyz, start.yaw, Role.SCENARIO)
        for _ in first_of(ride(bicycle, 5.0, 25.0), seconds(6.0)):
            speeds.append(bicycle.speed)
            if stage.world.distance(bicycle, stands) < 0.05:
                break
            yield
        yield

    try_out(script, 200)
    slowest = max(before - after for before, after in pairwise(speeds)) / DT
    assert (slowest < 5.0 and speeds[-1] < 0.3) if brakes else speeds[-2] > 4.0


@pytest.mark.parametrize(
    ("ahead", "aside", "role", "met"),
    [
        (5.0, 0.0, Role.PARKED, True),
        (5.0, 2.4, Role.PARKED, True),  # the car stands across the way: half its length and half a walker's room
        (5.0, 3.2, Role.PARKED, False),
        (12.0, 0.0, Role.PARKED, False),  # beyond the end
        (-3.0, 0.0, Role.PARKED, False),
        (5.0, 0.0, Role.TRAFFIC, False),  # it moves, or the walker waits for it
    ],
)
def test_a_parked_car_is_met_where_it_stands_in_the_way(ahead: float, aside: float, role: Role, met: bool) -> None:
    world = Simulation(straight_drive())._world
    start = world.ego.xy + np.array([0.0, 40.0])
    car = find_blueprint("vehicle.audi.tt")
    place = np.array([start[0] + aside, start[1] + ahead, 0.0])
    world.spawn(999, car, place, 0.0, role)
    assert meets_parked(world, start, np.array([0.0, 1.0]), 10.0) == met


@pytest.mark.parametrize("offset", [3.5, -3.5])
def test_a_shift_ends_at_its_offset_and_straight(offset: float) -> None:
    state: list[tuple[float, float]] = []

    def script(scenario: Scenario, stage: Stage) -> Script:
        car = lead(scenario, stage, "vehicle.audi.tt", along_lane(stage.anchor, 15.0)[0], 10.0)
        car.actor.launch(10.0)
        yield from first_of(car.run(), seconds(1.0))
        car.shift(offset, 2.5)
        yield from first_of(car.run(), seconds(5.0))
        aside = (car.actor.xy - stage.anchor.xy) @ right(stage.anchor.yaw)
        state.append((float(aside), car.actor.yaw - stage.anchor.yaw))

    try_out(script, 150)
    aside, turn = state[0]
    assert aside == pytest.approx(offset, abs=0.15)
    assert np.cos(turn) > 0.999


def test_a_flow_comes_in_gaps_of_its_interval_and_goes_at_the_sink() -> None:
    gaps, most, come = [], [], []

    def script(scenario: Scenario, stage: Stage) -> Script:
        line = oncoming_line(along_lane(stage.anchor, 10.0)[0], ahead=80.0, behind=5.0)
        assert line is not None
        flow = ActorFlow(scenario, stage, line, 10.0, Interval(15.0, 25.0))
        for _ in range(400):
            flow.step()
            yield
            at = np.sort([float(np.hypot(*(actor.xy - line[0]))) for actor in flow.actors])
            gaps.extend(np.diff(at).tolist())
            most.append(len(flow))
        come.append(flow.come)

    simulation = try_out(script, 402)
    assert min(gaps) > 14.0
    assert max(gaps) < 27.0
    assert 3 <= max(most) <= 7
    assert come[0] >= 8
    assert len(simulation.snapshot.rows) == 1, "all are gone when the script ends"


def test_a_prefilled_flow_is_there_at_once() -> None:
    def script(scenario: Scenario, stage: Stage) -> Script:
        line = line_ahead(along_lane(stage.anchor, 20.0)[0], 100.0)
        flow = ActorFlow(scenario, stage, line, 5.0, Interval(20.0, 20.0), prefilled=True)
        assert len(flow) == 5
        yield from first_of(flow.run(), seconds(0.2))
        assert all(actor.speed > 4.0 for actor in flow.actors)

    try_out(script, 10)


def test_scripts_run_side_by_side_and_in_turn() -> None:
    done: list[str] = []

    def note(name: str, ticks: int) -> Script:
        yield from seconds(0.05 * ticks)
        done.append(name)

    list(together(note("a", 3), note("b", 1)))
    assert done == ["b", "a"]
    assert len(list(first_of(seconds(1.0), seconds(0.5)))) == 10
    assert len(list(in_turn(seconds(0.2), seconds(0.1)))) == 6
    assert list(until(lambda: True)) == []


def test_a_follower_takes_the_lane_it_is_on_from_where_it_is() -> None:
    def script(scenario: Scenario, stage: Stage) -> Script:
        line = line_ahead(stage.anchor, 100.0)
        actor = park(scenario, stage, "vehicle.audi.tt", along_lane(stage.anchor, 30.0)[0], moves=True)
        car = LaneFollower(stage, actor, line, 5.0)
        assert car.travelled == pytest.approx(30.0, abs=0.5)
        yield

    try_out(script, 2)
