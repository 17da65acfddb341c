"""LAV's controller: PIDs by hand, stops, creeping, and forecasts in the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agents.lav.config import DriveConfig, PidConfig
from agents.lav.controller import (
    Caution,
    Controller,
    Impatience,
    Pid,
    StuckCounter,
    aim_point,
    creep_path,
    planned_speed,
    touched,
)
from lavsim.types import Control
from lavsim.world.dynamics import FULL_STEER_CURVATURE

CONFIG = DriveConfig()


def straight(speed: float, count: int = 10) -> np.ndarray:
    """A plan straight ahead."""
    return np.stack([np.zeros(count), -speed * 0.25 * np.arange(1, count + 1)], axis=1)


def arc(speed: float, radius: float, count: int = 10) -> np.ndarray:
    """A plan around a bend to the right."""
    angle = speed * 0.25 * np.arange(1, count + 1) / radius
    return np.stack([radius * (1.0 - np.cos(angle)), -radius * np.sin(angle)], axis=1)


def test_a_pid_of_three_errors_worked_by_hand() -> None:
    pid = Pid(PidConfig(proportional=2.0, integral=4.0, derivative=10.0, window=4))
    assert pid.step(1.0) == pytest.approx(2.0 + 4.0 * 0.25 + 10.0)
    assert pid.step(0.5) == pytest.approx(1.0 + 4.0 * 1.5 / 4 - 5.0)
    assert pid.step(0.5) == pytest.approx(1.0 + 4.0 * 2.0 / 4)


def test_it_drives_on_and_steers_to_the_side_of_the_plan() -> None:
    assert planned_speed(straight(6.0)) == pytest.approx(6.0)
    ahead = Controller(CONFIG).follow(straight(6.0), 5.0, 3)
    assert ahead.throttle == pytest.approx(0.8)
    assert ahead.steer == 0.0
    right = Controller(CONFIG).follow(arc(6.0, 12.0), 6.0, 1)
    left = Controller(CONFIG).follow(arc(6.0, 12.0) * (-1, 1), 6.0, 0)
    assert right.steer == pytest.approx(-left.steer)


@pytest.mark.parametrize("speed", [2.5, 6.0, 9.0])
def test_the_wheel_stands_for_the_arc_of_the_plan_at_any_speed(speed: float) -> None:
    assert Controller(CONFIG).follow(arc(speed, 12.0), speed, 1).steer * FULL_STEER_CURVATURE == pytest.approx(1 / 12.0)


def test_the_papers_gains_answer_the_angle_alone() -> None:
    aim = arc(6.0, 12.0)[4]
    error = math.atan2(aim[0], -aim[1]) / (math.pi / 2.0)
    control = Controller(CONFIG.model_copy(update={"pursuit": False})).follow(arc(6.0, 12.0), 6.0, 1)
    assert control.steer == pytest.approx(error * (0.8 + 0.5 / 40 + 0.2))


@pytest.mark.parametrize(
    ("plan", "speed", "brakes"),
    [(straight(0.7), 5.0, True), (straight(0.9), 0.5, False), (straight(5.0), 6.0, False), (straight(5.0), 7.0, True)],
)
def test_it_brakes_for_a_plan_that_stops_or_is_much_slower(plan: np.ndarray, speed: float, brakes: bool) -> None:
    assert (Controller(CONFIG).follow(plan, speed, 3).brake > 0.0) == brakes


def test_it_stops_for_a_plan_of_no_numbers_and_does_not_race() -> None:
    broken = straight(5.0)
    broken[3] = np.nan
    assert Controller(CONFIG).follow(broken, 5.0, 3) == Control(brake=1.0)
    assert Controller(CONFIG).follow(straight(20.0), 13.0, 3).throttle == 0.0


@pytest.mark.parametrize(
    ("allowed", "speed", "throttle", "brake"),
    [(math.inf, 5.0, 0.8, 0.0), (4.0, 3.0, 0.8, 0.0), (4.0, 3.5, 0.0, 0.0), (4.0, 5.0, 0.0, 0.5), (1.0, 0.9, 0.0, 1.0)],
)
def test_it_drives_no_faster_than_is_allowed(allowed: float, speed: float, throttle: float, brake: float) -> None:
    control = Controller(CONFIG).follow(straight(8.0), speed, 3, allowed)
    assert (control.throttle, control.brake) == (pytest.approx(throttle), pytest.approx(brake))


def test_it_creeps_after_a_while_and_only_then() -> None:
    counter = StuckCounter(CONFIG)
    stop = Control(brake=1.0)
    patience, length = round(CONFIG.stuck / 0.05), round(CONFIG.creep / 0.05)
    controls = [counter.step(stop, 0.0, True) for _ in range(patience)]
    assert all(control == stop for control in controls[:-1])
    assert (controls[-1].throttle, controls[-1].steer) == (pytest.approx(0.4), 0.0)
    rolling = [counter.step(stop, 1.0, True) for _ in range(length + 10)]
    assert sum(control.throttle > 0.0 for control in rolling) == length - 1, "it creeps for a while in all"
    assert rolling[-1] == stop


def test_nobody_creeps_into_who_stands_before_it() -> None:
    counter = StuckCounter(CONFIG)
    stop = Control(brake=1.0)
    assert all(counter.step(stop, 0.0, False) == stop for _ in range(2 * round(CONFIG.stuck / 0.05)))
    assert counter.step(stop, 0.0, True).throttle > 0.0, "it waited long enough"
    ahead = creep_path(10)
    assert ahead[-1] == pytest.approx([0.0, -2.0])
    assert not ahead[:, 0].any()


def test_the_wheel_is_not_turned_for_a_waypoint_at_hand() -> None:
    crawl = straight(0.3) + np.array([0.2, 0.0])
    assert abs(aim_point(crawl, 4)) == pytest.approx([0.2, 3.0])
    slow = straight(2.0) + np.array([0.2, 0.0])
    assert aim_point(slow, 4) == pytest.approx([0.2, -3.0]), "the sixth is the first that is far enough"
    fast = straight(8.0) + np.array([0.2, 0.0])
    assert aim_point(fast, 4) == pytest.approx([0.2, -10.0])


CAR = (2.4, 0.95)  # half length and half width [m]


def hits(plan: np.ndarray, path: np.ndarray, heading: float = 0.0, likelihood: float = 0.5, half=CAR) -> bool:  # type: ignore[no-untyped-def]
    """Whether a plan runs into one other that takes `path` by one of its commands."""
    forecasts = np.full((1, 6, 10, 2), 50.0)
    forecasts[0, 2] = path
    likely = np.zeros((1, 6))
    likely[0, 2] = likelihood
    return bool(touched(plan, forecasts, likely, np.array([(0.0, *CAR), (heading, *half)]), CONFIG).any())


def test_forecasts_in_the_way_count_when_they_are_likely_touching_and_not_behind() -> None:
    plan = straight(6.0)
    crossing = np.stack([np.linspace(-8.0, 8.0, 10), np.full(10, plan[4, 1])], axis=1)
    assert hits(plan, crossing, math.pi / 2.0)
    assert not hits(plan, crossing, math.pi / 2.0, likelihood=0.1)
    assert not hits(plan, crossing - np.array([0.0, 14.0]), math.pi / 2.0), "it passes ahead"
    behind = straight(9.0) + np.array([0.0, 6.0])
    assert not hits(plan, behind), "who comes from behind is no reason to stop"
    assert not len(touched(plan, np.zeros((0, 6, 10, 2)), np.zeros((0, 6)), np.array([(0.0, *CAR)]), CONFIG))


def test_a_parked_car_beside_the_way_is_no_obstacle_and_one_on_it_is() -> None:
    parked = np.tile([2.2, -4.0], (10, 1))
    assert not hits(straight(6.0), parked)
    assert hits(straight(6.0), parked - np.array([1.0, 0.0]))
    assert hits(straight(6.0), parked, heading=math.pi / 2.0), "standing across it reaches into the way"
    far_end = np.tile([0.0, -21.0], (10, 1))
    assert hits(straight(6.0), far_end, half=(6.0, 1.25)), "the rear of a bus counts, not its middle"
    assert not hits(straight(6.0), far_end)


def test_the_longer_it_stands_the_more_narrowly_it_passes() -> None:
    impatience = Impatience(CONFIG)
    assert impatience.step(0.0, True) == 0.0
    stood = [impatience.step(0.0, True) for _ in range(round((CONFIG.patience + CONFIG.yield_time) / 0.05))]
    assert stood[round(CONFIG.patience / 0.05) - 2] == 0.0
    assert stood[-1] == pytest.approx(CONFIG.most_yield)
    past = [impatience.step(1.5, True) for _ in range(20)]
    assert past[-1] > 0.5 * CONFIG.most_yield, "a metre and a half on, it still passes narrowly"
    assert [impatience.step(5.0, True) for _ in range(40)][-1] == 0.0
    parked = np.tile([1.8, -4.0], (1, 6, 10, 1)).astype(float)
    boxes = np.array([(0.0, *CAR), (0.0, *CAR)])
    for less, hit in ((0.0, True), (0.4, False)):
        assert touched(straight(6.0), parked, np.ones((1, 6)), boxes, CONFIG, less).any() == hit


def test_it_goes_on_braking_for_a_walker_who_is_out_of_the_way_for_a_moment() -> None:
    caution = Caution(CONFIG)
    assert [caution.step(6.0, 8.0), caution.step(math.inf, 8.0)] == pytest.approx([6.0, 5.6])
    assert caution.step(3.0, 8.0) == 3.0, "who is nearer counts"
    held = [caution.step(math.inf, 2.0) for _ in range(10)]
    assert held[:7] == pytest.approx([2.9 - 0.1 * k for k in range(7)])
    assert held[7:] == [math.inf] * 3
    off = Caution(CONFIG.model_copy(update={"caution": 0.0}))
    assert [off.step(6.0, 8.0), off.step(math.inf, 8.0)] == [6.0, math.inf]
