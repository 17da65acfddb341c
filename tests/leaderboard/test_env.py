"""Routes as a gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from lavsim.errors import ConfigError, UnknownName
from leaderboard.env import STATE, Reward, RouteEnv
from leaderboard.env_actions import Controls, Waypoints
from tests.leaderboard.test_evaluator import route_file


def short(folder: Path, **changes: Any) -> RouteEnv:
    """45 m straight on, alone."""
    values: dict[str, Any] = {"routes": route_file(folder, 1), "observe": ("state",), "traffic": "empty"}
    return RouteEnv(**values | changes)


def driven(env: RouteEnv, action: Any, seed: int = 0, steps: int = 200) -> list[Any]:
    observation, _ = env.reset(seed=seed)
    found = [(observation, 0.0, False, False, {})]
    for _ in range(steps):
        found.append(env.step(action(found[-1][0])))
        if found[-1][2] or found[-1][3]:
            break
    return found


def straight_on(observation: dict[str, Any]) -> np.ndarray:
    return np.array([0.6 if observation["state"][0] < 8.0 else 0.0, 0.0], np.float32)


def test_the_environment_is_as_gymnasium_asks(tmp_path: Path) -> None:
    check_env(short(tmp_path, render_mode="rgb_array"))


def test_sensors_are_observed_as_their_spaces_say(tmp_path: Path) -> None:
    env = short(tmp_path, observe=("state", "bev", "camera", "lidar"))
    observation, _ = env.reset(seed=1)
    assert set(observation) == {"state", "bev", "camera", "lidar"}
    assert env.observation_space.contains(observation)


def test_the_target_is_rewarded_and_ends_the_episode(tmp_path: Path) -> None:
    steps = driven(short(tmp_path), straight_on)
    _, reward, terminated, truncated, info = steps[-1]
    assert (terminated, truncated, info["ending"]) == (True, False, "completed")
    assert reward > 9.0
    assert sum(step[1] for step in steps) == pytest.approx(10.0 + 0.1 * 45.0, abs=1.5)


def test_leaving_the_lane_costs(tmp_path: Path) -> None:
    reward = Reward(progress=0.0, completed=0.0, offset=-1.0)
    kept = sum(step[1] for step in driven(short(tmp_path, reward=reward), straight_on, steps=20))
    left = sum(step[1] for step in driven(short(tmp_path, reward=reward), lambda _: np.array([0.8, 0.5]), steps=20))
    assert left < kept - 0.2


def test_time_truncates(tmp_path: Path) -> None:
    steps = driven(short(tmp_path, max_seconds=2.0), lambda _: np.array([-1.0, 0.0]))
    assert steps[-1][2:4] == (False, True)
    assert 15 < len(steps) < 25


def test_one_seed_is_one_episode(tmp_path: Path) -> None:
    env = short(tmp_path, traffic="lav", routes="quick", observe=("state", "bev"))
    first, second = (driven(env, straight_on, seed=3, steps=10) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a[0]["state"].tobytes() == b[0]["state"].tobytes()
        assert a[0]["bev"].tobytes() == b[0]["bev"].tobytes()
        assert a[1:4] == b[1:4]


def test_waypoints_are_driven_to(tmp_path: Path) -> None:
    """Points on the route ahead of the ego are an action that follows it."""

    def along(observation: dict[str, Any]) -> np.ndarray:
        points = observation["state"][4:24].reshape(10, 2)[:4]
        return (points / 12.0).astype(np.float32)

    env = short(tmp_path, actions="waypoints")
    steps = driven(env, along)
    assert steps[-1][4]["ending"] == "completed"
    assert env.action_space.shape == (4, 2)


def test_actions_become_controls() -> None:
    env_controls = Controls()
    ego: Any = None
    assert env_controls.control(np.array([-0.5, 2.0]), ego).brake == 0.5
    assert env_controls.control(np.array([0.5, 2.0]), ego).steer == 1.0
    standing: Any = type("Ego", (), {"forward_speed": 3.0})
    assert Waypoints().control(np.zeros((4, 2)), standing).brake == 1.0


def test_ids_are_known_to_gymnasium() -> None:
    name = "leaderboard.gym_ids:lavsim/LaneKeeping-v0"
    observation, info = gymnasium.make(name).reset(seed=0)
    assert observation["state"].shape == (STATE,)
    assert info["town"] == "eu_small_a"
    observation, info = gymnasium.make_vec(name, num_envs=2, vectorization_mode="sync").reset(seed=0)
    assert observation["state"].shape == (2, STATE)
    assert info["town"].tolist() == ["eu_small_a"] * 2


def test_many_drive_side_by_side(tmp_path: Path) -> None:
    file, count = route_file(tmp_path, 1), 2
    envs = gymnasium.vector.AsyncVectorEnv(
        [lambda: RouteEnv(routes=file, observe=("state",), traffic="empty") for _ in range(count)], context="spawn"
    )
    try:
        observation, _ = envs.reset(seed=[0, 1])
        assert observation["state"].shape == (count, STATE)
        _, rewards, *_ = envs.step(np.full((count, 2), 0.5, np.float32))
        assert rewards.shape == (count,)
    finally:
        envs.close()


def test_mistakes_are_named(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="camera"):
        short(tmp_path, observe=("camra",))
    with pytest.raises(UnknownName, match="controls"):
        short(tmp_path, actions="control")
    with pytest.raises(ConfigError, match="no fixed size"):
        short(tmp_path, observe=({"type": "sensor.lidar.ray_cast", "id": "top"},))
    with pytest.raises(ConfigError, match="frame_skip"):
        short(tmp_path, frame_skip=0)
    with pytest.raises(ConfigError, match="reset"):
        short(tmp_path).step(np.zeros(2, np.float32))


@pytest.mark.slow
def test_cross_entropy_learns_to_keep_the_lane() -> None:
    """A linear policy on the state, improved by the cross-entropy method, beats where it began."""
    env = RouteEnv(routes="quick", traffic="empty", hazards=False, observe=("state",), max_seconds=10.0, frame_skip=4)
    rng = np.random.default_rng(0)
    mean, deviation = np.zeros(2 * 6), np.ones(2 * 6) * 0.5

    def returns(weights: np.ndarray) -> float:
        def act(observation: dict[str, Any]) -> np.ndarray:
            state = observation["state"]
            features = np.array([state[0] / 8.0 - 1.0, state[1], state[2], state[3], state[7] / 4.0, 1.0])
            return np.tanh(weights.reshape(2, 6) @ features).astype(np.float32)

        return float(sum(step[1] for step in driven(env, act, seed=1, steps=60)))

    history = []
    for _ in range(6):
        drawn = mean + deviation * rng.standard_normal((16, len(mean)))
        scores = np.array([returns(weights) for weights in drawn])
        best = drawn[np.argsort(scores)[-4:]]
        mean, deviation = best.mean(axis=0), best.std(axis=0) + 0.05
        history.append(float(scores.mean()))
    assert history[-1] > history[0] + 1.0
