"""`--rules corrected`: each oddity of 1.0 that it mends, in pairs of what 1.0 says and what it says."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from lavsim.types import DT, LightState
from leaderboard.criteria.base import COMPLETED, Criterion, criteria_of
from leaderboard.criteria.blocked import Blocked
from leaderboard.criteria.completion import Completion
from leaderboard.criteria.corrected_blocked import CorrectedBlocked
from leaderboard.criteria.corrected_lanes import CorrectedLanes
from leaderboard.criteria.corrected_red_light import CorrectedRedLight
from leaderboard.criteria.corrected_stop_sign import CorrectedStopSign
from leaderboard.criteria.outside_route_lanes import OutsideRouteLanes
from leaderboard.criteria.red_light import RedLight
from leaderboard.criteria.stop_sign import StopSign
from leaderboard.record import Results
from leaderboard.rules import RULES
from leaderboard.score import status, summarise
from tests.leaderboard.test_collision import WALL, A, B, events
from tests.leaderboard.test_criteria import (
    HALF,
    LIGHT,
    STEPS,
    STOP_X,
    TWO_WAY,
    passing,
    stop_sign,
    stopping_at,
)
from tests.leaderboard.test_score import event, record
from tests.leaderboard.worlds import V1, StripTown, along, drive, ego_at, straight_route

OURS = RULES["corrected"]


def count(kind: type[Criterion], snapshots: list[Any], town: Any = None) -> int:
    rules = OURS if "corrected" in kind.applies else V1
    return len(drive(kind(rules), snapshots, town))


def test_corrected_criteria_take_the_place_of_the_originals() -> None:
    assert [c.name for c in criteria_of(OURS)] == [
        "route_timeout", "completion", "corrected_lanes", "corrected_collision", "corrected_red_light",
        "corrected_stop_sign", "route_deviation", "corrected_blocked",
    ]  # fmt: skip
    assert not any("corrected" in c.name for c in criteria_of(V1))


def test_the_end_is_said_in_the_tick_of_the_target() -> None:
    for rules, ending in ((V1, None), (OURS, COMPLETED)):
        criterion = Completion(rules)
        criterion.start(StripTown(), straight_route())
        last = None
        for snapshot in along(*STEPS, 100.4):
            criterion.update(snapshot)
            last = criterion.ending
            if criterion.reached:
                break
        assert criterion.reached
        assert last == ending


# ---------------------------------------------------------------- collisions


@pytest.mark.parametrize(
    ("contacts", "first", "ours"),
    [
        ([(float(t), float(t), A) for t in range(13)], {0, 6, 12}, {0}),  # pushing one car
        ([(0.0, 0.0, A), (5.1, 10.0, A)], {0, 1}, {0, 1}),  # hit again after it was left
        ([(0.0, 0.0, A), (4.9, 10.0, A)], {0}, {0}),
        ([(0.0, 0.0, A), (0.5, 1.0, B)], {0}, {0, 1}),  # a second one right beside
        ([(0.0, 0.0, A), (1.0, 6.0, B), (2.0, 12.0, A)], {0, 1, 2}, {0, 1}),  # A B A
        ([(0.0, 0.0, WALL), (0.3, 2.0, WALL), (0.6, 4.0, WALL), (0.9, 6.0, WALL)], {0, 2}, {0, 2}),
    ],
    ids=["pushed", "again", "too soon", "two at once", "A B A", "wall"],
)
def test_collisions_are_told_apart_by_actor(
    contacts: list[tuple[float, float, int]], first: set[int], ours: set[int]
) -> None:
    for rules, expected in ((V1, first), (OURS, ours)):
        assert {k for k, fired in enumerate(events(rules, contacts)) if fired} == expected


def test_an_ego_at_rest_is_not_at_fault() -> None:
    assert events(V1, [(1.0, 0.0, A)], speed=0.0) == [1]
    assert events(OURS, [(1.0, 0.0, A)], speed=0.0) == [0]
    assert events(OURS, [(1.0, 0.0, A)], speed=0.2) == [1]


# ---------------------------------------------------------------- red lights


def lights(kind: type[Criterion], snapshots: list[Any]) -> int:
    return count(kind, snapshots, StripTown(lights=[LIGHT, LIGHT]))


def turns_red_at(limit: float) -> Any:
    """Yellow until the ego's rear is at `limit`."""
    return lambda rear: LightState.RED if rear >= limit else LightState.YELLOW


def test_red_lights_are_judged_by_the_middle_of_the_ego() -> None:
    assert lights(CorrectedRedLight, passing(lambda rear: LightState.RED)) == 1
    assert lights(CorrectedRedLight, passing(lambda rear: LightState.YELLOW)) == 0
    over_on_yellow = passing(turns_red_at(STOP_X - 0.4))  # the rear alone is still over the line at red
    assert lights(RedLight, over_on_yellow) == 1
    assert lights(CorrectedRedLight, over_on_yellow) == 0
    just_red = passing(turns_red_at(STOP_X - HALF - 1.0))  # the middle is a metre before the line
    assert lights(CorrectedRedLight, just_red) == 1


def test_red_lights_need_lane_and_direction() -> None:
    def red(rear: float) -> LightState:
        return LightState.RED

    assert lights(CorrectedRedLight, passing(red, y=1.7)) == 1
    assert lights(CorrectedRedLight, passing(red, y=1.8)) == 0
    assert lights(CorrectedRedLight, passing(red)[::-1]) == 0


def test_the_same_red_light_is_charged_each_time() -> None:
    once = passing(lambda rear: LightState.RED)
    assert lights(RedLight, once + once) == 1
    assert lights(CorrectedRedLight, once + once) == 2


def test_standing_with_the_middle_on_the_line_is_one_crossing() -> None:
    xs = [STOP_X - 0.2, STOP_X, STOP_X, STOP_X, STOP_X + 0.2, STOP_X + 0.4]
    red = (LightState.RED, LightState.GREEN)
    assert lights(CorrectedRedLight, [ego_at(x, tick=k, lights=red) for k, x in enumerate(xs)]) == 1


# ---------------------------------------------------------------- stop signs


def signs(kind: type[Criterion], sign: Any, speeds: list[float] | None = None) -> int:
    snapshots = [ego_at(x, tick=k, speed=v) for k, (x, v) in enumerate(zip(STEPS, speeds or [8.0] * 251, strict=True))]
    return count(kind, snapshots, StripTown(signs=[sign]))


def test_stop_signs_are_entered_by_their_box_wherever_the_post_stands() -> None:
    for post, first in ((1.0, 1), (3.0, 0)):
        assert signs(StopSign, stop_sign(post=post)) == first
        assert signs(CorrectedStopSign, stop_sign(post=post)) == 1


def test_a_stop_counts_before_the_box_and_not_far_from_it() -> None:
    assert signs(CorrectedStopSign, stop_sign(), stopping_at(47.2)) == 0
    assert signs(CorrectedStopSign, stop_sign(), stopping_at(49.2)) == 0
    assert signs(StopSign, stop_sign(), stopping_at(35.0)) == 0
    assert signs(CorrectedStopSign, stop_sign(), stopping_at(35.0)) == 1


def test_boxes_are_turned_with_their_road() -> None:
    """A box 3 m long and 1 m wide that stands across the world's axes: the road is under its long side."""
    beside = stop_sign(post=0.9, trigger=(50.0, 0.9, math.pi / 2.0, 1.5, 0.5))
    assert signs(StopSign, beside) == 0
    assert signs(CorrectedStopSign, beside) == 1


# ---------------------------------------------------------------- lanes


def lanes(kind: type[Criterion], places: list[tuple[float, float]]) -> str:
    rules = OURS if "corrected" in kind.applies else V1
    criterion = kind(rules)
    criterion.start(StripTown(TWO_WAY), straight_route())
    flags = ""
    for k, (x, y) in enumerate(places):
        criterion.update(ego_at(x, y, tick=k))
        flags += "FT"[criterion._wrong_lane]  # type: ignore[attr-defined]
    return flags


def test_the_wrong_lane_is_wrong_as_long_as_the_ego_is_in_it() -> None:
    places = [(40.0, 0.0), (45.0, -3.5), (50.0, -3.5), (65.0, -3.5), (70.0, -3.5), (75.0, 0.0)]
    assert lanes(OutsideRouteLanes, places) == "FTTFFT"
    assert lanes(CorrectedLanes, places) == "FTTTTF"


def test_a_drive_that_begins_in_the_wrong_lane_is_seen() -> None:
    assert lanes(OutsideRouteLanes, [(10.0, -3.5), (20.0, -3.5)]) == "FF"
    assert lanes(CorrectedLanes, [(10.0, -3.5), (20.0, -3.5)]) == "TT"


# ---------------------------------------------------------------- blocked


def waiting(x: float, state: LightState, seconds: float, green_for: float = 0.0) -> list[Any]:
    """At rest at `x`; the light is `state`, but for its first `green_for` seconds."""
    snapshots = []
    for k in range(round(seconds / DT)):
        light = LightState.GREEN if k * DT < green_for else state
        snapshots.append((k, light))
    made = {light: ego_at(x, speed=0.0, lights=(light, LightState.GREEN)) for light in (state, LightState.GREEN)}
    return [replace(made[light], tick=k) for k, light in snapshots]


def test_waiting_at_a_red_light_is_not_being_blocked() -> None:
    for place, first, ours in ((STOP_X - 4.0, 1, 0), (STOP_X - 30.0, 1, 1)):
        town, red = StripTown(lights=[LIGHT, LIGHT]), waiting(place, LightState.RED, 200.0)
        assert count(Blocked, red, town) == first
        assert count(CorrectedBlocked, red, town) == ours


def test_who_never_moves_at_green_is_blocked_in_the_end() -> None:
    town = StripTown(lights=[LIGHT, LIGHT])
    stays = waiting(STOP_X - 4.0, LightState.RED, 400.0, green_for=170.0)
    assert count(CorrectedBlocked, stays, town) == 0
    assert count(CorrectedBlocked, [*stays, *_after(stays, waiting(STOP_X - 4.0, LightState.GREEN, 15.0))], town) == 1


def _after(first: list[Any], then: list[Any]) -> list[Any]:
    return [replace(s, tick=len(first) + s.tick) for s in then]


# ---------------------------------------------------------------- bookkeeping


def test_rates_are_counts_by_distance_and_leave_no_route_out() -> None:
    def rate(rules: Any) -> float:
        rows: list[Any] = [(1000, 100, "", None), (1000, 50, "veh veh blocked", None), (500, 0, "veh blocked", None)]
        records = [record(row, rules, k) for k, row in enumerate(rows)]
        return summarise(records, 3, rules).rates["collisions_vehicle"]

    assert rate(V1) == 4.0
    assert rate(OURS) == pytest.approx(3 / 1.5)


def test_missing_drives_deviate() -> None:
    records = [record((1000, 100, "", None), OURS)]
    deviation = summarise(records, 2, OURS).deviation
    assert deviation is not None
    assert deviation.composed == pytest.approx(math.sqrt(2.0 * 50.0**2))


def test_the_agents_own_failure_stands_in_the_status() -> None:
    for rules, expected in ((V1, "Failed - Agent got blocked"), (OURS, "Failed - Agent crashed")):
        assert status(False, [event("blocked")], "Agent crashed", rules) == expected
    assert status(False, [event("blocked")], None, OURS) == "Failed - Agent got blocked"


def test_a_blocked_drive_is_no_error_of_the_agents() -> None:
    for rules, row, entry in (
        (V1, (1500, 42.5, "ped blocked", None), "Finished with agent errors"),
        (OURS, (1500, 42.5, "ped blocked", None), "Finished"),
        (OURS, (500, 20, "", "Agent crashed"), "Finished with agent errors"),
    ):
        made = Results(rules, 1, (record(row, rules),), finished=True)  # type: ignore[arg-type]
        assert (made.entry_status(), made.eligible()) == (entry, True)


def test_scores_are_those_of_1_0() -> None:
    for rules in (V1, OURS):
        made = record((1000, 100, "ped veh static red stop", None), rules)
        assert made.scores.penalty == pytest.approx(0.1092)
