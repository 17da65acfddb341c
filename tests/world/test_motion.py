"""How rows move: arcs, limits, walking, sliding; nothing ever leaves its bounds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.types import DT
from lavsim.world.dynamics import FULL_STEER_CURVATURE, REAR_LENGTH, steer_curvature
from lavsim.world.motion import DRIVEN, FASTEST_WALK, GONE, RESTING, WALKING, integrate

CAR_LIMITS = (12.0, FULL_STEER_CURVATURE, 10.0)


class Row:
    """One row of a world."""

    def __init__(self, motion: int = DRIVEN, speed: float = 0.0, limits: tuple[float, float, float] = CAR_LIMITS):
        self.motion = np.array([motion], np.uint8)
        self.pose, self.body = np.zeros((1, 3)), np.array([[speed, 0.0, 0.0]])
        self.loose, self.limits = np.zeros(1, bool), np.array([limits])
        self.move, self.velocity = np.zeros((1, 3)), np.zeros((1, 3))

    def step(self, first: float, second: float, grip: float = 1.0, rear: float = REAR_LENGTH) -> None:
        command = np.array([[first, second]])
        integrate(
            self.motion, self.pose, self.body, self.loose, command, self.limits, np.array([rear]), grip,
            self.move, self.velocity,
        )  # fmt: skip
        self.pose += self.move


@pytest.mark.parametrize("steer", [0.1, 0.3, 0.5, 1.0])
def test_steady_steer_closes_a_circle_of_the_radius_of_the_fit(steer: float) -> None:
    curvature = steer_curvature(steer)
    car = Row(speed=5.0)
    track = []
    for _ in range(round(2 * math.pi / (curvature * 5.0 * DT))):
        car.step(5.0, curvature)
        track.append(car.pose[0, :2].copy())
    points = np.array(track)
    assert np.hypot(*points[-1]) < 0.3
    assert np.ptp(points[:, 0]) / 2 == pytest.approx(1.0 / curvature, rel=0.01)
    assert points[:, 1].mean() > 0.0  # positive steer turns right: towards +y


@given(speed=st.floats(0.0, 30.0), curvature=st.floats(-0.2, 0.2), yaw=st.floats(-3.2, 3.2))
def test_a_tick_is_the_arc_of_many_small_steps(speed: float, curvature: float, yaw: float) -> None:
    car = Row(speed=speed, limits=(12.0, 1.0, 1e9))
    car.pose[0, 2] = yaw
    car.step(speed, curvature)
    at, heading, slip = np.zeros(2), yaw, math.asin(curvature * REAR_LENGTH)
    for _ in range(200):
        heading += speed * DT / 400 * curvature
        at += speed * DT / 200 * np.array([math.cos(heading + slip), math.sin(heading + slip)])
        heading += speed * DT / 400 * curvature
    assert car.pose[0, :2] == pytest.approx(at, abs=1e-5)
    assert car.pose[0, 2] == pytest.approx(heading, abs=1e-9)
    assert np.hypot(*car.velocity[0, :2]) == pytest.approx(speed, abs=1e-9)


def test_a_bend_taken_too_fast_is_driven_wide_and_wider_when_wet() -> None:
    radii = []
    for grip in (1.0, 0.6):
        car = Row(speed=15.0)
        car.step(15.0, FULL_STEER_CURVATURE, grip)
        radii.append(15.0 / car.velocity[0, 2])
    assert radii == pytest.approx([15.0**2 / 10.0, 15.0**2 / 6.0])


@settings(max_examples=200)
@given(
    motion=st.sampled_from([DRIVEN, WALKING, RESTING, GONE]),
    commands=st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=8),
    grip=st.floats(0.5, 1.0),
)
def test_no_command_leaves_the_physical_bounds(motion: int, commands: list[tuple[float, float]], grip: float) -> None:
    row = Row(motion, 0.0 if motion != DRIVEN else 10.0)
    for first, second in commands:
        before = row.body[0, 0]
        row.step(first, second, grip)
        assert np.isfinite(row.pose).all()
        assert np.isfinite(row.velocity).all()
        if motion == DRIVEN:
            speed, rate = row.body[0, 0], row.body[0, 2]
            assert abs(speed - before) <= 12.0 * grip * DT + 1e-9
            assert abs(rate) <= abs(speed) * FULL_STEER_CURVATURE + 1e-9
            assert abs(rate * speed) <= 10.0 * grip + 1e-6
        assert np.hypot(*row.velocity[0, :2]) <= max(FASTEST_WALK, abs(row.body[0, 0])) + 1e-9


def test_a_command_that_is_no_number_leaves_speed_and_straightens() -> None:
    car = Row(speed=8.0)
    car.step(math.nan, math.inf)
    assert car.body[0].tolist() == [8.0, 0.0, 0.0]


def test_walkers_keep_their_velocity_and_who_is_gone_stays() -> None:
    walker, gone = Row(WALKING), Row(GONE, 3.0)
    walker.step(0.0, 2.0)
    gone.step(5.0, 5.0)
    assert walker.move[0, :2].tolist() == [0.0, 2.0 * DT]
    assert walker.velocity[0, :2].tolist() == [0.0, 2.0]
    assert not gone.move.any()
    assert not gone.body.any()


@pytest.mark.parametrize("motion", [DRIVEN, RESTING])
def test_a_sliding_car_comes_to_rest_on_its_tyres(motion: int) -> None:
    car = Row(motion)
    car.body[0], car.loose[0] = (4.0, 5.0, 2.0), True
    speeds = []
    for _ in range(40):
        car.step(0.0, 0.0)
        speeds.append(np.hypot(*car.velocity[0, :2]))
    assert np.all(np.diff(speeds) <= 1e-12)
    assert not car.body.any()
    assert not car.loose[0]


def test_a_walker_turns_to_where_it_goes_and_keeps_its_heading_while_it_stands() -> None:
    walker = Row(WALKING)
    for _ in range(12):
        walker.step(-1.4, -0.01)
        assert abs(walker.move[0, 2]) <= 6.0 * DT + 1e-12
    assert walker.pose[0, 2] == pytest.approx(-math.pi, abs=0.01)
    walker.step(0.05, 0.05)
    assert walker.pose[0, 2] == pytest.approx(-math.pi, abs=0.01)
