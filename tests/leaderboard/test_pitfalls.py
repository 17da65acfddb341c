"""Rows of the criteria's tables that ask for a closer look, in pairs, and the pitfalls of the leaderboard's score.

`rows.md` beside this file says which test holds each row.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from lavsim.agent import AgentFailure, AgentStatus
from lavsim.cli import app
from lavsim.types import DT, ActorClass, LightState, Role
from lavsim.world.snapshot import HAZARD_EMERGENCY_TEST, HAZARD_OWNS_TIMER
from leaderboard.criteria.blocked import Blocked
from leaderboard.criteria.collision import Collision
from leaderboard.criteria.completion import Completion
from leaderboard.criteria.min_speed import MinSpeed
from leaderboard.criteria.outside_route_lanes import OutsideRouteLanes
from leaderboard.criteria.red_light import RedLight
from leaderboard.criteria.route_deviation import RouteDeviation
from leaderboard.criteria.scenario_timeout import ScenarioTimeout
from leaderboard.criteria.stop_sign import StopSign
from leaderboard.criteria.yield_emergency import YieldEmergency
from leaderboard.observer import CriteriaObserver, Verdict, judge
from leaderboard.rules import RULES, Rules
from leaderboard.score import RouteRecord, scores, summarise
from tests.leaderboard.test_collision import OTHERS, WALL, A, B, events
from tests.leaderboard.test_criteria import LIGHT, STEPS, passing, still, stop_sign, wrong_lane_flags
from tests.leaderboard.test_score import WORKED, event, record
from tests.leaderboard.worlds import V1, V20, Strip, StripTown, along, drive, ego_at, straight_route
from tests.snapshots import Body

BOTH = pytest.mark.parametrize("rules", [V1, V20], ids=["1.0", "2.x"])

# ---------------------------------------------------------------- 2.1 collision


@BOTH
def test_every_contact_counts_however_soft(rules: Rules) -> None:
    snapshot = ego_at(0.0, others=OTHERS, touches=(A,))
    contacts = snapshot.contacts.copy()
    contacts["impulse"] = 0.0
    assert len(drive(Collision(rules), [replace(snapshot, contacts=contacts)])) == 1
    assert not drive(Collision(rules), [ego_at(0.0, others=OTHERS)])


@BOTH
def test_the_same_actor_counts_again_after_more_than_five_seconds(rules: Rules) -> None:
    assert events(rules, [(0.0, 0.0, A), (5.0, 20.0, A)]) == [1, 0]
    assert events(rules, [(0.0, 0.0, A), (5.1, 20.0, A)]) == [1, 1]


@pytest.mark.parametrize(("rules", "near", "far"), [(V1, 3.0, 3.01), (V20, 4.99, 5.0)], ids=["1.0", "2.x"])
def test_another_actor_counts_beyond_a_distance(rules: Rules, near: float, far: float) -> None:
    assert events(rules, [(0.0, 0.0, A), (1.0, near, B)]) == [1, 0]
    assert events(rules, [(0.0, 0.0, A), (1.0, far, B)]) == [1, 1]


@BOTH
def test_a_place_left_by_more_than_five_metres_is_forgotten(rules: Rules) -> None:
    for away, again in ((4.9, 0), (5.1, 1)):
        snapshots = [ego_at(0.0, touches=(WALL,)), ego_at(away, tick=1), ego_at(0.0, tick=2, touches=(WALL,))]
        assert len(drive(Collision(rules), snapshots)) == 1 + again


def test_a_wall_on_another_level_is_another_place_in_2_x_alone() -> None:
    def hits(rules: Rules, z: float) -> int:
        above = ego_at(0.0, tick=2, touches=(WALL,))
        pose = above.pose.copy()
        pose[0, 2] = round(z * 1000)
        return len(drive(Collision(rules), [ego_at(0.0, touches=(WALL,)), replace(above, pose=pose)]))

    assert (hits(V1, 6.0), hits(V20, 6.0)) == (1, 2)
    assert (hits(V1, 4.0), hits(V20, 4.0)) == (1, 1)


@pytest.mark.parametrize(("speed", "count"), [(0.09, 0), (0.11, 1)])
def test_fault_begins_at_a_tenth_of_a_metre_a_second(speed: float, count: int) -> None:
    assert events(V20, [(1.0, 0.0, A)], speed=speed) == [count]
    assert events(V1, [(1.0, 0.0, A)], speed=speed) == [1]


# ---------------------------------------------------------------- 2.2 red light


@BOTH
def test_lights_are_considered_within_fifteen_metres_of_their_box(rules: Rules) -> None:
    red = passing(lambda rear: LightState.RED)
    x = LIGHT.trigger[0]
    for aside, count in ((14.5, 1), (15.1, 0)):
        far = SimpleNamespace(**{**vars(LIGHT), "trigger": (x, aside, 0.0, 2.0, 2.0)})
        assert len(drive(RedLight(rules), red, StripTown(lights=[far, LIGHT]))) == count


@BOTH
def test_waiting_at_the_line_and_leaving_at_green_is_spared(rules: Rules) -> None:
    waits = [ego_at(36.0, tick=k, speed=0.0, lights=(LightState.RED,) * 2) for k in range(100)]
    goes = [ego_at(36.0 + 0.4 * k, tick=100 + k, lights=(LightState.GREEN,) * 2) for k in range(40)]
    assert not drive(RedLight(rules), waits + goes, StripTown(lights=[LIGHT, LIGHT]))


# ---------------------------------------------------------------- 2.3 stop sign


def test_a_reversing_ego_is_ignored_in_2_x() -> None:
    back = [ego_at(x, tick=k, speed=-2.0) for k, x in enumerate(STEPS[::-1])]
    assert not drive(StopSign(V20), back, StripTown(signs=[stop_sign()]))


def test_another_sign_failed_makes_the_first_count_again_in_2_x() -> None:
    signs = [stop_sign(), stop_sign(signal_id=8, x=70.0, trigger=(70.0, 0.0, 0.0, 1.5, 1.5))]
    twice = [ego_at(x, tick=k) for k, x in enumerate([*STEPS, *STEPS])]
    assert len(drive(StopSign(V20), twice, StripTown(signs=signs))) == 4
    assert len(drive(StopSign(V20), twice, StripTown(signs=signs[:1]))) == 1


@pytest.mark.parametrize(("rules", "near", "far"), [(V1, 29.5, 28.5), (V20, 46.5, 45.5)], ids=["1.0", "2.x"])
def test_a_stop_counts_from_where_the_sign_is_seen(rules: Rules, near: float, far: float) -> None:
    """1.0 looks 20 m ahead for the box, 2.x has the box's centre within 4 m; both begin to watch a tick later."""
    for place, count in ((near, 0), (far, 1)):
        xs = [*np.arange(20.0, place, 0.1), *([place] * 3), *np.arange(place, 60.0, 0.1)]
        speeds = [0.0 if x == place else 2.0 for x in xs]
        snapshots = [ego_at(x, tick=k, speed=v) for k, (x, v) in enumerate(zip(xs, speeds, strict=True))]
        town = StripTown(signs=[stop_sign(trigger=(50.0, 0.0, 0.0, 1.5, 1.5))])
        assert len(drive(StopSign(rules), snapshots, town)) == count


# ---------------------------------------------------------------- 2.4 lanes


def jump(angle: float) -> list[Strip]:
    """A road whose other lane lies at `angle` [deg] to the first."""
    return [Strip(1, -1, 0.0, -50.0, 200.0), Strip(1, 1, -3.5, -50.0, 200.0, yaw=math.radians(angle))]


@pytest.mark.parametrize(
    ("angle", "first", "second"), [(149.0, "F", "F"), (150.0, "T", "F"), (151.0, "T", "T"), (209.0, "T", "T")]
)
def test_lanes_jump_beyond_150_degrees(angle: float, first: str, second: str) -> None:
    places = [(40.0, 0.0), (45.0, -3.5)]
    assert wrong_lane_flags(V1, places, jump(angle))[-1] == first
    assert wrong_lane_flags(V20, places, jump(angle))[-1] == second


@pytest.mark.parametrize(("angle", "flag"), [(119.0, "F"), (121.0, "T"), (239.0, "T"), (241.0, "F")])
def test_leaving_a_junction_against_a_lane_is_wrong_beyond_120_degrees(angle: float, flag: str) -> None:
    inside = Strip(1, -1, 0.0, 0.0, 20.0, junction=0)
    strips = [inside, Strip(2, 1, 0.0, 20.0, 90.0, yaw=math.radians(angle))]
    for rules in (V1, V20):
        assert wrong_lane_flags(rules, [(10.0, 0.0), (25.0, 0.0)], strips)[-1] == flag


def test_percent_outside_is_of_the_distance_completed() -> None:
    half = [ego_at(x, 5.0 if x < 20.0 else 0.0, tick=k) for k, x in enumerate(STEPS[:126])]
    (infraction,) = drive(OutsideRouteLanes(V1), half)
    assert infraction.value == pytest.approx(100.0 * 19.0 / 49.0)


# ---------------------------------------------------------------- 2.5 deviation, 2.6 blocked, 2.8 completion


@BOTH
def test_deviation_is_the_same_in_both(rules: Rules) -> None:
    assert drive(RouteDeviation(rules), along(0.0, 1.0, y=30.0))
    assert not drive(RouteDeviation(rules), along(0.0, 1.0, y=29.9))


def test_standing_off_the_route_adds_nothing_to_its_share() -> None:
    """7.12: 28 m driven 20 m off the route, then a minute at rest there."""
    there = [ego_at(x, 20.0, tick=k) for k, x in enumerate(STEPS[:71])]
    rest = [ego_at(STEPS[70], 20.0, tick=71 + k, speed=0.0) for k in range(1200)]
    assert not drive(RouteDeviation(V1), there + rest)
    assert drive(RouteDeviation(V1), there + [ego_at(x, 20.0, tick=71 + k) for k, x in enumerate(STEPS[71:90])])


def test_the_clock_of_blocked_starts_again_when_a_hazard_begins_and_ends() -> None:
    def standing(before: float, during: float, after: float) -> int:
        plain, held = ego_at(0.0, speed=0.0), ego_at(0.0, speed=0.0, hazards=[(0, HAZARD_OWNS_TIMER)])
        counts = [(plain, before), (held, during), (plain, after)]
        bodies = [s for s, seconds in counts for _ in range(round(seconds / DT))]
        return len(drive(Blocked(V20), [replace(s, tick=k) for k, s in enumerate(bodies)]))

    assert standing(179.0, 10.0, 179.0) == 0
    assert standing(179.0, 10.0, 181.0) == 1


@BOTH
def test_standing_at_a_red_light_counts_as_blocked(rules: Rules) -> None:
    """7.13: no criterion but ours knows why the ego stands."""
    town = StripTown(lights=[LIGHT])
    red = ego_at(36.0, speed=0.0, lights=(LightState.RED,))
    assert drive(Blocked(rules), [replace(red, tick=k) for k in range(3700)], town)
    assert not drive(Blocked(rules), [replace(red, tick=k) for k in range(3600)], town)


def test_2_x_compares_with_99_after_rounding() -> None:
    """7.9: a route of 10 km at 99.004 %."""
    route = straight_route(10_000.0, 0.4)

    def reached(rules: Rules, percent: float) -> bool:
        criterion = Completion(rules)
        criterion.start(StripTown(), route)
        criterion._progress.index = round(percent * 100.0 / 0.4) - 1
        # Near the target in place, though far from it along the route: what only a loop does.
        criterion._target = np.array([percent * 100.0, 0.0, 0.0])
        criterion.update(ego_at(percent * 100.0 + 0.1))
        return criterion.reached

    assert reached(V1, 99.004)
    assert not reached(V20, 99.004)
    assert reached(V20, 99.008)


def test_near_the_target_at_98_9_percent_the_drive_goes_on() -> None:
    """7.10: within 10 m, but not past 99 %."""
    for last, reached in ((98.9, False), (99.9, False), (100.5, True)):
        criterion = Completion(V1)
        drive(criterion, along(*STEPS[:247], last))
        assert criterion.reached is reached


def test_each_criterion_has_a_window_of_its_own() -> None:
    """7.11: after a leap of 10 m completion is 2 points on, off-road 3, deviation 5."""
    leap = along(0.5, 10.5)
    completion, lanes, deviation = Completion(V1), OutsideRouteLanes(V1), RouteDeviation(V1)
    for criterion in (completion, lanes, deviation):
        drive(criterion, leap, finish=False)
    assert completion._progress.index == 2
    assert lanes._progress.index == 3
    assert deviation._index == 6  # 1 at 0.5 m: later points win ties


def test_points_that_lie_twice_at_joints_change_no_distance() -> None:
    """7.24."""
    route = straight_route()
    points = np.insert(route.points, 50, route.points[50], axis=0)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    doubled = SimpleNamespace(
        points=points, yaw=np.zeros(len(points)), distance=np.append(0.0, np.cumsum(steps)), length=100.0,
        keypoint_length=100.0, keypoints=route.keypoints,
    )  # fmt: skip
    for made in (route, doubled):
        criterion = Completion(V1)
        drive(criterion, along(*STEPS[:151]), route=made)
        assert criterion.percent == 59.0
        (infraction,) = drive(OutsideRouteLanes(V1), along(*STEPS[:151], y=5.0), route=made)
        assert infraction.metres == 59.0


# ---------------------------------------------------------------- 2.9 to 2.11


def test_only_background_vehicles_are_the_traffic_around() -> None:
    others = {
        "scenario": Body(1_000_000, 30.0, speed=20.0, role=Role.SCENARIO),
        "walker": Body(100_000, 30.0, speed=20.0, kind=ActorClass.WALKER, blueprint="walker.pedestrian.0001"),
        "background": Body(1000, 30.0, speed=20.0),
    }
    found = {k: len(drive(MinSpeed(V20), along(*STEPS, speed=8.0, others=(b,)))) for k, b in others.items()}
    assert found == {"scenario": 0, "walker": 0, "background": 5}


def test_the_rest_of_a_route_is_judged_beyond_95_percent() -> None:
    slow = (Body(1000, 30.0, speed=20.0),)
    assert len(drive(MinSpeed(V20), along(*STEPS[:239], speed=8.0, others=slow))) == 3  # 95.2 m: at point 95
    assert len(drive(MinSpeed(V20), along(*STEPS[:242], speed=8.0, others=slow))) == 5


def test_bench2drive_has_twenty_checkpoints() -> None:
    slow = (Body(1000, 30.0, speed=20.0),)
    found = drive(MinSpeed(RULES["bench2drive"]), along(*STEPS, speed=8.0, others=slow), route=straight_route(100.0))
    assert len(found) > 15


def test_each_hazard_has_a_timer_of_its_own() -> None:
    both = still(250.0, hazards=[(0, HAZARD_OWNS_TIMER), (3, HAZARD_OWNS_TIMER)])
    assert len(drive(ScenarioTimeout(V20), both)) == 2
    in_turn = still(150.0, hazards=[(0, HAZARD_OWNS_TIMER)]) + still(150.0, hazards=[(3, HAZARD_OWNS_TIMER)])
    assert not drive(ScenarioTimeout(V20), [replace(s, tick=k) for k, s in enumerate(in_turn)])
    assert not drive(ScenarioTimeout(V20), still(250.0, hazards=[(0, 0)]))


def test_who_lets_the_emergency_vehicle_pass_in_the_end_is_spared() -> None:
    def passed(places: list[float]) -> int:
        cars = [Body(1_000_000, x, speed=20.0, role=Role.SCENARIO) for x in places]
        seen = [ego_at(0.0, tick=k, others=(car,), hazards=[(0, HAZARD_EMERGENCY_TEST)]) for k, car in enumerate(cars)]
        return len(drive(YieldEmergency(V20), [*seen, ego_at(0.0, tick=len(seen))]))

    assert passed([-40.0, -20.0, 5.0]) == 0
    assert passed([-40.0, 5.0, -5.0]) == 1


# ---------------------------------------------------------------- scores and records


def test_1_0_measures_the_route_along_its_waypoints_and_2_x_along_the_dense_route() -> None:
    """7.5."""
    verdict = Verdict(completion=50.0, ticks=101, route_length=1050.0004, keypoint_length=1000.0004)
    assert judge(verdict, V1, 0, "RouteScenario_0", 1.0).route_length == 1000.0004
    assert judge(verdict, V20, 0, "RouteScenario_0_rep0", 1.0).route_length == 1050.0
    assert judge(verdict, V1, 0, "RouteScenario_0", 1.0).duration_game == 5.0  # from the first tick


@pytest.mark.parametrize("version", ["1.0", "2.0", "2.1"])
def test_a_route_without_progress_adds_its_penalty_to_the_mean(version: str) -> None:
    """7.7."""
    rules = RULES[version]
    records = [record(WORKED["W1"][0], rules, 0), record(WORKED["W8"][0], rules, 1)]
    factor = 0.588235 if version == "2.1" else 0.6
    assert summarise(records, 2, rules).mean.penalty == pytest.approx((1.0 + factor) / 2.0, abs=1e-6)


@pytest.mark.parametrize("version", sorted(RULES))
def test_what_ends_a_route_has_no_factor(version: str) -> None:
    """7.14."""
    for kind in ("blocked", "dev", "timeout"):
        assert scores(40.0, [event(kind)], RULES[version]).composed == 40.0
    assert scores(40.0, [event("veh")], RULES[version]).composed < 40.0


def test_perfect_needs_none_of_twelve_kinds() -> None:
    """7.20."""
    for kind in ("slow:90", "timeout", "veh", "emergency"):
        made = record((1000, 100, kind, None), V20)
        assert (made.status, made.count) == ("Completed", 1)
    assert record((1000, 100, "", None), V20).status == "Perfect"


def test_a_drive_that_fails_at_its_end_says_nothing_of_a_target_reached() -> None:
    """A reached target hides the agent's failure; without it the failure stands."""
    for xs, status in (([*STEPS, 100.4, 100.8], "Completed"), (STEPS[:200], "Failed - Agent crashed")):
        criteria = CriteriaObserver(V1)
        criteria.watch(StripTown(), straight_route())  # type: ignore[arg-type]
        for snapshot in along(*xs):
            criteria.observe(snapshot)
        criteria.close(AgentFailure(AgentStatus.CRASHED, "no idea"))
        assert judge(criteria.verdict(), V1, 0, "RouteScenario_0", 1.0).status == status


# ---------------------------------------------------------------- 7.28, 7.29


@BOTH
def test_looking_at_a_drive_under_way_changes_nothing(rules: Rules) -> None:
    """The original makes its record anew every tick and forgets to empty one list; here asking leaves no trace."""

    def record_after(snapshots: list[Any], asks: bool) -> RouteRecord:
        criteria = CriteriaObserver(rules)
        criteria.watch(StripTown([Strip()], [LIGHT, LIGHT]), straight_route())  # type: ignore[arg-type]
        for snapshot in snapshots:
            criteria.observe(snapshot)
            if asks:
                for _ in range(2):
                    judge(criteria.verdict(), rules, 0, "RouteScenario_0", 1.0)
        criteria.close(None)
        return judge(criteria.verdict(), rules, 0, "RouteScenario_0", 1.0)

    red = passing(lambda rear: LightState.RED)
    late = [ego_at(99.8, tick=red[-1].tick + 40 * k, speed=0.05, others=OTHERS, touches=(A,)) for k in range(1, 200)]
    asked = record_after([*red, *late], asks=True)
    assert asked == record_after([*red, *late], asks=False)
    assert {key for key, texts in asked.infractions.items() if texts} >= {"red_light", "vehicle_blocked"}
    assert all(len(texts) == len(set(texts)) for texts in asked.infractions.values())


@pytest.mark.parametrize("flag", ["--resume", "--overwrite", "--strict-compat", "--drawings"])
def test_flags_take_no_value(flag: str, tmp_path: Path) -> None:
    """The original takes `--resume=False` for true, as any text that isn't empty."""
    words = ["score", "--agent", "agents.idle", "--out", str(tmp_path), f"{flag}=False"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "does not take a value" in result.output
    assert not list(tmp_path.iterdir())
