"""How critical is each hazard for who looks and for who does not? The table of `docs/search.md`.

`python benchmarks/criticality.py` drives the first route of each type in the bundled file `hazards` with the expert and
with the blind route follower, one seed, from the trigger to five seconds after the hazard is over, and prints the least
time to contact, the largest required deceleration, the least time headway and the infractions (min speed apart).
`--types` chooses some.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from lavsim.agent import AgentSpec, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import EpisodeResult, run_episode
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot
from leaderboard.hazard_maker import find_type
from leaderboard.observer import CriteriaObserver
from leaderboard.routes import RouteEntry, read_routes
from leaderboard.rules import get_rules
from leaderboard.search.criticality import HORIZON, MOST_BRAKING, Criticality, CriticalityObserver
from leaderboard.search.ground import RULES
from leaderboard.search.trial import IGNORED

AGENTS = {"expert": "agents.behavior", "blind": "agents.baselines.blind"}
AFTER = 5.0  # [s] watched once the hazard is over
MOST_TICKS = 3600


@dataclass
class _End:
    """Ends a drive `AFTER` seconds after its hazard is over."""

    begun: bool = False
    over: int = 0  # ticks

    def start(self, simulation: Simulation) -> None:
        """Nothing to prepare."""

    def observe(self, snapshot: Snapshot) -> str | None:
        active = len(snapshot.hazards) > 0
        self.begun |= active
        self.over = 0 if active or not self.begun else self.over + 1
        return "over" if self.over * DT > AFTER else None

    def finish(self, result: EpisodeResult) -> None:
        """Nothing to close."""


def drive(entry: RouteEntry, agent: str) -> tuple[Criticality, int, list[str]]:
    """Criticality of a drive from the trigger on, the tick of the trigger (-1: never), and its infractions since."""
    hazard = entry.scenarios[0]
    rules = get_rules(RULES[hazard.generation])
    spec = DriveSpec(
        town=entry.town,
        route_id=entry.id,
        keypoints=entry.keypoints,
        weather=entry.weather,
        scenarios=entry.scenarios,
        traffic=entry.traffic or "empty",
        rules=rules.version,
        generation=rules.generation,
    )
    simulation = Simulation(spec)
    handle = InProcessAgent(AgentSpec(agent, generation=rules.generation))
    criteria, critical = CriteriaObserver(rules), CriticalityObserver()
    try:
        handle.start(plan_of(simulation.route, simulation.town), rules.plan_spacing)
        suite = SensorSuite(get_scene(simulation.town), handle.sensors(), simulation.draws)
        run_episode(simulation, handle, [criteria, critical, _End()], suite, MOST_TICKS)
    finally:
        handle.close()
    found = sorted({i.key for i in criteria.verdict().infractions if i.tick >= critical.begun} - IGNORED)
    return critical.criticality, critical.begun, found


def line(entry: RouteEntry) -> str:
    """A line of the table."""
    hazard, cells = entry.scenarios[0], list[str]()
    for agent in AGENTS.values():
        critical, begun, found = drive(entry, agent)
        if begun < 0:
            cells += ["not set off", "", "", ""]
            continue
        cells += [
            _number(critical.contact_time, f"> {HORIZON:g}"),
            f"{critical.deceleration:.1f}{' or more' if critical.deceleration >= MOST_BRAKING else ''}",
            _number(critical.headway, f"> {HORIZON:g}"),
            ", ".join(found) or "none",
        ]
    return f"| {hazard.type} | {hazard.generation} | {entry.town} | {' | '.join(cells)} |"


def _number(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else f"{value:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--routes", default="hazards", help="a bundled route file, or a path")
    parser.add_argument("--types", default="", help="some types with commas: Scenario3,Accident")
    arguments = parser.parse_args()
    kinds = [find_type(name) for name in arguments.types.split(",") if name]
    first: dict[tuple[str, str], RouteEntry] = {}
    for entry in read_routes(arguments.routes):
        first.setdefault((entry.scenarios[0].generation, entry.scenarios[0].type), entry)
    columns = [f"{agent}: {what}" for agent in AGENTS for what in ("TTC [s]", "braking [m/s²]", "THW [s]", "found")]
    print(f"| type | generation | town | {' | '.join(columns)} |")
    print("|---" * (3 + len(columns)) + "|", flush=True)
    for key, entry in first.items():
        if not kinds or key in kinds:
            print(line(entry), flush=True)


if __name__ == "__main__":
    main()
