"""Bursts of steering noise: short, bound to the speed, the same for the same draws; the wish stays known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.agent import Track
from lavsim.dataset.noise import ControlNoise, DisturbedAgent
from lavsim.random import Draws
from lavsim.types import DT, Control
from lavsim.world.dynamics import steer_curvature

DRAWS = Draws.of_seed(4)
TICKS = 8_000  # 80 spans


def steers(noise: ControlNoise, speed: float, draws: Draws = DRAWS) -> np.ndarray:
    return np.array([noise.steer(draws, tick, speed) for tick in range(TICKS)])


def bursts(steer: np.ndarray) -> list[np.ndarray]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], steer != 0, [0]])))
    return [steer[a:b] for a, b in edges.reshape(-1, 2)]


def test_bursts_are_as_many_and_as_long_as_told_and_of_one_side_each() -> None:
    found = bursts(steers(ControlNoise(), 8.0))
    assert len(found) == pytest.approx(40, abs=12)
    for burst in found:
        assert 0.8 - 2 * DT <= len(burst) * DT <= 2.0 + DT
        assert (burst > 0).all() or (burst < 0).all()
        top = int(np.argmax(np.abs(burst)))
        assert (np.diff(np.abs(burst[: top + 1])) >= 0).all()
        assert (np.diff(np.abs(burst[top:])) <= 0).all()
    assert {bool(burst[0] > 0) for burst in found} == {True, False}


@pytest.mark.parametrize("speed", [4.0, 8.0, 20.0])
def test_a_burst_pushes_sideways_as_hard_at_any_speed(speed: float) -> None:
    noise = ControlNoise(most=1.0, push=2.0)
    push = np.abs(steers(noise, speed)).max() * steer_curvature(1.0) * speed**2
    assert 1.5 < push <= 2.0


def test_a_slow_car_is_not_steered_to_the_limit_and_one_that_stands_not_at_all() -> None:
    assert np.abs(steers(ControlNoise(), 1.0)).max() <= 0.3
    assert not steers(ControlNoise(), 0.2).any()


def test_no_share_no_noise_and_a_seed_of_its_own() -> None:
    assert not steers(ControlNoise(share=0.0), 8.0).any()
    assert not np.array_equal(steers(ControlNoise(), 8.0), steers(ControlNoise(), 8.0, Draws.of_seed(5)))


class Expert:
    track = Track.PRIVILEGED

    def start(self, plan: object, spacing: float | None = None) -> None: ...

    def sensors(self) -> list[dict[str, object]]:
        return [{"type": "sensor.lavsim.truth", "id": "truth"}]

    def step(self, readings: object, time: float) -> Control:
        return Control(throttle=0.5, steer=0.9)

    def labels(self) -> dict[str, object]:
        return {"brake": 0}

    def close(self) -> None: ...


@given(st.integers(0, 5000))
def test_the_world_gets_the_noise_and_the_wish_stays_known(tick: int) -> None:
    noise = ControlNoise(share=1.0)
    agent = DisturbedAgent(Expert(), noise, DRAWS, lambda: 8.0)
    control = agent.step({}, tick * DT)
    assert control.steer == min(0.9 + noise.steer(DRAWS, tick, 8.0), 1.0)
    assert control.throttle == 0.5
    assert agent.wish == Control(throttle=0.5, steer=0.9)
    assert agent.labels() == {"brake": 0}
