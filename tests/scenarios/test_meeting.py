"""When an ego that drives on is where, and who of a stream meets it or spares it."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from lavsim.map.town_files import load_town
from lavsim.scenarios.base import Scenario, Script, Stage
from lavsim.scenarios.moves import flow
from lavsim.scenarios.moves.flow import ActorFlow
from lavsim.scenarios.moves.indicators import indicators_along
from lavsim.scenarios.moves.junctions import ways_through
from lavsim.scenarios.moves.meeting import ego_time, phase_at
from lavsim.scenarios.moves.pursuit import STEP, line_of
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import join, kerb, line_ahead, line_behind
from lavsim.simulation import Simulation
from lavsim.types import ActorIds, Control, VehicleLight
from tests import worlds
from tests.drives import follow, hazard, straight_drive, straight_route
from tests.scenarios.test_moves import Tried, registered  # noqa: F401 - a fixture

STRAIGHT = np.column_stack([np.arange(0.0, 121.0), np.zeros(121)])


class Points(NamedTuple):
    """A route as far as it is asked for here."""

    distance: np.ndarray
    yaw: np.ndarray


def stage_on(line: np.ndarray, speed: float, to_junction: float = np.inf) -> SimpleNamespace:
    """An ego at the start of a route of points a metre apart."""
    distance = np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
    yaw = np.arctan2(*np.gradient(line, axis=0).T[::-1])
    return SimpleNamespace(
        route=Points(distance, yaw),
        progress=lambda: 0.0,
        site=SimpleNamespace(at=0.0, to_junction=to_junction),
        world=SimpleNamespace(ego=SimpleNamespace(speed=speed)),
    )


def turned(radius: float) -> np.ndarray:
    """50 m straight on, a quarter of a circle, 50 m straight on."""
    angle = np.arange(0.0, np.pi / 2.0, 1.0 / radius)
    bend = np.column_stack([50.0 + radius * np.sin(angle), radius * (1.0 - np.cos(angle))])
    way_out = np.column_stack([np.full(50, 50.0 + radius), radius + np.arange(0.0, 50.0)])
    return join(STRAIGHT[:50], bend, way_out)


def test_an_ego_on_a_straight_road_keeps_its_speed() -> None:
    assert ego_time(stage_on(STRAIGHT, 10.0), 80) == pytest.approx(8.0, abs=0.1)
    assert ego_time(stage_on(STRAIGHT, 0.0), 70) == pytest.approx(10.0, abs=0.1), "who starts is taken to drive 7 m/s"


def test_it_slows_for_a_bend_and_more_for_a_tighter_one() -> None:
    wide, tight = (ego_time(stage_on(turned(radius), 10.0), 60) for radius in (60.0, 10.0))
    assert wide == pytest.approx(6.0, abs=0.1)
    assert 7.5 < tight < 10.0


def test_it_waits_at_a_red_light_and_goes_on() -> None:
    stage = stage_on(STRAIGHT, 10.0, to_junction=50.0)
    speeding_up, at_speed = 5.0, 0.8  # [s] to 10 m/s with 2 m/s², and for the rest of the 33 m
    assert ego_time(stage, 80, red=20.0) == pytest.approx(20.6 + speeding_up + at_speed, abs=0.5)
    assert ego_time(stage, 40, red=20.0) < 8.0, "what lies before the light is reached while it is red"


def test_a_vehicle_is_as_far_away_as_it_drives_in_that_time() -> None:
    assert phase_at(STRAIGHT, 10.0, np.array([80.0, 0.0]), 5.0) == pytest.approx(30.0, abs=0.6)
    assert phase_at(STRAIGHT, 10.0, np.array([20.0, 0.0]), 5.0) == pytest.approx(-30.0, abs=0.6)


@pytest.mark.parametrize(("merged", "is_hit"), [(flow._MERGED, False), (10**9, True)])
def test_a_stream_spares_an_ego_that_has_long_been_before_it(
    merged: int, is_hit: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flow, "_MERGED", merged)

    def script(scenario: Scenario, stage: Stage) -> Script:
        line = join(line_behind(stage.anchor, 50.0), line_ahead(stage.anchor, 150.0))
        yield from ActorFlow(scenario, stage, line, 12.0, Interval(40.0, 40.0)).run()

    Tried.wanted = staticmethod(script)
    simulation = Simulation(straight_drive(scenarios=(hazard("Tried", 55),)))
    hits = 0
    for _ in range(500):
        snapshot = simulation.tick(follow(straight_route(), simulation.snapshot, 5.0))
        hits += int(np.count_nonzero(snapshot.contacts["b"] >= int(ActorIds.SCENARIOS)))
    assert (hits > 0) is is_hit


@pytest.mark.parametrize(("merged", "is_hit"), [(flow._MERGED, False), (10**9, True)])
def test_a_stream_that_brakes_softly_brakes_harder_for_who_has_merged(
    merged: int, is_hit: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With 1.5 m/s² alone it would run into an ego that stops before a red light."""
    monkeypatch.setattr(flow, "_MERGED", merged)

    def script(scenario: Scenario, stage: Stage) -> Script:
        line = join(line_behind(stage.anchor, 50.0), line_ahead(stage.anchor, 150.0))
        gap = Interval(40.0, 40.0)
        yield from ActorFlow(scenario, stage, line, 16.0, gap, keeps_distance=True, braking=1.5).run()

    Tried.wanted = staticmethod(script)
    simulation = Simulation(straight_drive(scenarios=(hazard("Tried", 55),)))
    hits = 0
    for tick in range(320):
        steer = follow(straight_route(), simulation.snapshot, 7.0)
        snapshot = simulation.tick(steer if tick < 290 else Control(brake=0.4))
        hits += int(np.count_nonzero(snapshot.contacts["b"] >= int(ActorIds.SCENARIOS)))
    assert (hits > 0) is is_hit


@pytest.mark.parametrize("light", [VehicleLight.LEFT_BLINKER, VehicleLight.RIGHT_BLINKER, VehicleLight.NONE])
def test_who_turns_at_a_junction_signals_from_before_it_to_its_end(light: VehicleLight) -> None:
    town = worlds.crossing(lights=False)
    turns = {VehicleLight.LEFT_BLINKER: -np.pi / 2.0, VehicleLight.RIGHT_BLINKER: np.pi / 2.0}
    way = min(ways_through(town, 0), key=lambda way: abs(way.turn - turns.get(light, 0.0)))
    line = line_of(way.path(60.0, 30.0))
    signals = indicators_along(town, line, 0.0)
    inside = STEP * (len(line_of(way.inner()).xy) - 1)
    expected = np.zeros(len(signals), np.int32)
    expected[round(30.0 / STEP) : round((60.0 + inside) / STEP)] = int(light)
    assert np.count_nonzero(signals != expected) <= 6, "a metre or two at either end"


def test_the_kerb_lies_beyond_a_median() -> None:
    """Two strips of a median whose sides swap: the way across ends at the other side's kerb."""
    town = load_town("us_large_c")
    lanes = np.flatnonzero((town.lanes.type == 2) & (town.lanes.junction < 0))
    reach = [kerb(town.waypoint_at(int(lane), 5.0), "left") for lane in lanes.tolist()]
    assert min(reach) > 1.0
    assert max(reach) < 40.0
