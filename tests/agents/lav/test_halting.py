"""Lights and stop signs: the speeds that they allow, and how long."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import DriveConfig
from agents.lav.halting import FREE, Line, Signals, Told, allowed_speed, room_before
from lavsim.types import DT

CONFIG = DriveConfig()
RED = Told(0.9, red=0.9, distance=20.0, tells_causes=True)
GREEN = Told(0.9, green=0.9, tells_causes=True)
NONE = Told(0.9, tells_causes=True)
SIGN = Told(0.9, sign=0.9, distance=8.0, tells_causes=True)


def run(signals: Signals, told: Told, speed: float, ticks: int) -> list[float]:
    return [signals.step(told, True, speed) for _ in range(ticks)]


def approach(signals: Signals, told: Told, distance: float, speed: float, ticks: int = 300) -> tuple[float, float]:
    """Distance to the line and speed after driving as fast as is allowed, up to 8 m/s."""
    for _ in range(ticks):
        allowed = signals.step(told._replace(distance=distance), True, speed)
        if speed > allowed or allowed < 0.8:
            speed = max(speed - 6.0 * DT, 0.0)
        elif speed < allowed - 0.7:
            speed = min(speed + 2.0 * DT, 8.0)
        distance -= speed * DT
    return distance, speed


def test_it_stands_before_the_line_of_a_red_light_and_leaves_at_green() -> None:
    signals = Signals(CONFIG)
    distance, speed = approach(signals, RED, 40.0, 8.0)
    assert 6.0 < distance < 9.0
    assert speed < 0.3
    assert run(signals, GREEN, 0.0, 3)[-1] == FREE


def test_one_look_that_differs_changes_nothing() -> None:
    signals = Signals(CONFIG)
    assert run(signals, GREEN, 5.0, 4)[-1] == FREE
    assert signals.step(RED, True, 5.0) == FREE
    assert run(signals, RED, 5.0, 3)[-1] < FREE
    assert signals.step(GREEN, True, 5.0) < FREE


@pytest.mark.parametrize(("distance", "ticks", "holds"), [(9.0, 40, True), (9.0, 70, False), (20.0, 3, False)])
def test_a_light_out_of_view_near_its_line_holds_for_a_while(distance: float, ticks: int, holds: bool) -> None:
    signals = Signals(CONFIG)
    run(signals, RED._replace(distance=distance), 0.0, 20)
    assert (run(signals, NONE, 0.0, ticks)[-1] < FREE) == holds
    run(signals, RED._replace(distance=distance), 0.0, 20)
    assert run(signals, GREEN, 0.0, 3)[-1] == FREE, "green frees at once"


def test_green_taken_for_yellow_holds_who_stands_for_seconds_only() -> None:
    signals, doubt = Signals(CONFIG), Told(0.9, yellow=0.45, green=0.45, distance=9.0, tells_causes=True)
    run(signals, RED._replace(distance=9.0), 0.0, 20)
    assert run(signals, doubt, 0.0, 40)[-1] == pytest.approx(
        run(Signals(CONFIG), RED._replace(distance=9.0), 0.0, 40)[-1]
    )
    assert run(signals, doubt, 0.0, 30)[-1] == FREE
    assert run(signals, doubt, 3.0, 30)[-1] == FREE, "nor who drives off"
    assert run(signals, RED._replace(distance=9.0), 3.0, 5)[-1] < FREE
    assert run(Signals(CONFIG), doubt._replace(distance=20.0), 6.0, 5)[-1] < FREE, "who drives stops for it"


@pytest.mark.parametrize(("distance", "passes"), [(4.0, True), (25.0, False)])
def test_a_yellow_light_too_near_is_passed(distance: float, passes: bool) -> None:
    signals = Signals(CONFIG)
    yellow = Told(0.9, yellow=0.9, distance=distance, tells_causes=True)
    assert (run(signals, yellow, 8.0, 5)[-1] == FREE) == passes
    assert (run(signals, RED._replace(distance=distance), 8.0, 1)[-1] == FREE) == passes, "it has decided"


def test_a_light_whose_line_lies_behind_holds_no_more() -> None:
    signals = Signals(CONFIG)
    assert run(signals, RED._replace(distance=1.0), 0.0, 40)[-1] == 0.0
    allowed = [signals.step(RED._replace(distance=1.0 - 0.2 * tick), True, 4.0) for tick in range(20)]
    assert allowed[10] == 0.0
    assert allowed[-1] == FREE


def test_it_stands_once_before_a_stop_sign() -> None:
    signals = Signals(CONFIG)
    assert run(signals, SIGN._replace(distance=30.0), 8.0, 10)[-1] == FREE, "far away"
    _, speed = approach(signals, SIGN, 14.0, 6.0, 160)
    assert speed > 0.0, "it stood, and went on"
    assert run(signals, SIGN, 0.0, 100)[-1] == FREE
    run(signals, GREEN, 5.0, 45)
    assert run(signals, SIGN, 5.0, 5)[-1] < FREE, "the next one counts again"


def test_distances_are_smoothed_and_carried_along() -> None:
    line, rng = Line(), np.random.default_rng(0)
    found = [line.update(17.0 - 0.2 * tick + rng.normal(0.0, 1.5), True, 0.2 * (tick > 0)) for tick in range(60)]
    errors = np.array(found) - (17.0 - 0.2 * np.arange(60))
    assert np.abs(errors[20:]).mean() < 0.9


def test_an_ego_that_stands_does_not_creep_on_distances_told_too_far() -> None:
    signals = Signals(CONFIG)
    distance, _ = approach(signals, RED, 30.0, 8.0)
    for _ in range(400):
        assert signals.step(RED._replace(distance=distance + 5.0), True, 0.0) == 0.0


def test_room_is_the_way_to_the_last_free_waypoint() -> None:
    plan = np.stack([np.zeros(4), -2.0 * np.arange(1, 5)], axis=1)
    assert room_before(plan, np.zeros(4, bool)) == math.inf
    assert room_before(plan, np.array([False, False, True, False])) == pytest.approx(4.0)
    assert room_before(plan, np.ones(4, bool)) == 0.0
    assert allowed_speed(6.0, CONFIG) == pytest.approx(6.0)
    assert allowed_speed(0.05, CONFIG) == 0.0
    assert allowed_speed(math.inf, CONFIG) == math.inf
