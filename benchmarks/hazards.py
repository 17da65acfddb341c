"""Does each hazard hurt who does not look, and spare who does? The table of `docs/scenarios.md`.

`python benchmarks/hazards.py` drives the bundled file `hazards`: the blind route follower with each hazard taken out
and with it, and the expert with it, under the hazard's own rules (1.0, or 2.1). A run counts as hurt when it has an
infraction from the trigger on, or loses completion; min speed does not count. `--types`, `--seeds` and `--agents`
choose less. `--draw FILE` writes the route file: of a town's places for a type the first at which it hurts.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lavsim.agent import AgentSpec, InProcessAgent, plan_of
from lavsim.episode import EpisodeResult, run_episode
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot
from leaderboard.hazard_file import TRAFFIC, hazard_routes
from leaderboard.hazard_maker import find_type
from leaderboard.observer import CriteriaObserver
from leaderboard.route_writer import write_routes
from leaderboard.routes import RouteEntry, read_routes
from leaderboard.rules import get_rules

BLIND, EXPERT = "agents.baselines.blind", "agents.behavior"
RULES = {"1.0": "1.0", "2.x": "2.1"}
MOST_TICKS = 3600  # 180 s
IGNORED = frozenset({"min_speed_infractions"})


@dataclass(frozen=True)
class Drive:
    """How one drive went.

    Attributes:
        reached: Whether it came to the end of the route.
        infractions: (key, tick) of each but min speed.
        begun: Tick at which the hazard was set off; -1: never.
        seconds: Simulated time [s].
        xy: (T, 2) where the ego was [m].
    """

    reached: bool
    infractions: tuple[tuple[str, int], ...]
    begun: int
    seconds: float
    xy: NDArray[np.float64]

    @property
    def is_clean(self) -> bool:
        return self.reached and not self.infractions

    @property
    def is_hurt(self) -> bool:
        """Whether the hazard has cost it anything."""
        return self.begun >= 0 and (not self.reached or any(tick >= self.begun for _, tick in self.infractions))


class _Watch:
    """Notes when the hazard is set off and where the ego goes."""

    def __init__(self) -> None:
        self.begun, self.xy = -1, list[NDArray[np.float64]]()

    def start(self, simulation: Simulation) -> None:
        """Nothing to prepare."""

    def observe(self, snapshot: Snapshot) -> str | None:
        self.xy.append(snapshot.ego.xy)
        if self.begun < 0 and len(snapshot.hazards):
            self.begun = snapshot.tick
        return None

    def finish(self, result: EpisodeResult) -> None:
        """Nothing to close."""


def drive(entry: RouteEntry, agent: str, seed: int, with_hazard: bool = True, rules: str | None = None) -> Drive:
    """One drive of a route with one hazard."""
    hazard = entry.scenarios[0]
    judged = get_rules(rules or RULES[hazard.generation])
    spec = DriveSpec(
        town=entry.town,
        route_id=entry.id,
        keypoints=entry.keypoints,
        weather=entry.weather,
        scenarios=entry.scenarios if with_hazard else (),
        seed=seed,
        traffic=entry.traffic or TRAFFIC,
        rules=judged.version,
        generation=hazard.generation,
    )
    simulation = Simulation(spec)
    handle = InProcessAgent(AgentSpec(agent))
    criteria, watch = CriteriaObserver(judged), _Watch()
    try:
        handle.start(plan_of(simulation.route, simulation.town), judged.plan_spacing)
        suite = SensorSuite(get_scene(simulation.town), handle.sensors(), simulation.draws)
        run_episode(simulation, handle, [criteria, watch], suite, MOST_TICKS)
    finally:
        handle.close()
    verdict = criteria.verdict()
    found = tuple((i.key, i.tick) for i in verdict.infractions if i.key not in IGNORED)
    return Drive(verdict.reached, found, watch.begun, len(watch.xy) * DT, np.array(watch.xy))


def hurts(entry: RouteEntry) -> bool:
    """Whether the blind follower is clean on a route without its hazard and hurt with it."""
    return drive(entry, BLIND, 0, with_hazard=False).is_clean and drive(entry, BLIND, 0).is_hurt


@dataclass
class Row:
    """What is known of one type."""

    generation: str
    kind: str
    towns: dict[str, None]
    free: list[Drive]
    blind: list[Drive]
    expert: list[Drive]

    def text(self) -> str:
        """A line of the table."""
        causes = Counter(key for run in self.blind for key in {k for k, tick in run.infractions if tick >= run.begun})
        causes.update({"not reached": sum(not run.reached for run in self.blind)})
        told = ", ".join(f"{key} {count}" for key, count in causes.most_common(3) if count) or "none"
        begun = sum(run.begun >= 0 for run in self.blind)
        deviation = [_deviation(a, b) for a, b in zip(self.free, self.blind, strict=False)]
        middle = f"{np.median(deviation):.1f}" if deviation else ""
        return (
            f"| {self.kind} | {self.generation} | {', '.join(self.towns)} | {begun}/{len(self.blind)} | "
            f"{_share([run.is_clean for run in self.free])} | {_share([run.is_hurt for run in self.blind])} | {told} | "
            f"{middle} | {_share([run.is_clean for run in self.expert])} |"
        )


def _deviation(first: Drive, second: Drive) -> float:
    """Largest distance of the second drive's places from the first's line [m]."""
    line = first.xy[::2]
    gaps = np.hypot(*(second.xy[::4, None] - line[None]).transpose(2, 0, 1))
    return float(gaps.min(axis=1).max())


def _share(flags: Sequence[bool]) -> str:
    return f"{100.0 * sum(flags) / len(flags):.0f} %" if flags else "-"


HEAD = (
    "| type | generation | towns | set off | blind, clean without | blind, hurt with | by | deviation [m] | "
    "expert, clean |\n|---|---|---|---|---|---|---|---|---|"
)


def table(entries: Sequence[RouteEntry], seeds: int, agents: Sequence[str]) -> list[Row]:
    """Drives all and prints a line as each type is done."""
    rows: dict[tuple[str, str], Row] = {}
    for entry in entries:
        hazard = entry.scenarios[0]
        rows.setdefault((hazard.generation, hazard.type), Row(hazard.generation, hazard.type, {}, [], [], []))
    for key, row in rows.items():
        for entry in (e for e in entries if (e.scenarios[0].generation, e.scenarios[0].type) == key):
            row.towns[entry.town] = None
            for seed in range(seeds):
                if "blind" in agents:
                    row.free.append(drive(entry, BLIND, seed, with_hazard=False))
                    row.blind.append(drive(entry, BLIND, seed))
                if "expert" in agents:
                    row.expert.append(drive(entry, EXPERT, seed))
        print(row.text(), flush=True)
    return list(rows.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--routes", default="hazards", help="a bundled route file, or a path")
    parser.add_argument("--types", default="", help="some types with commas: Scenario3,Accident")
    parser.add_argument("--generation", default="", help="types of one generation alone: 1.0 or 2.x")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--agents", default="blind,expert")
    parser.add_argument("--draw", type=Path, help="write the route file instead")
    parser.add_argument("--unproven", action="store_true", help="with --draw: take the first places unseen")
    arguments = parser.parse_args()
    kinds = [find_type(name) for name in arguments.types.split(",") if name] or None
    if arguments.draw is not None:
        entries = list(hazard_routes(kinds, None if arguments.unproven else hurts))
        arguments.draw.write_bytes(write_routes(entries, TRAFFIC))
        print(f"{arguments.draw}  {len(entries)} routes")
        return
    wanted = [
        entry
        for entry in read_routes(arguments.routes)
        if (kinds is None or (entry.scenarios[0].generation, entry.scenarios[0].type) in kinds)
        and arguments.generation in ("", entry.scenarios[0].generation)
    ]
    print(HEAD)
    rows = table(wanted, arguments.seeds, arguments.agents.split(","))
    expert = [run.is_clean for row in rows for run in row.expert]
    print(f"\nexpert, clean over all types: {_share(expert)}")


if __name__ == "__main__":
    main()
