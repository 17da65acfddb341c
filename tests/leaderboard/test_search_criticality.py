"""Time to contact, required deceleration and headway against what can be worked out on paper."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.types import ActorClass, Role
from leaderboard.search.criticality import MOST_BRAKING, CriticalityObserver, criticality_of
from tests.snapshots import EGO, Body, snapshot_of

LENGTH = 0.5 * (EGO.size[0] + 4.5)  # [m] between middles of the ego and a car when bumpers touch


def moment(*others: Body, speed: float = 10.0) -> tuple[float, float, float]:
    """Time to contact, required deceleration and headway of one snapshot."""
    observer = CriticalityObserver(from_hazard=False)
    ego = Body(id=1, role=Role.EGO, size=EGO.size, blueprint=EGO.blueprint, speed=speed)
    observer.observe(snapshot_of([ego, *others]))
    first, second, third = observer.series[0].tolist()
    return first, second, third


@settings(max_examples=30, deadline=None)
@given(seconds=st.floats(0.5, 3.5), speed=st.floats(4.0, 14.0))
def test_before_a_standing_car_they_are_the_textbook_ttc_drac_and_headway(seconds: float, speed: float) -> None:
    gap = seconds * speed
    time, braking, headway = moment(Body(id=2, x=gap + LENGTH), speed=speed)
    assert time == pytest.approx(seconds, abs=0.06)
    assert headway == pytest.approx(seconds, abs=0.06)
    assert braking == pytest.approx(min(speed**2 / (2.0 * gap), MOST_BRAKING), abs=0.15)


def test_behind_a_slower_leader_only_the_difference_of_speeds_counts() -> None:
    time, braking, headway = moment(Body(id=2, x=10.0 + LENGTH, speed=6.0), speed=12.0)
    assert time == pytest.approx(10.0 / 6.0, abs=0.06)
    assert braking == pytest.approx(6.0**2 / 20.0, abs=0.1)
    assert headway == pytest.approx(10.0 / 12.0, abs=0.06)


def test_nobody_on_the_way_needs_no_braking() -> None:
    assert moment(Body(id=2, x=20.0, y=5.0)) == (math.inf, 0.0, math.inf)
    assert moment(Body(id=2, x=200.0)) == (math.inf, 0.0, math.inf)


def test_a_walker_who_will_have_crossed_needs_no_braking_and_one_who_will_not_does() -> None:
    def walker(y: float) -> Body:
        return Body(
            id=2, x=25.0, y=y, yaw=math.pi / 2.0, speed=3.0, kind=ActorClass.WALKER, size=(0.4, 0.4, 1.8),
            blueprint="walker.pedestrian.0002", role=Role.SCENARIO,
        )  # fmt: skip

    assert moment(walker(-2.0))[:2] == (math.inf, 0.0)
    time, braking, _ = moment(walker(-7.0))
    assert 1.5 < time < 3.0
    assert 0.0 < braking < 4.0


def test_what_comes_from_behind_has_a_time_to_contact_and_no_braking() -> None:
    time, braking, headway = moment(Body(id=2, x=-20.0, speed=20.0))
    assert time == pytest.approx((20.0 - LENGTH) / 10.0, abs=0.06)
    assert (braking, headway) == (0.0, math.inf)


def test_what_is_too_near_needs_all() -> None:
    assert moment(Body(id=2, x=LENGTH + 3.0), speed=15.0)[1] == MOST_BRAKING


def test_a_standing_ego_needs_none() -> None:
    assert moment(Body(id=2, x=LENGTH + 1.0), speed=0.0)[1:] == (0.0, math.inf)


def test_cars_parked_at_the_kerb_and_what_lies_flat_are_left_out() -> None:
    assert moment(Body(id=2, x=12.0, role=Role.PARKED)) == (math.inf, 0.0, math.inf)
    flat = Body(id=3, x=12.0, kind=ActorClass.PROP, role=Role.PROP, blueprint="static.prop.dirtdebris01")
    assert moment(flat) == (math.inf, 0.0, math.inf)


def test_the_margin_falls_as_contact_comes_nearer() -> None:
    margins = []
    for gap in (60.0, 30.0, 20.0, 12.0, 7.0):
        critical, begun = criticality_of([snapshot_of([EGO_MOVING, Body(id=2, x=gap + LENGTH)])], from_hazard=False)
        margins.append(critical.margin)
        assert begun == -1
    assert margins[0] == 1.0
    assert np.all(np.diff(margins) < 0.0)


def test_nothing_counts_before_a_hazard() -> None:
    critical, begun = criticality_of([snapshot_of([EGO_MOVING, Body(id=2, x=12.0)])])
    assert (critical.margin, begun) == (1.0, -1)


EGO_MOVING = Body(id=1, role=Role.EGO, size=EGO.size, blueprint=EGO.blueprint, speed=10.0)
