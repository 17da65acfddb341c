"""The leaderboard's own training routes and scenario file of 1.0 on CARLA's maps: which hazards are set off where.

`python benchmarks/scenarios_1_0.py --routes leaderboard_1.0_training.xml --scenarios-json
leaderboard_1.0_scenarios.json --town-path MAPS --towns Town01,Town04` carries the ego along each route once, on rails
at 8 m/s and without background traffic. For each town it prints how many hazards the file offers, how many lie on a
route, how many are chosen as the original chooses, and how many are set off within 1.5 m of where the file puts them;
then every one that was not, and why.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lavsim.errors import LavsimError
from lavsim.geometry import forward
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import ScenarioSpec, make_scenario
from lavsim.scenarios.director import TRIGGER_RADIUS, trigger_index
from lavsim.scenarios.place import Site
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT, Control
from leaderboard.routes import RouteEntry, read_routes
from leaderboard.scenario_files import Candidate, choose, matches, read_scenarios

SPEED = 8.0  # [m/s]


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
    """Carries the ego along a route and says what became of its hazards."""
    kept, seen = fitting(entry, town_path)
    spec = DriveSpec(
        town=entry.town, route_id=entry.id, keypoints=entry.keypoints, weather=entry.weather, scenarios=tuple(kept),
        traffic="empty", generation="1.0", rules="1.0", town_path=town_path,
    )  # fmt: skip
    simulation = Simulation(spec)
    world, route, gaps = simulation._world, simulation.route, dict[int, float]()
    for at in np.arange(0.0, route.length, SPEED * DT):
        point = route.points[simulation._tracker.index, :2]
        k = min(int(np.searchsorted(route.distance, at)), len(route) - 1)
        world.pose[0, :2], world.pose[0, 2] = route.points[k, :2], route.yaw[k]
        world.velocity[0, :2] = SPEED * forward(route.yaw[k])
        simulation.tick(Control())
        for number in simulation.snapshot.hazards["index"].tolist():
            gaps.setdefault(number, float(np.hypot(*(point - np.array(kept[number].trigger[:2])))))
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
    """Goes through the routes of a town and prints its line and what was not set off."""
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
    offered, routes = read_scenarios(arguments.scenarios_json), read_routes(arguments.routes)
    print("| town | routes | type | offered | on a route | chosen | set off | within 1.5 m |")
    print("|---|---|---|---|---|---|---|---|")
    for town in arguments.towns.split(","):
        entries = [entry for entry in routes if entry.town == town]
        report(town, entries, offered.get(town, []), tuple(arguments.town_path))


if __name__ == "__main__":
    main()
