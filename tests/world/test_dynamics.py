"""The fitted vehicle model against the tables of the reference."""

import itertools

import numpy as np
import pytest

from lavsim.types import DT, ActorClass
from lavsim.world.dynamics import (
    FULL_STEER_CURVATURE,
    HANDLING,
    REVERSE_TOP_SPEED,
    road_grip,
    speed_after,
    steer_curvature,
)
from lavsim.world.weather import Weather


def drive(speed: float, throttle: float, brake: float, until: float, limit: float = 120.0) -> tuple[float, float]:
    """Time [s] and distance [m] until the speed passes `until` [m/s]."""
    time = distance = 0.0
    rising = until > speed
    while (speed < until) if rising else (speed > until):
        after = speed_after(speed, throttle, brake, False)
        distance += after * DT
        speed, time = after, time + DT
        assert time < limit
    return time, distance


@pytest.mark.parametrize(
    ("steer", "radius"), [(0.1, 36.0), (0.2, 18.0), (0.3, 12.0), (0.5, 7.3), (0.7, 5.2), (0.8, 4.6), (1.0, 3.7)]
)
def test_turn_radius_is_that_of_the_fit(steer: float, radius: float) -> None:
    assert 1.0 / steer_curvature(steer) == pytest.approx(radius, rel=0.02)
    assert steer_curvature(-steer) == -steer_curvature(steer)


# The tables of the reference, to two digits; `settles` in place of a time: the speed where drag and engine balance.
@pytest.mark.parametrize(
    ("throttle", "kmh", "seconds"),
    [
        (0.5, 30, 11.1),
        (0.5, 50, 30.7),
        (0.6, 30, 4.9),
        (0.6, 50, 9.6),
        (0.6, 80, 18.8),
        (0.75, 30, 2.6),
        (0.75, 50, 4.8),
        (0.75, 80, 9.4),
        (1.0, 30, 1.3),
        (1.0, 50, 2.5),
        (1.0, 80, 5.0),
    ],
)
def test_acceleration_takes_the_time_of_the_table(throttle: float, kmh: float, seconds: float) -> None:
    # Times come in ticks and the table in tenths of a second: half of either on top of the 5 %.
    assert drive(0.0, throttle, 0.0, kmh / 3.6)[0] == pytest.approx(seconds, abs=0.05 * seconds + 0.05)


@pytest.mark.parametrize(
    ("throttle", "accelerations"), [(0.5, (1.4, 1.0, 0.4, 0.2)), (0.6, (2.2, 1.9, 1.4, 1.0)),
                                    (0.75, (3.9, 3.5, 2.8, 2.2)), (1.0, (7.6, 6.8, 5.4, 4.1))],
)  # fmt: skip
def test_acceleration_at_a_speed_is_that_of_the_table(throttle: float, accelerations: tuple[float, ...]) -> None:
    for kmh, expected in zip((0, 10, 30, 50), accelerations, strict=True):
        got = (speed_after(kmh / 3.6, throttle, 0.0, False) - kmh / 3.6) / DT
        assert got == pytest.approx(expected, abs=0.05 * expected + 0.05)


def test_two_fifths_of_throttle_settle_near_14_kmh() -> None:
    speed = 0.0
    for _ in range(4000):
        speed = speed_after(speed, 0.4, 0.0, False)
    assert 3.6 * speed == pytest.approx(14.0, rel=0.05)


@pytest.mark.parametrize(
    ("kmh", "seconds", "metres"), [(20, 0.35, 0.7), (30, 0.55, 2.3), (50, 1.35, 10.6), (80, 2.45, 30.5)]
)
def test_full_brake_stops_in_the_time_and_distance_of_the_table(kmh: float, seconds: float, metres: float) -> None:
    time, distance = drive(kmh / 3.6, 0.0, 1.0, 0.3 / 3.6)  # the fit only creeps towards zero: 0.3 km/h is at rest
    assert time == pytest.approx(seconds, rel=0.05)
    assert distance == pytest.approx(metres, abs=0.05 * metres + 0.05)


def test_half_the_pedal_brakes_half_as_hard() -> None:
    full, half = ((15.0 - speed_after(15.0, 0.0, brake, False)) / DT for brake in (1.0, 0.5))
    assert half == pytest.approx(full / 2.0)


def test_throttle_below_the_dead_band_coasts() -> None:
    assert speed_after(10.0, 0.29, 0.0, False) == pytest.approx(10.0 - 0.6 * DT)
    assert speed_after(0.0, 0.29, 0.0, False) == 0.0


def test_more_throttle_is_never_slower_and_stays_bounded_at_any_speed() -> None:
    for speed in np.linspace(0.0, 80.0, 60):
        after = [speed_after(speed, t, 0.0, False) for t in np.linspace(0.3, 1.0, 15)]
        assert all(a <= b + 1e-9 for a, b in itertools.pairwise(after))
        assert after[-1] < speed + 1.0


def test_brake_wins_over_throttle_and_reverse_drives_backward() -> None:
    assert speed_after(10.0, 1.0, 1.0, False) < 10.0
    speed = 0.0
    for _ in range(40):
        speed = speed_after(speed, 0.8, 0.0, True)
    assert speed < -2.0
    assert abs(speed_after(5.0, 1.0, 1.0, True)) < 5.0


def test_reverse_is_capped_and_forward_motion_stops_first() -> None:
    speed = 6.0
    passed_zero = False
    for _ in range(600):
        after = speed_after(speed, 1.0, 0.0, True)
        passed_zero |= after == 0.0
        speed = after
    assert passed_zero
    assert speed == -REVERSE_TOP_SPEED


@pytest.mark.parametrize("kind", [ActorClass.TRUCK, ActorClass.BUS])
def test_heavy_vehicles_have_about_half_of_the_acceleration(kind: ActorClass) -> None:
    heavy = HANDLING[kind]
    car = speed_after(5.0, 0.75, 0.0, False) - 5.0
    got = speed_after(5.0, 0.75, 0.0, False, heavy.acceleration, heavy.braking, heavy.top_speed) - 5.0
    assert 0.4 <= got / car <= 0.6
    assert heavy.curvature < HANDLING[ActorClass.CAR].curvature == FULL_STEER_CURVATURE


def test_a_bicycle_never_passes_its_cap_but_rolls_down_to_it() -> None:
    bicycle = HANDLING[ActorClass.BICYCLE]
    speed = 0.0
    for _ in range(2000):
        speed = speed_after(speed, 1.0, 0.0, False, bicycle.acceleration, bicycle.braking, bicycle.top_speed)
    assert speed == pytest.approx(bicycle.top_speed)
    faster = speed_after(14.0, 1.0, 0.0, False, bicycle.acceleration, bicycle.braking, bicycle.top_speed)
    assert 13.9 < faster < 14.0


def test_wet_roads_grip_less() -> None:
    assert road_grip(Weather()) == 1.0
    wet, puddles = road_grip(Weather(wetness=100.0)), road_grip(Weather(precipitation_deposits=100.0))
    assert wet == pytest.approx(0.7)
    assert puddles == pytest.approx(0.55)
    shares = [road_grip(Weather(precipitation=p, precipitation_deposits=d)) for p in (0, 50, 100) for d in (0, 50, 100)]
    assert min(shares) >= 0.55 - 1e-12
    dry = drive(50.0 / 3.6, 0.0, 1.0, 0.0)[1]
    speed, slid = 50.0 / 3.6, 0.0
    while speed > 0.0:
        speed = speed_after(speed, 0.0, 1.0, False, puddles, puddles)
        slid += speed * DT
    assert 1.5 * dry < slid < 2.2 * dry
