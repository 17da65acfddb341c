"""Gaps in streams that mind nobody: which are taken in one go, and which are let go by."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.behavior.agent import CLOSE_UP, Expert
from agents.behavior.control import Controller
from agents.behavior.dash import PULL, ROOM, SPARE, _leads_through
from agents.behavior.forecast import COUNT, TIMES
from agents.behavior.manner import Manner
from agents.behavior.speed import follow
from lavsim.types import ActorClass, Role
from tests.agents.test_behavior import Other, straight
from tests.agents.test_behavior_detour import Street

Floats = NDArray[np.float64]
CAR = np.array([int(ActorClass.CAR)], np.uint8)


def stream(speed: float, gap: float, role: Role = Role.SCENARIO) -> list[Other]:
    """Cars that cross the way at x = 60 from the left, without end."""
    cars = [Other(60.0, -40.0 - gap * k, math.pi / 2.0, speed) for k in range(40)]
    for car in cars:
        car.role = role  # type: ignore[attr-defined]
    return cars


@pytest.mark.parametrize(("speed", "gap"), [(20.0, 46.0), (13.0, 34.0), (8.0, 28.0)])
def test_stream_with_gaps_is_crossed_untouched(speed: float, gap: float) -> None:
    road = Street(Expert(straight(), None), stream(speed, gap), speed=8.0).drive(40.0)
    assert road.closest > 0.2
    assert road.x > 80.0


@pytest.mark.parametrize(("speed", "gap"), [(20.0, 22.0), (13.0, 15.0)])
def test_stream_without_is_waited_for_off_its_way(speed: float, gap: float) -> None:
    road = Street(Expert(straight(), None), stream(speed, gap), speed=8.0).drive(30.0)
    assert road.closest > 1.0
    assert road.speed < 0.1


def free(enters: Floats, leaves: Floats, yields: bool = False, start: float = 0.0, speed: float = 0.0) -> bool:
    allowed = np.full(200, 12.0)
    row = np.array([yields])
    return _leads_through(enters[None], leaves[None], CAR, row, start, speed, allowed, SPARE, ROOM, 0.0, PULL, 0.0)[0]


def behind(speed: float, since: float) -> tuple[Floats, Floats]:
    """A car that comes onto the way 10 m ahead of the ego at `since` [s] and drives on along it."""
    at = 10.0 + speed * (TIMES - since)
    comes = since <= TIMES
    return np.where(comes, (at - 5.0) / 0.5, -1.0).clip(-1.0), np.where(comes, (at + 5.0) / 0.5, -1.0)


def test_gap_to_join_must_outlast_who_follows() -> None:
    assert free(*behind(8.0, 4.0)), "it will be as fast by then"
    assert not free(*behind(20.0, 4.0)), "caught up with within the horizon"
    assert free(*behind(20.0, 4.0), yields=True), "who brakes for others may catch up"
    assert not free(*behind(8.0, 2.5)), "it would be beside"


def test_who_has_just_passed_is_followed() -> None:
    assert free(*behind(8.0, 0.0))
    standing = np.full(COUNT, 30.0), np.full(COUNT, 50.0)
    assert free(*standing), "it stops behind it"
    assert not free(np.full(COUNT, 0.0), np.full(COUNT, 10.0)), "there is no room"


def test_who_crosses_ahead_is_not_run_into() -> None:
    """It is 3 m off the way of one who leaves that after 1.5 s: with all its might it would be in it before."""
    enters = np.where(TIMES < 1.5, 6.0, -1.0)
    goes, pull, until = _leads_through(
        enters[None], enters[None] + 8.0, CAR, np.array([False]), 0.0, 2.0, np.full(200, 12.0), 0.0, 0.1, 0.0, PULL, 0.0
    )
    assert goes
    assert pull < 0.5
    assert until == pytest.approx(1.2), "then it pulls away"
    assert 2.0 * 1.2 + 0.5 * pull * 1.2**2 < 2.6, "where it is when the other is last there"


def test_a_gap_once_begun_behind_somebody_close_is_not_given_up_in_turns() -> None:
    args = CAR, np.array([False]), 0.0, 0.1, np.full(200, 12.0), 0.0, 0.1, 0.0, PULL, 0.0
    at = 2.0 + 10.0 * TIMES
    assert _leads_through((at / 0.5)[None], ((at + 5.0) / 0.5)[None], *args)[0]
    slow = np.minimum(2.0 + 1.0 * TIMES, 4.0)
    assert _leads_through((slow / 0.5)[None], ((slow + 5.0) / 0.5)[None], *args)[0], "it keeps behind it"


def test_who_is_followed_closely_does_not_hold_it_back() -> None:
    manner = Manner()
    assert follow(5.0, 3.0, 10.0, 10.0, manner.changed(acceleration=PULL, **CLOSE_UP).pace) > 2.0
    assert follow(5.0, 3.0, 10.0, 10.0, manner.pace) < 2.0


def test_firm_wishes_are_not_smoothed() -> None:
    path = straight()
    firm = Controller().command(path, 5.0, 0.0, 0.0, 0.0, 4.5, True)
    usual = Controller().command(path, 5.0, 0.0, 0.0, 0.0, 4.5)
    assert firm.throttle > 0.75 > usual.throttle > 0.0


@pytest.mark.parametrize("ahead", [-40.0, -25.0])
def test_slot_beside_the_lane_is_left_when_nobody_passes(ahead: float) -> None:
    """Its corner is near the way of who passes: to go on would not get it out of that."""
    cars = [Other(ahead - 26.0 * k, 0.0, 0.0, 14.0) for k in range(5)]
    road = Street(Expert(straight(), None), cars, speed=0.0, y=2.4).drive(25.0)
    assert road.closest > 0.1
    assert road.x > 50.0
