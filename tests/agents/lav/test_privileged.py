"""The teacher's agent: its weights ship, its sensors fit its grid, lines hold it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.behavior.path import PathTracker, path_through
from agents.behavior.road import StopPoint
from agents.lav.config import find_preset
from agents.lav.privileged import TEACHER, PrivilegedLavAgent, bev_sensor
from agents.lav.told import StopLines, told_vehicles
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.errors import ConfigError
from lavsim.sensors.base import make_sensor
from lavsim.types import ActorClass, LightState


def truth(x: float, state: LightState = LightState.RED) -> dict[str, np.ndarray]:
    return {
        "xyz": np.array([[x, 0.0, 0.0], [x + 10.0, -3.5, 0.0], [x - 5.0, 0.0, 0.0], [x + 8.0, 2.0, 0.0]]),
        "yaw": np.array([0.0, np.pi, 0.0, 0.0]),
        "sizes": np.tile([4.8, 1.9, 1.5], (4, 1)),
        "classes": np.array([ActorClass.CAR, ActorClass.CAR, ActorClass.CAR, ActorClass.WALKER]),
        "lights": np.array([state]),
    }


def lines(light: int) -> StopLines:
    points = np.stack([np.arange(200.0), np.zeros(200), np.zeros(200)], axis=1)
    path = path_through(points, np.zeros(200), np.full(200, 4, np.int8))
    return StopLines(PathTracker(path), [StopPoint(60.0, light)])


def test_the_weights_that_ship_are_a_tiny_teacher() -> None:
    weights = read_weights(TEACHER)
    assert (weights.stage, weights.config.name) == ("bev", "tiny")
    agent = PrivilegedLavAgent(None)
    assert [sensor["id"] for sensor in agent.sensors()] == ["truth", "bev", "gps", "imu", "speed"]


def test_weights_of_another_stage_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.safetensors"
    write_weights(path, Weights("perception", find_preset("micro"), {}))
    with pytest.raises(ConfigError, match="stage 'bev', got those of 'perception'"):
        PrivilegedLavAgent(str(path))


@pytest.mark.parametrize("preset", ["tiny", "small", "micro"])
def test_labels_cover_the_grid(preset: str) -> None:
    config = find_preset(preset)
    spec = make_sensor(bev_sensor(config)).spec
    factor = round(config.grid.cell * 4.0)
    assert spec.shape == (5, config.grid.rows * factor, config.grid.cols * factor)  # type: ignore[union-attr]


def test_only_vehicles_ahead_are_looked_at() -> None:
    rows, poses = told_vehicles(truth(50.0), find_preset("tiny"))
    assert rows.tolist() == [0, 1]
    assert poses[1].tolist() == pytest.approx([-3.5, -10.0, -np.pi], abs=1e-5) or poses[1, 2] == pytest.approx(np.pi)


@pytest.mark.parametrize(
    ("x", "speed", "state", "stops"),
    [
        (42.0, 10.0, LightState.RED, True),
        (42.0, 10.0, LightState.GREEN, False),
        (10.0, 10.0, LightState.RED, False),
        (56.5, 0.0, LightState.RED, True),
        (52.0, 0.5, LightState.RED, False),
        (55.0, 10.0, LightState.YELLOW, False),
        (70.0, 10.0, LightState.RED, False),
    ],
)
def test_red_holds_and_yellow_holds_who_can_stop(x: float, speed: float, state: LightState, stops: bool) -> None:
    assert lines(0).must_stop(truth(x, state), speed) == stops


def test_a_stop_sign_holds_until_it_has_stood() -> None:
    sign = lines(-1)
    assert sign.must_stop(truth(52.0), 6.0)
    sign.must_stop(truth(55.0), 0.0)
    assert not sign.must_stop(truth(55.2), 1.5)
