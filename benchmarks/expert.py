"""What a tick of the expert costs: `python benchmarks/expert.py [--town us_large_a] [--ticks 2400] [--manner expert]`.

It drives among 100 vehicles and 50 walkers. Processor time of its step alone (reading the truth is stated beside it),
so that other work on the machine counts little.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from agents.behavior import BehaviorAgent
from lavsim.agent import plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.dataset.plan import CollectPlan
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation

WARM_UP = 200  # ticks: compilers, and until traffic moves


def measure(town: str, ticks: int, manner: str) -> tuple[np.ndarray, np.ndarray]:
    """Processor time of the steps and of the readings of `ticks` ticks [ms], several episodes if one is too short."""
    plan = CollectPlan(towns=(town,), vehicles=(100, 100), walkers=(50, 50), length=(600.0, 1500.0))
    steps: list[float] = []
    reads: list[float] = []
    number = 0
    while len(steps) < ticks + WARM_UP:
        simulation = Simulation(replace(plan.episode(number).spec, parked=0.0))
        agent = InProcessAgent(BehaviorAgent, manner)
        agent.start(plan_of(simulation.route, simulation.town))
        suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
        while simulation.snapshot.time < 60.0 and len(steps) < ticks + WARM_UP:
            begun = time.thread_time()
            readings = suite.read(simulation.recent(suite.history + 1))
            read = time.thread_time()
            control = agent.step(readings, simulation.snapshot.time)
            steps.append(1e3 * (time.thread_time() - read))
            reads.append(1e3 * (read - begun))
            simulation.tick(control)
        agent.close()
        number += 1
    return np.array(steps[WARM_UP:]), np.array(reads[WARM_UP:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--town", default="us_large_a")
    parser.add_argument("--ticks", type=int, default=2400)
    parser.add_argument("--manner", default="expert")
    arguments = parser.parse_args()
    steps, reads = measure(arguments.town, arguments.ticks, arguments.manner)
    for name, times in (("step", steps), ("truth", reads)):
        p50, p99 = np.percentile(times, (50.0, 99.0))
        print(f"{name}: mean {times.mean():.3f} ms, median {p50:.3f}, 99 % {p99:.3f}, longest {times.max():.3f}")


if __name__ == "__main__":
    main()
