"""Traffic lights cycle after CARLA's rule, and do what a hazard tells them."""

import numpy as np
import pytest

from lavsim.errors import ConfigError
from lavsim.map.signal import LightGroup
from lavsim.map.town_files import load_town
from lavsim.types import DT, LightState
from lavsim.world.lights import LightCycle, TrafficLights

RED, YELLOW, GREEN = LightState.RED, LightState.YELLOW, LightState.GREEN
THREE_PHASES = LightGroup(0, ((0,), (1, 2), (3,)))


def test_phases_run_one_after_another() -> None:
    lights = TrafficLights(4, [THREE_PHASES])
    assert lights.states(0.0).tolist() == [GREEN, RED, RED, RED]
    assert lights.states(9.95).tolist() == [GREEN, RED, RED, RED]
    assert lights.states(10.0).tolist() == [YELLOW, RED, RED, RED]
    assert lights.states(13.0).tolist() == [RED, RED, RED, RED]
    assert lights.states(15.0).tolist() == [RED, GREEN, GREEN, RED]
    assert lights.states(30.0).tolist() == [RED, RED, RED, GREEN]
    assert lights.states(45.0).tolist() == lights.states(0.0).tolist()


def test_a_light_of_no_group_has_ten_seconds_of_red() -> None:
    lights = TrafficLights(2, [LightGroup(0, ((0,),))])
    assert [int(lights.states(t)[1]) for t in (0.0, 9.95, 10.0, 13.0, 22.95, 23.0)] == [
        GREEN, GREEN, YELLOW, RED, RED, GREEN
    ]  # fmt: skip
    assert [int(lights.states(t)[0]) for t in (0.0, 10.0, 13.0, 15.0)] == [GREEN, YELLOW, RED, GREEN]


def test_durations_can_be_set_and_are_checked() -> None:
    lights = TrafficLights(4, [THREE_PHASES], LightCycle(4.0, 1.0, 0.5))
    assert lights.states(3.95)[0] == GREEN
    assert lights.states(4.0)[0] == YELLOW
    assert lights.states(5.0).tolist() == [RED] * 4
    assert lights.states(5.5)[1] == GREEN
    with pytest.raises(ConfigError, match=r"light_cycle.yellow must lie in 0 to 3600 \[s\], got -1"):
        LightCycle(yellow=-1.0)
    with pytest.raises(ConfigError, match="at least one tick"):
        LightCycle(0.0, 0.0, 0.0)


def test_states_depend_on_the_tick_alone() -> None:
    forward, backward = TrafficLights(4, [THREE_PHASES]), TrafficLights(4, [THREE_PHASES])
    ticks = range(0, 1900, 7)
    ahead = {t: forward.states(t * DT).tolist() for t in ticks}
    assert {t: backward.states(t * DT).tolist() for t in reversed(ticks)} == ahead
    for states in ahead.values():
        assert sum(state != RED for state in (states[0], states[1], states[3])) <= 1


def test_the_array_is_shared_until_a_light_changes_and_cannot_be_written() -> None:
    lights = TrafficLights(4, [THREE_PHASES])
    first = lights.states(1.0)
    assert lights.states(9.95) is first
    assert lights.states(10.0) is not first
    assert first.tolist() == [GREEN, RED, RED, RED]
    with pytest.raises(ValueError, match="read-only"):
        first[0] = RED


def test_a_held_light_stays_while_its_group_runs_on() -> None:
    lights = TrafficLights(4, [THREE_PHASES])
    lights.hold(3, GREEN)
    assert lights.states(15.0).tolist() == [RED, GREEN, GREEN, GREEN]
    lights.release(3)
    assert lights.states(15.0).tolist() == [RED, GREEN, GREEN, RED]


def test_a_junction_shows_what_it_is_told_and_goes_on_where_it_was() -> None:
    lights = TrafficLights(5, [THREE_PHASES, LightGroup(1, ((4,),))])
    lights.hold_junction(1, 8.0)
    assert lights.states(8.0).tolist() == [RED, RED, RED, RED, GREEN]
    assert lights.states(10.0).tolist() == [RED, RED, RED, RED, YELLOW]  # the other junction runs on
    lights.hold_junction(1, 20.0, greens=(3,))
    assert lights.states(20.0)[:4].tolist() == [RED, RED, RED, GREEN]
    lights.release_junction(1, 30.0)
    assert lights.states(30.0)[:4].tolist() == [GREEN, RED, RED, RED]
    assert lights.states(31.95)[0] == GREEN
    assert lights.states(32.0)[0] == YELLOW  # two seconds of its green were left at 8 s


def test_a_frozen_junction_keeps_its_states() -> None:
    lights = TrafficLights(4, [THREE_PHASES])
    lights.freeze_junction(0, 11.0)
    assert lights.states(500.0).tolist() == [YELLOW, RED, RED, RED]
    lights.freeze_junction(0, 600.0)  # once more changes nothing
    lights.release_junction(0, 700.0)
    assert lights.states(701.95)[0] == YELLOW
    assert lights.states(702.0)[0] == RED


def test_in_a_town_one_phase_of_each_junction_runs() -> None:
    town = load_town("us_large_a")
    lights = TrafficLights(len(town.lights), town.light_groups)
    seen = np.zeros(len(town.lights), bool)
    for second in range(120):
        states = lights.states(float(second))
        seen |= states == GREEN
        for group in town.light_groups:
            assert sum(any(states[list(phase)] != RED) for phase in group.phases) <= 1
    assert seen.all()
