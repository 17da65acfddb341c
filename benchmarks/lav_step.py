"""What a step of LAV's agent costs, and which part of it how much, in processor time of one thread.

    python -m benchmarks.lav_step [--route 8] [--ticks 400] [--agent-config FILE]

Drives the beginning of a route of `validation` in this process. The first ten ticks, in which caches fill, don't count.
Parts are counted at the ticks in which they run: networks look every other tick (`drive.look_every`).
"""

from __future__ import annotations

import argparse
import time as clock
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from agents.lav.driving import Driver
from agents.lav.others import Others
from agents.lav.perceive import Perceiver
from agents.lav.readings import Waypointer
from lavsim.agent import AgentSpec, Readings, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import run_episode
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from leaderboard.routes import read_routes, select_routes
from leaderboard.rules import get_rules

WARM = 10  # ticks
PARTS = (
    (Perceiver, "paint", "painting: segmentation, projection"),
    (Perceiver, "see", "perception: pillars, backbone, boxes"),
    (Perceiver, "foresee", "plan and forecasts"),
    (Perceiver, "brake", "brake network"),
    (Others, "update", "who is there"),
    (Waypointer, "update", "filter and goals"),
    (Driver, "step", "collision check and control"),
)


class Timed(InProcessAgent):
    """An agent whose steps are timed."""

    def __init__(self, spec: AgentSpec) -> None:
        super().__init__(spec)
        self.seconds: list[float] = []

    def step(self, readings: Readings, time: float) -> Control:
        begun = clock.process_time()
        control = super().step(readings, time)
        self.seconds.append(clock.process_time() - begun)
        return control


def timed(method: Callable[..., Any], seconds: list[float]) -> Callable[..., Any]:
    """The method, with the processor time of each call noted."""

    def call(*args: Any, **kwargs: Any) -> Any:
        begun = clock.process_time()
        result = method(*args, **kwargs)
        seconds.append(clock.process_time() - begun)
        return result

    return call


def begin(route: str, agent_config: str | None) -> tuple[Simulation, Timed]:
    """The simulation of a route of `validation`, and the agent set up for it."""
    entry, rules = select_routes(read_routes("validation"), route)[0], get_rules("1.0")
    simulation = Simulation(
        DriveSpec(
            town=entry.town,
            route_id=entry.id,
            keypoints=entry.keypoints,
            weather=entry.weather,
            scenarios=entry.scenarios,
            traffic=entry.traffic or "lav",
            rules=rules.version,
            generation=rules.generation,
        )
    )
    agent = Timed(AgentSpec("agents.lav:LavAgent", agent_config))
    agent.start(plan_of(simulation.route, simulation.town), rules.plan_spacing)
    return simulation, agent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--route", default="8")
    parser.add_argument("--ticks", type=int, default=400)
    parser.add_argument("--agent-config", default=None)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    calls: dict[str, list[float]] = defaultdict(list)
    for owner, name, label in PARTS:
        setattr(owner, name, timed(getattr(owner, name), calls[label]))
    simulation, agent = begin(arguments.route, arguments.agent_config)
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    begun = clock.process_time()
    run_episode(simulation, agent, [], suite, max_ticks=arguments.ticks)
    world = clock.process_time() - begun - sum(agent.seconds)
    step = 1e3 * np.array(agent.seconds[WARM:])
    print(f"route {arguments.route} of validation, {len(agent.seconds)} ticks, milliseconds of one core")
    for label, seconds in calls.items():
        spent = 1e3 * np.array(seconds[WARM:])
        print(f"  {label:40s} {np.median(spent):6.1f} median, {spent.sum() / len(step):5.1f} a tick")
    print(f"step: mean {step.mean():.1f}, median {np.median(step):.1f}, p95 {np.percentile(step, 95):.1f}")
    print(f"world and sensors: {1e3 * world / len(agent.seconds):.1f} a tick")


if __name__ == "__main__":
    main()
