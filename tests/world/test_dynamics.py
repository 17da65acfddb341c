"""The fitted vehicle model against the tables of the reference."""

import itertools
import math

import numpy as np
import pytest

from lavsim.types import DT
from lavsim.world.dynamics import DRIVEN, GONE, REAR_LENGTH, WALKING, integrate, speed_after, steer_curvature


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


@pytest.mark.parametrize(
    ("throttle", "kmh", "seconds"),
    [
        (0.5, 30, 11.1),
        (0.6, 50, 9.6),
        (0.75, 30, 2.6),
        (0.75, 50, 4.8),
        (0.75, 80, 9.4),
        (1.0, 50, 2.5),
        (1.0, 80, 5.0),
    ],
)
def test_acceleration_takes_the_time_of_the_table(throttle: float, kmh: float, seconds: float) -> None:
    assert drive(0.0, throttle, 0.0, kmh / 3.6)[0] == pytest.approx(seconds, rel=0.05, abs=0.051)


@pytest.mark.parametrize(("kmh", "metres"), [(20, 0.7), (30, 2.3), (50, 10.6), (80, 30.5)])
def test_full_brake_stops_in_the_distance_of_the_table(kmh: float, metres: float) -> None:
    assert drive(kmh / 3.6, 0.0, 1.0, 0.0)[1] == pytest.approx(metres, rel=0.05, abs=0.1)


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


def test_steady_steer_closes_a_circle() -> None:
    curvature = steer_curvature(0.5)
    pose, body = np.zeros((1, 3)), np.array([[5.0, 0.0, 0.0]])
    command, out = np.array([[5.0, curvature]]), np.zeros((1, 5))
    track = []
    for _ in range(round(2 * math.pi / (curvature * 5.0 * DT))):
        integrate(np.array([DRIVEN], np.uint8), pose, body, command, np.array([REAR_LENGTH]), out)
        pose += out[:, :3]
        track.append(pose[0, :2].copy())
    points = np.array(track)
    assert np.hypot(*points[-1]) < 0.3
    assert np.ptp(points[:, 0]) / 2 == pytest.approx(1.0 / curvature, rel=0.01)
    assert points[:, 1].mean() > 0.0  # positive steer turns right: towards +y


def test_walkers_keep_their_velocity_and_who_is_gone_stays() -> None:
    motion = np.array([WALKING, GONE], np.uint8)
    out = np.zeros((2, 5))
    integrate(motion, np.zeros((2, 3)), np.zeros((2, 3)), np.array([[0.0, 2.0], [5.0, 5.0]]), np.ones(2), out)
    assert out[0].tolist() == [0.0, 2.0 * DT, 0.0, 0.0, 2.0]
    assert not out[1].any()


def test_a_sliding_car_comes_to_rest_on_its_tyres() -> None:
    pose, body = np.zeros((1, 3)), np.array([[4.0, 5.0, 2.0]])
    out = np.zeros((1, 5))
    for _ in range(40):
        integrate(np.array([DRIVEN], np.uint8), pose, body, np.zeros((1, 2)), np.ones(1), out)
    assert not body[0, :2].any()
