"""Every criterion in pairs: where it fires, and where it just does not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.geometry import forward, right, segments_cross
from lavsim.types import DT, LaneType, LightState, Role
from lavsim.world.snapshot import HAZARD_EMERGENCY_TEST, HAZARD_OWNS_TIMER, HAZARD_WRONG_LANE_OFF
from leaderboard.criteria.base import COMPLETED, CRITERIA, criteria_of
from leaderboard.criteria.blocked import Blocked
from leaderboard.criteria.completion import Completion
from leaderboard.criteria.min_speed import MinSpeed
from leaderboard.criteria.outside_route_lanes import OutsideRouteLanes
from leaderboard.criteria.red_light import RedLight
from leaderboard.criteria.route_deviation import RouteDeviation
from leaderboard.criteria.route_timeout import RouteTimeout
from leaderboard.criteria.scenario_timeout import ScenarioTimeout
from leaderboard.criteria.stop_sign import StopSign
from leaderboard.criteria.yield_emergency import YieldEmergency
from leaderboard.progress import SLACK, Clear, PlaneProgress
from leaderboard.rules import RULES, Rules
from tests.leaderboard.worlds import V1, V20, Strip, StripTown, along, drive, ego_at, straight_route
from tests.snapshots import EGO, Body

STEPS = [0.4 * k for k in range(251)]  # 100 m at 8 m/s


def test_criteria_run_in_the_order_of_the_originals() -> None:
    first = [c.name for c in criteria_of(V1)]
    assert first == [
        "route_timeout", "completion", "outside_route_lanes", "collision", "red_light", "stop_sign",
        "route_deviation", "blocked",
    ]  # fmt: skip
    second = [c.name for c in criteria_of(V20)]
    assert second[5:9] == ["stop_sign", "min_speed", "route_deviation", "blocked"]


# ---------------------------------------------------------------- completion


def test_completion_says_the_end_one_tick_after_the_target() -> None:
    criterion = Completion(V1)
    criterion.start(StripTown(), straight_route())
    endings = []
    for snapshot in along(*STEPS, 100.4, 100.8):
        criterion.update(snapshot)
        endings.append((criterion.reached, criterion.ending))
    reached = next(k for k, (r, _) in enumerate(endings) if r)
    assert criterion.percent == 100.0
    assert endings[reached] == (True, None)
    assert endings[reached + 1] == (True, COMPLETED)


def test_completion_counts_points_that_were_passed() -> None:
    criterion = Completion(V1)
    drive(criterion, along(*STEPS[:126]))  # to x = 50 exactly: on the plane of point 50 is not past it
    assert criterion.percent == 49.0
    assert not criterion.reached


def test_completion_has_no_value_before_the_first_advance() -> None:
    criterion = Completion(V1)
    drive(criterion, along(-5.0, -4.0))
    assert criterion.percent == 0.0


def test_completion_has_no_lateral_limit_but_ends_only_near_the_target() -> None:
    criterion = Completion(V1)
    drive(criterion, along(*STEPS, 100.4, 100.8, y=12.0))
    assert criterion.percent == 100.0  # raw: all points are passed
    assert not criterion.reached
    near = Completion(V1)
    drive(near, along(*STEPS, 100.4, 100.8, y=9.0))
    assert near.reached


def test_completion_of_exactly_99_percent_goes_on() -> None:
    for last, reached in ((99.9, False), (100.1, True)):
        criterion = Completion(V1)
        drive(criterion, along(*STEPS[:248], last))
        assert criterion.reached is reached


def test_completion_lags_behind_when_more_than_two_points_pass_in_a_tick() -> None:
    criterion = Completion(V1)
    drive(criterion, along(0.5, 10.5, 10.5))
    assert criterion.percent == 4.0


# ---------------------------------------------------------------- off-road


def outside(rules: Rules, y: float, town: StripTown | None = None, first: int = 0, last: int = 251) -> Any:
    snapshots = [ego_at(x, y if first <= k < last else 0.0, tick=k) for k, x in enumerate(STEPS)]
    found = drive(OutsideRouteLanes(rules), snapshots, town)
    return found[0] if found else None


@pytest.mark.parametrize(("rules", "limit"), [(V1, 1.75 + 1.3), (V20, 1.75 + 0.5)])
def test_outside_lanes_by_the_margin_of_the_egos_centre(rules: Rules, limit: float) -> None:
    assert outside(rules, limit - 0.01) is None
    infraction = outside(rules, limit + 0.01)
    assert infraction.value == 100.0
    assert infraction.metres == 99.0


def test_outside_lanes_counts_route_metres_driven_meanwhile() -> None:
    infraction = outside(V1, 5.0, first=50, last=100)  # x from 20 to 39.6
    assert infraction.metres == pytest.approx(20.0)
    assert infraction.value == pytest.approx(100.0 * 20.0 / 99.0)
    assert infraction.message.split(" ")[8] == "20.0"
    assert "(20.2% of the completed route)" in infraction.message


def test_standing_outside_adds_nothing() -> None:
    there = along(*STEPS[:26])  # to x = 10.0
    standing = [ego_at(10.0, 6.0, tick=26 + k) for k in range(100)]
    assert not drive(OutsideRouteLanes(V1), [*there, *standing, ego_at(10.4, 0.0, tick=126)])


def test_parking_lanes_are_not_outside() -> None:
    town = StripTown([Strip(), Strip(lane=-2, y=4.0, width=2.5, type=LaneType.PARKING)])
    assert outside(V1, 5.0) is not None
    assert outside(V1, 5.0, town) is None


TWO_WAY = [Strip(1, -1, 0.0, -50.0, 60.0), Strip(1, 1, -3.5, -50.0, 60.0, yaw=math.pi),
           Strip(2, -1, 0.0, 60.0, 200.0), Strip(2, 1, -3.5, 60.0, 200.0, yaw=math.pi)]  # fmt: skip


def wrong_lane_flags(rules: Rules, places: list[tuple[float, float]], strips: list[Strip] = TWO_WAY) -> str:
    criterion = OutsideRouteLanes(rules)
    criterion.start(StripTown(strips), straight_route())
    flags = ""
    for k, (x, y) in enumerate(places):
        criterion.update(ego_at(x, y, tick=k))
        flags += "FT"[criterion._wrong_lane]
    return flags


def test_wrong_lane_is_a_flag_with_memory() -> None:
    """Correct, opposite, opposite, opposite on the next road, same, correct: as the original code gave it."""
    places = [(40.0, 0.0), (45.0, -3.5), (50.0, -3.5), (65.0, -3.5), (70.0, -3.5), (75.0, 0.0)]
    assert wrong_lane_flags(V1, places) == "FTTFFT"
    assert wrong_lane_flags(V20, places) == "FTTTTF"


def test_wrong_lane_is_judged_by_the_heading_when_a_junction_is_left() -> None:
    strips = [
        Strip(1, -1, 0.0, 0.0, 20.0, junction=0),
        Strip(2, -1, 0.0, 20.0, 90.0),
        Strip(2, 1, -3.5, 20.0, 90.0, yaw=math.pi),
    ]
    assert wrong_lane_flags(V1, [(10.0, 0.0), (25.0, 0.0)], strips) == "FF"
    assert wrong_lane_flags(V1, [(10.0, 0.0), (25.0, -3.5)], strips) == "FT"


def test_wrong_lane_costs_the_metres_driven_in_it_unless_a_hazard_allows_it() -> None:
    town = StripTown(TWO_WAY)

    def run(rules: Rules, hazards: list[tuple[int, int]]) -> list[Any]:
        places = [(x, -3.5 if 10.0 < x < 30.0 else 0.0) for x in STEPS]
        return drive(
            OutsideRouteLanes(rules), [ego_at(x, y, tick=k, hazards=hazards) for k, (x, y) in enumerate(places)], town
        )

    assert run(V1, [])[0].metres == pytest.approx(20.0)
    assert run(V20, [])[0].metres == pytest.approx(20.0)
    assert run(V20, [(0, HAZARD_WRONG_LANE_OFF)]) == []


# ---------------------------------------------------------------- red light

STOP_X = 40.0
LIGHT = SimpleNamespace(
    signal_id=17, x=60.0, y=8.0, z=0.0, trigger=(STOP_X, 0.0, 0.0, 2.0, 2.0),
    stop_lines=(
        SimpleNamespace(lane=0, road_id=0, lane_id=-1, u=STOP_X + 1000.0, x=STOP_X, y=0.0, yaw=0.0, width=3.5),
    ),
)  # fmt: skip
HALF = EGO.size[0] / 2.0


def red_light(rules: Rules, snapshots: list[Any], strips: list[Strip] | None = None) -> list[Any]:
    return drive(RedLight(rules), snapshots, StripTown(strips or [Strip()], [LIGHT, LIGHT]))


def passing(states: Any, y: float = 0.0, yaw: float = 0.0) -> list[Any]:
    """Ticks along 30 … 55 m; `states(rear)` gives the first light's state where the ego's rear is at `rear`."""
    xs = [30.0 + 0.4 * k for k in range(63)]
    return [ego_at(x, y, tick=k, yaw=yaw, lights=(states(x - HALF), LightState.GREEN)) for k, x in enumerate(xs)]


def test_red_light_fires_once_when_the_rear_crosses_at_red() -> None:
    (infraction,) = red_light(V1, passing(lambda rear: LightState.RED))
    assert infraction.message == "Agent ran a red light 17 at (x=60.0, y=8.0, z=0.0)"
    # From 0.8 half lengths behind the centre the line counts as met, a little before the rear itself is over it.
    assert infraction.position[0] - STOP_X == pytest.approx(0.8 * HALF, abs=0.4)


@pytest.mark.parametrize("state", [LightState.GREEN, LightState.YELLOW, LightState.OFF])
def test_red_light_spares_every_other_state(state: LightState) -> None:
    assert not red_light(V1, passing(lambda rear: state))


def test_red_light_judges_the_rear() -> None:
    def turns_red_at(limit: float) -> Any:
        return lambda rear: LightState.RED if rear >= limit else LightState.YELLOW

    assert red_light(V1, passing(turns_red_at(STOP_X - 0.4)))  # crossed on yellow, rear still over the line
    assert not red_light(V1, passing(turns_red_at(STOP_X + 1.1)))  # gone
    nose_over = [ego_at(STOP_X, tick=k, speed=0.0, lights=(LightState.RED,) * 2) for k in range(20)]
    assert not red_light(V1, nose_over)


def test_red_light_needs_the_lane_and_the_direction_of_the_stop_line() -> None:
    red = passing(lambda rear: LightState.RED)
    assert not red_light(V1, red, [Strip(lane=-2)])
    assert not red_light(V1, passing(lambda rear: LightState.RED, yaw=math.pi))


def test_red_light_stop_line_is_wider_in_2_0() -> None:
    for y, first, second in ((1.3, 1, 1), (1.6, 0, 1), (2.2, 0, 0)):
        snapshots = passing(lambda rear: LightState.RED, y=y)
        assert len(red_light(V1, snapshots)) == first
        assert len(red_light(V20, snapshots)) == second


@given(
    x=st.floats(STOP_X - 2.0, STOP_X + 6.0), y=st.floats(-3.0, 3.0), yaw=st.floats(-2.0, 2.0), turn=st.floats(-2.0, 2.0)
)
def test_the_quick_look_for_a_red_light_loses_nothing(x: float, y: float, yaw: float, turn: float) -> None:
    ego, line = ego_at(x, y, yaw=yaw).ego, SimpleNamespace(x=STOP_X, y=0.0, yaw=turn, width=3.5)
    back, half = -forward(ego.yaw), ego.length / 2.0
    near, far = ego.xy + back * 0.8 * half, ego.xy + back * (half + 1.0)
    middle, aside = np.array([STOP_X, 0.0]), right(turn) * 0.6 * 3.5
    if math.cos(ego.yaw - turn) > 0.0 and segments_cross(near, far, middle - aside, middle + aside):
        assert RedLight(V20)._is_behind(ego, line)


@given(
    points=st.lists(st.tuples(st.floats(-80, 80), st.floats(-80, 80)), max_size=4),
    places=st.lists(st.tuples(st.floats(-60, 60), st.floats(-60, 60)), min_size=1, max_size=20),
)
def test_clear_is_only_said_where_no_point_is_within_reach(
    points: list[tuple[float, float]], places: list[tuple[float, float]]
) -> None:
    x, y = np.array(points, np.float64).reshape(-1, 2).T
    clear = Clear(x, y, 15.0)
    for place in places:
        nearest = min((math.dist(place, point) for point in points), default=math.inf)
        assert clear.holds(*place) == (nearest > 15.0) or abs(nearest - 15.0) < 2.0 * SLACK


def test_same_red_light_is_charged_again_only_after_another_one() -> None:
    snapshots = passing(lambda rear: LightState.RED)
    assert len(red_light(V1, snapshots + snapshots)) == 1
    both = [ego_at(s.ego.x, tick=s.tick, lights=(LightState.RED, LightState.RED)) for s in snapshots]
    assert len(red_light(V1, both)) > 2  # two lights over one line take turns


# ---------------------------------------------------------------- stop sign

STOP_BOX = 50.0  # [m] along the road


def stop_sign(post: float = 1.0, **changes: Any) -> Any:
    """A stop sign whose post stands `post` metres beside the lane's centre; its box spans the lane before x = 52."""
    fields = {"kind": "stop", "signal_id": 7, "x": STOP_BOX, "y": post, "z": 0.0, "trigger": (50.0, 0.0, 0.0, 1.5, 1.5)}
    return SimpleNamespace(**{**fields, **changes})


def passes(rules: Rules, sign: Any, speeds: Sequence[float] | None = None, yaw: float = 0.0) -> list[Any]:
    """Drives 100 m along the road past `sign`."""
    steps = STEPS if yaw == 0.0 else STEPS[::-1]
    speeds = speeds or [8.0] * len(steps)
    snapshots = [ego_at(x, tick=k, speed=v, yaw=yaw) for k, (x, v) in enumerate(zip(steps, speeds, strict=True))]
    return drive(StopSign(rules), snapshots, StripTown(signs=[sign]))


def stopping_at(place: float) -> list[float]:
    """Speeds along `STEPS` of a car that comes to rest at `place` for a tick."""
    nearest = min(STEPS, key=lambda x: abs(x - place))
    return [0.0 if x == nearest else 8.0 for x in STEPS]


@pytest.mark.parametrize("rules", [V1, V20], ids=["1.0", "2.x"])
def test_stop_sign_fires_once_on_who_drives_through(rules: Rules) -> None:
    (infraction,) = passes(rules, stop_sign())
    assert infraction.key == "stop_infraction"
    assert infraction.message == "Agent ran a stop 7 at (x=50.0, y=1.0, z=0.0)"


@pytest.mark.parametrize("rules", [V1, V20], ids=["1.0", "2.x"])
def test_stop_sign_spares_who_stops_before_it(rules: Rules) -> None:
    assert not passes(rules, stop_sign(), stopping_at(47.2))


def test_a_stop_twenty_metres_early_satisfies_the_first_generation_alone() -> None:
    assert not passes(V1, stop_sign(), stopping_at(35.0))
    assert passes(V20, stop_sign(), stopping_at(35.0))


def test_the_first_generation_never_charges_a_sign_whose_post_stands_off_the_lane() -> None:
    assert not passes(V1, stop_sign(post=3.0))
    assert passes(V20, stop_sign(post=3.0))


@pytest.mark.parametrize("rules", [V1, V20], ids=["1.0", "2.x"])
def test_stop_sign_spares_who_drives_the_other_way(rules: Rules) -> None:
    assert not passes(rules, stop_sign(), yaw=math.pi)


@pytest.mark.parametrize("rules", [V1, V20], ids=["1.0", "2.x"])
def test_stop_sign_spares_other_signs_and_other_levels(rules: Rules) -> None:
    assert not passes(rules, stop_sign(kind="yield"))
    assert not passes(rules, stop_sign(z=8.0))


def test_the_second_generation_charges_one_sign_once_until_another_is_run() -> None:
    there_twice = [*STEPS, *STEPS]
    snapshots = [ego_at(x, tick=k) for k, x in enumerate(there_twice)]
    assert len(drive(StopSign(V20), snapshots, StripTown(signs=[stop_sign()]))) == 1
    assert len(drive(StopSign(V1), snapshots, StripTown(signs=[stop_sign()]))) == 2


# ---------------------------------------------------------------- deviation


def deviation(y: float, first: int, last: int) -> list[Any]:
    snapshots = [ego_at(x, y if first <= k < last else 0.0, tick=k) for k, x in enumerate(STEPS)]
    return drive(RouteDeviation(V1), snapshots)


def test_deviation_ends_the_drive_30_m_off_the_route() -> None:
    criterion = RouteDeviation(V1)
    (infraction,) = drive(criterion, along(0.0, 1.0, y=30.0))
    assert infraction.message == "Agent deviated from the route at (x=0.0, y=30.0, z=0.0)"
    assert criterion.ending == "Agent deviated from the route"
    assert not drive(RouteDeviation(V1), along(0.0, 1.0, y=29.99))


def test_deviation_after_30_percent_of_the_route_15_m_off() -> None:
    assert deviation(15.0, 0, 251)
    assert not deviation(14.9, 0, 251)
    assert deviation(20.0, 50, 130)  # 32 m
    assert not deviation(20.0, 50, 120)  # 28 m


def test_deviation_measures_to_the_old_place_of_the_route() -> None:
    assert drive(RouteDeviation(V1), along(0.0, 40.0))


# ---------------------------------------------------------------- blocked


def still(seconds: float, speed: float = 0.05, **more: Any) -> list[Any]:
    snapshot = ego_at(0.0, speed=speed, **more)
    return [replace(snapshot, tick=k) for k in range(round(seconds / DT) + 1)]


def test_blocked_after_180_seconds_slower_than_a_tenth() -> None:
    assert not drive(Blocked(V1), still(180.0))
    criterion = Blocked(V1)
    (infraction,) = drive(criterion, still(180.05))
    assert infraction.message == "Agent got blocked at (x=0.0, y=0.0, z=0.0)"
    assert criterion.ending == "Agent got blocked"
    assert not drive(Blocked(V1), still(200.0, speed=0.1))


def test_blocked_clock_starts_again_with_every_motion() -> None:
    snapshots = still(190.0)
    snapshots[1000] = ego_at(0.0, tick=1000, speed=0.2)
    assert not drive(Blocked(V1), snapshots)


def test_blocked_is_suspended_by_hazards_with_a_timer_in_2_0_only() -> None:
    waiting = still(190.0, hazards=[(0, HAZARD_OWNS_TIMER)])
    assert drive(Blocked(V1), waiting)
    assert not drive(Blocked(V20), waiting)


def test_blocked_after_60_seconds_on_bench2drive() -> None:
    assert not drive(Blocked(RULES["bench2drive"]), still(60.0))
    assert drive(Blocked(RULES["bench2drive"]), still(60.05))


# ---------------------------------------------------------------- timeout


def test_timeout_of_1_0_is_whole_seconds_by_the_length_of_the_route() -> None:
    route = straight_route(63.0)  # 0.8 * 63 + 5 = 55.4
    assert not drive(RouteTimeout(V1), still(55.0), route=route)
    criterion = RouteTimeout(V1)
    (infraction,) = drive(criterion, still(55.05), route=route)
    assert infraction.message == "Route timeout."
    assert criterion.ending == "Agent timed out"


def test_timeout_of_2_0_grows_with_progress() -> None:
    assert not drive(RouteTimeout(V20), still(300.0))
    assert drive(RouteTimeout(V20), still(300.05))
    criterion = RouteTimeout(V20)
    drive(criterion, along(*STEPS))
    assert criterion.budget == pytest.approx(300.0 + 99.0 * 0.72)


# ---------------------------------------------------------------- 2.x only


def traffic(speed: float) -> tuple[Body, ...]:
    return (Body(1000, 30.0, speed=speed), Body(1_000_000, 40.0, speed=99.0, role=Role.SCENARIO))


def test_min_speed_compares_each_quarter_with_the_background_traffic() -> None:
    slow = drive(MinSpeed(V20), along(*STEPS, speed=8.0, others=traffic(10.0)))
    assert [i.value for i in slow] == [80.0] * 5  # the last piece is entered twice
    assert not drive(MinSpeed(V20), along(*STEPS, speed=8.0, others=traffic(7.0)))
    assert not drive(MinSpeed(V20), along(*STEPS, speed=8.0))


def test_scenario_timeout_fires_once_after_240_seconds() -> None:
    hazards = [(3, HAZARD_OWNS_TIMER)]
    assert not drive(ScenarioTimeout(V20), still(240.0, hazards=hazards)[:4799])
    assert len(drive(ScenarioTimeout(V20), still(240.0, hazards=hazards)[:4800])) == 1
    assert len(drive(ScenarioTimeout(V20), still(260.0, hazards=hazards))) == 1


@pytest.mark.parametrize(("behind", "count"), [(-20.0, 1), (20.0, 0)])
def test_yield_fires_if_the_ego_is_still_ahead_when_the_hazard_ends(behind: float, count: int) -> None:
    car = Body(1_000_000, behind, speed=20.0, role=Role.SCENARIO)
    during = [ego_at(0.0, tick=k, others=(car,), hazards=[(0, HAZARD_EMERGENCY_TEST)]) for k in range(5)]
    assert len(drive(YieldEmergency(V20), [*during, ego_at(0.0, tick=5)])) == count
    assert len(drive(YieldEmergency(V20), during)) == count


# ---------------------------------------------------------------- all of them


@pytest.mark.parametrize("version", sorted(RULES))
def test_every_criterion_spares_a_plain_drive_and_starts_afresh(version: str) -> None:
    """A new criterion is held to this the moment its file exists."""
    rules = RULES[version]
    classes = criteria_of(rules)
    assert len({c.order for c in classes}) == len(classes)
    keys = [charge.key for c in classes for charge in c.charges]
    assert len(set(keys)) == len(keys)
    for kind in classes:
        assert CRITERIA[kind.name] is kind
        criterion = kind(rules)
        for _ in range(2):
            assert drive(criterion, along(*STEPS)) == []
            assert criterion.ending is None


@given(
    places=st.lists(st.tuples(st.floats(-20.0, 120.0), st.floats(-50.0, 50.0)), max_size=40), window=st.integers(1, 5)
)
def test_progress_never_goes_back_and_never_jumps_past_its_window(
    places: list[tuple[float, float]], window: int
) -> None:
    progress = PlaneProgress(straight_route(), window)
    for x, y in places:
        before = progress.index
        passed = progress.advance(x, y)
        assert progress.index == (passed[-1] if passed else before)
        assert before <= progress.index <= before + window
        assert passed == sorted(passed)
