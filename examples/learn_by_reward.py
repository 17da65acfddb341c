"""Reinforcement learning with the environment: a linear policy learns to drive by the cross-entropy method."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

import leaderboard.gym_ids  # noqa: F401 - enters the environments' ids

Floats = NDArray[np.float64]


def drive(env: gymnasium.Env, policy: Floats, steps: int) -> float:
    """The reward of an episode in which `policy` (2, features) drives; it sees the state and a constant."""
    observation, _ = env.reset(seed=0)
    total = 0.0
    for _ in range(steps):
        features = np.append(np.clip(observation["state"] / 10.0, -1.0, 1.0), 1.0)
        observation, reward, terminated, truncated, _ = env.step(np.tanh(policy @ features).astype(np.float32))
        total += float(reward)
        if terminated or truncated:
            break
    return total


def improve(env: gymnasium.Env, rounds: int, tries: int, steps: int) -> tuple[Floats, list[float]]:
    """The best policy and the best reward of each round: draw around the mean, keep a quarter, move the mean there."""
    assert env.observation_space["state"].shape is not None  # type: ignore[index]
    shape = (2, env.observation_space["state"].shape[0] + 1)  # type: ignore[index]
    rng = np.random.default_rng(0)
    mean, spread = np.zeros(shape), np.full(shape, 0.5)
    mean[0, -1] = 0.3  # a little throttle to begin with
    best, curve = mean, []
    for _ in range(rounds):
        drawn = mean + spread * rng.standard_normal((tries, *shape))
        drawn[0] = mean
        rewards = np.array([drive(env, policy, steps) for policy in drawn])
        elite = drawn[np.argsort(rewards)[-max(tries // 4, 2) :]]
        mean, spread = elite.mean(axis=0), elite.std(axis=0) + 0.02
        best = drawn[int(rewards.argmax())]
        curve.append(float(rewards.max()))
        print(f"best of {tries}: {curve[-1]:.2f}")
    return best, curve


def main(arguments: Sequence[str] | None = None) -> int:
    """Learns on a road without traffic and keeps the policy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/learn-by-reward"))
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--tries", type=int, default=16)
    parser.add_argument("--steps", type=int, default=100)
    given = parser.parse_args(arguments)
    env = gymnasium.make("lavsim/LaneKeeping-v0", routes=Path(__file__).with_name("short.xml"), route_ids="0")
    policy, curve = improve(env, given.rounds, given.tries, given.steps)
    env.close()
    given.out.mkdir(parents=True, exist_ok=True)
    np.savez(given.out / "policy.npz", policy=policy, curve=curve)
    print(given.out / "policy.npz")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
