"""The leaderboard's own training routes and scenario file of 1.0 on CARLA's maps: which hazards are set off where.

`python benchmarks/scenarios_1_0.py --routes leaderboard_1.0_training.xml --scenarios-json
leaderboard_1.0_scenarios.json --town-path MAPS --towns Town01,Town04` drives each route once, blindly and without
background traffic. For each town it prints how many hazards the file offers, how many lie on a route, how many are
chosen as the original chooses, and how many are set off within 1.5 m of where the file puts them; then every one that
was not, and why.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from agents.baselines.blind import BlindRouteFollower
from lavsim.agent import AgentSpec, InProcessAgent, plan_of
from lavsim.errors import LavsimError
from lavsim.map.planner import get_planner
from lavsim.map.town_map import TOWN_PATH, load_town
from lavsim.render.scene import get_scene
from lavsim.scenarios.base import ScenarioSpec, make_scenario
from lavsim.scenarios.director import TRIGGER_RADIUS, trigger_index
from lavsim.scenarios.place import Site
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from leaderboard.routes import RouteEntry, read_routes
from leaderboard.scenario_files import Candidate, choose, matches, read_scenarios

MOST_TICKS = 12_000  # 10 min
BLIND = f"{BlindRouteFollower.__module__}:{BlindRouteFollower.__name__}"


@dataclass
class Seen:
    """One chosen hazard: where it was set off, and what became of it.

    Attributes:
        route: Id of its route.
        spec: The hazard.
        fate: "set off", or why not.
        gap: Of the route point at which the ego was from the file's place, when it was set off [m].
    """

    route: str
    spec: ScenarioSpec
    fate: str
    gap: float = float("nan")


def drive(entry: RouteEntry, town_path: tuple[Path, ...]) -> list[Seen]:
    """Drives a route to its end and says what became of its hazards."""
    kept, seen = fitting(entry, town_path)
    spec = DriveSpec(
        town=entry.town, route_id=entry.id, keypoints=entry.keypoints, weather=entry.weather, scenarios=tuple(kept),
        traffic="empty", generation="1.0", rules="1.0", town_path=town_path,
    )  # fmt: skip
    simulation = Simulation(spec)
    agent = InProcessAgent(AgentSpec(BLIND))
    gaps: dict[int, float] = {}
    try:
        agent.start(plan_of(simulation.route, simulation.town), 50.0)
        suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
        for _ in range(MOST_TICKS):
            point = simulation.route.points[simulation._tracker.index, :2]
            simulation.tick(agent.step(suite.read(simulation.recent(suite.history + 1)), simulation.snapshot.time))
            for number in simulation.snapshot.hazards["index"].tolist():
                gaps.setdefault(number, float(np.hypot(*(point - np.array(kept[number].trigger[:2])))))
            if simulation._tracker.percentage > 99.5:
                break
    finally:
        agent.close()
    fates = simulation._director.fates
    for number, hazard in enumerate(kept):
        fate = fates.get(number, "its trigger is not on the route")
        seen.append(Seen(entry.id, hazard, fate, gaps.get(number, float("nan"))))
    return seen


def fitting(entry: RouteEntry, town_path: tuple[Path, ...]) -> tuple[list[ScenarioSpec], list[Seen]]:
    """The hazards that can stand where the file puts them, and those that can't."""
    town = load_town(entry.town, town_path)
    route = get_planner(town).trace(entry.keypoints)
    kept, left = list[ScenarioSpec](), list[Seen]()
    for spec in entry.scenarios:
        index = trigger_index(route, spec)
        try:
            reason = make_scenario(spec).fits(Site(town, route, index)) if index is not None else None
        except LavsimError as error:
            reason = str(error)
        if reason is None:
            kept.append(spec)
        else:
            left.append(Seen(entry.id, spec, f"does not fit: {reason}"))
    return kept, left


def report(town: str, entries: Sequence[RouteEntry], offered: Sequence[Candidate], town_path: tuple[Path, ...]) -> None:
    """Drives the routes of a town and prints its line and what was not set off."""
    met: Counter[str] = Counter()
    seen: list[Seen] = []
    for entry in entries:
        route = get_planner(load_town(town, town_path)).trace(entry.keypoints)
        met.update(candidate.type for candidate in offered if matches(candidate, route))
        seen += drive(replace(entry, scenarios=tuple(choose(offered, route))), town_path)
    chosen = Counter(item.spec.type for item in seen)
    done = [item for item in seen if item.fate == "set off"]
    begun = Counter(item.spec.type for item in done)
    for kind in sorted({*met, *chosen, *(candidate.type for candidate in offered)}):
        gaps = [item.gap for item in done if item.spec.type == kind]
        near = sum(gap < TRIGGER_RADIUS["1.0"] for gap in gaps)
        count = sum(candidate.type == kind for candidate in offered)
        cells = (town, len(entries), kind, count, met[kind], chosen[kind], begun[kind], near)
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    for item in seen:
        if item.fate != "set off":
            x, y = item.spec.trigger[:2]
            print(f"  route {item.route}, {item.spec.name} at ({x:.1f}, {y:.1f}): {item.fate}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--routes", required=True, type=Path)
    parser.add_argument("--scenarios-json", required=True, type=Path)
    parser.add_argument("--town-path", type=Path, action="append", default=[])
    parser.add_argument("--towns", default="Town01,Town04")
    arguments = parser.parse_args()
    if arguments.town_path:
        os.environ[TOWN_PATH] = os.pathsep.join(
            str(folder.resolve()) for folder in arguments.town_path
        )  # for the agent
    offered, routes = read_scenarios(arguments.scenarios_json), read_routes(arguments.routes)
    print("| town | routes | type | offered | on a route | chosen | set off | within 1.5 m |")
    print("|---|---|---|---|---|---|---|---|")
    for town in arguments.towns.split(","):
        entries = [entry for entry in routes if entry.town == town]
        report(town, entries, offered.get(town, []), tuple(arguments.town_path))


if __name__ == "__main__":
    main()
