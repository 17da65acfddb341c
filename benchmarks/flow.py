"""How traffic flows: simulated hours of towns, watched from outside, and a verdict on each.

`python benchmarks/flow.py --minutes 60 --out runs/flow`: the bundled towns at the densities of `towns.toml`;
`--town-path maps/carla --towns Town01,Town02,Town04,Town10HD` takes CARLA's at the leaderboard's counts. The ego stands
far from all roads. Each town leaves a JSON file in `--out`; what is there already is not run again.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.render.birdseye import draw_actors, draw_lights, draw_solids
from lavsim.render.canvas import Canvas, write_png
from lavsim.render.scene import get_scene
from lavsim.towns.facts import bundled_facts
from lavsim.traffic.audit import Incident, TrafficAudit
from lavsim.traffic.parked import park_cars
from lavsim.traffic.population import Traffic
from lavsim.traffic.profiles import LEADERBOARD_VEHICLES, Population, population_of
from lavsim.traffic.walkers import Walkers
from lavsim.types import DT, Control, Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.lights import TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather
from lavsim.world.world import World

OUT_OF_THE_WAY = 200.0  # [m] beyond the corner of the town
FRAMES, FRAME_GAP = 4, 20  # pictures of an incident, and the ticks between them
PICTURED = ("contact", "walker_hit", "static_hit", "red_light", "off_lane", "blocked", "stop_sign", "near_miss")
PICTURES = 3  # of each kind and town
REPORT_EVERY = 200  # ticks between two steps of the progress bar
LEAST, MOST = 0.3, 0.9  # mean speed over limit
MOST_DISSOLVED = 1.0  # deadlocks per 1,000 vehicle-km
COLUMNS = (
    ("vehicle_km", "veh-km", "{:.0f}"), ("space_mean", "v/limit", "{:.2f}"), ("standing", "standing", "{:.2f}"),
    ("contacts", "contacts", "{}"), ("walkers_hit", "walkers", "{}"), ("static_hit", "static", "{}"),
    ("off_lane", "off lane", "{}"), ("red_lights", "red", "{}"), ("stop_signs", "stops run", "{}"),
    ("near_misses", "near", "{}"), ("long_stops", ">60 s", "{}"), ("blocked", ">180 s", "{}"),
    ("longest_stop", "longest", "{:.0f}"), ("harsh_brakes", "harsh", "{}"), ("emergency_brakes", "emerg.", "{}"),
    ("jerk", "jerk", "{:.1f}"), ("lane_changes", "changes", "{}"), ("jumps", "jumps", "{}"),
)  # fmt: skip


def population(town: TownMap, share: float) -> Population:
    """Who is in `town`: as `towns.toml` says, or the leaderboard's count; times `share`."""
    if town.name in bundled_facts():
        who = population_of("lav", "1.0", town)
    else:
        who = Population(LEADERBOARD_VEHICLES.get(town.name.removesuffix("HD"), 100))
    return Population(round(who.vehicles * share), who.walkers, who.parked)


class Drive:
    """A town with its traffic and nobody to look after."""

    def __init__(self, town: TownMap, who: Population, seed: int) -> None:
        prisms = town.scenery.prisms
        solid = np.flatnonzero(prisms.solid & (prisms.z0 < 1.0))
        walls = [prisms.vertices[k, : prisms.count[k]] for k in solid]
        self.town = town
        self.world = World(walls, has_levels=float(np.ptp(town.lanes.points[:, 2])) > 0.1)
        x, y = town.bounds[:2] - OUT_OF_THE_WAY
        ego = find_blueprint("vehicle.lincoln.mkz_2017")
        self.world.spawn(1, ego, np.array([x, y, 0.0]), 0.0, Role.EGO)
        draws = Draws.of_seed(seed)
        self.traffic = Traffic(town, self.world, draws, who.vehicles)
        self.walkers = Walkers(town, self.world, draws, who.walkers)
        self.parked = park_cars(town, self.world, draws, who.parked)
        self.lights = TrafficLights(len(town.lights), town.light_groups)

    def tick(self) -> Snapshot:
        """The next tick."""
        states = self.lights.states(self.world.tick * DT)
        self.traffic.control(states)
        self.walkers.control(states)
        self.world.drive_ego(Control(brake=1.0))
        self.world.step()
        return self.world.publish(states, Weather(), np.zeros(0, HAZARD_DTYPE))


def picture(town: TownMap, frames: list[Snapshot], incident: Incident, path: Path, metres: float = 60.0) -> None:
    """Moments that led to an incident side by side, north up."""
    scene, size = get_scene(town), 480
    images = []
    for snapshot in frames:
        canvas = Canvas.facing(incident.x, incident.y, -np.pi / 2.0, (size, size), size / metres)
        canvas.draw_ground(scene.ground)
        draw_actors(canvas, snapshot)
        draw_solids(canvas, scene.statics)
        draw_lights(canvas, town, snapshot.lights.tolist())
        for actor in incident.actors:
            row = snapshot.index_of(actor)
            if row is not None:
                canvas.disc(snapshot.xy[row].tolist(), 4.0, (0, 0, 255))
        images.append(canvas.image)
    write_png(np.concatenate(images, axis=1), path)


def watch(drive: Drive, ticks: int, pictures: Path | None, advance: Callable[[int], None]) -> TrafficAudit:
    """The audit of `ticks` ticks; draws the first incidents of each kind into the folder `pictures`."""
    audit = TrafficAudit(drive.town)
    recent: deque[Snapshot] = deque(maxlen=FRAMES * FRAME_GAP)
    drawn = dict.fromkeys(PICTURED, 0)
    told = 0
    for k in range(1, ticks + 1):
        snapshot = drive.tick()
        audit.update(snapshot)
        recent.append(snapshot)
        for incident in audit.incidents[told:] if pictures else ():
            if drawn.get(incident.kind, PICTURES) < PICTURES:
                drawn[incident.kind] += 1
                frames = list(recent)[::-FRAME_GAP][::-1]
                picture(drive.town, frames, incident, pictures / f"{incident.kind}_{incident.tick}.png")
        told = len(audit.incidents)
        if k % REPORT_EVERY == 0 or k == ticks:
            advance(k % REPORT_EVERY or REPORT_EVERY)
    return audit


def verdict(result: dict[str, Any]) -> dict[str, bool]:
    """The criteria, each with whether it holds."""
    report = result["report"]
    return {
        "no collision": report["contacts"] + report["static_hit"] + report["walkers_hit"] == 0,
        "none off its lane": report["off_lane"] == 0,
        "no red light run": report["red_lights"] == 0,
        "deadlocks": result["dissolved"] < MOST_DISSOLVED * max(report["vehicle_km"], 1.0) / 1000.0 or
                     result["dissolved"] == 0,
        "mean speed": LEAST <= report["space_mean"] <= MOST,
    }  # fmt: skip


def show(results: list[dict[str, Any]], console: Console) -> None:
    """One row a run."""
    table = Table(
        "town", "seed", "min", "vehicles", *(title for _, title, _ in COLUMNS), "dissolved", "ticks/s", "fails"
    )
    for result in results:
        failed = [name for name, holds in verdict(result).items() if not holds]
        table.add_row(
            result["town"], str(result["seed"]), f"{result['minutes']:g}", str(result["vehicles"]),
            *(form.format(result["report"][key]) for key, _, form in COLUMNS),
            str(result["dissolved"]), f"{result['ticks_per_s']:.0f}", ", ".join(failed) or "-",
        )  # fmt: skip
    console.print(table)


def run(name: str, seed: int, arguments: argparse.Namespace, advance: Callable[[int], None]) -> dict[str, Any]:
    """One town and seed, from its file if it was run before."""
    ticks = round(arguments.minutes * 60.0 / DT)
    path = arguments.out / f"{name}_{seed}.json"
    if path.is_file():
        stored: dict[str, Any] = json.loads(path.read_text())
        if stored["minutes"] == arguments.minutes:
            advance(ticks)
            return stored
    town = load_town(name, arguments.town_path)
    who = population(town, arguments.share)
    drive = Drive(town, who, seed)
    folder = path.with_suffix("")
    if arguments.pictures:
        folder.mkdir(exist_ok=True)
    begun = time.perf_counter()
    audit = watch(drive, ticks, folder if arguments.pictures else None, advance)
    result = {
        "town": name, "seed": seed, "minutes": arguments.minutes, "vehicles": len(drive.traffic),
        "walkers": len(drive.walkers), "parked": len(drive.parked),
        "dissolved": int(getattr(drive.traffic, "dissolved", 0)),
        "ticks_per_s": ticks / (time.perf_counter() - begun), "report": audit.report().as_dict(),
        "incidents": [vars(incident) for incident in audit.incidents],
    }  # fmt: skip
    path.write_text(json.dumps(result))
    return result


def main() -> None:
    """Runs what is not there yet and prints the table."""
    arguments = _arguments()
    logging.disable(logging.WARNING)
    arguments.out.mkdir(parents=True, exist_ok=True)
    runs = [(name, seed) for name in arguments.towns for seed in arguments.seeds]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    results = []
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("", total=len(runs) * round(arguments.minutes * 60.0 / DT))
        for name, seed in runs:
            progress.update(task, description=f"{name}, seed {seed}")
            results.append(run(name, seed, arguments, lambda ticks: progress.advance(task, ticks)))
    show(results, Console(width=260))


def _arguments() -> argparse.Namespace:
    def names(text: str) -> list[str]:
        return text.split(",")

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0, help="simulated time a run")
    parser.add_argument("--towns", type=names, default=sorted(bundled_facts()))
    parser.add_argument("--seeds", type=lambda text: [int(k) for k in text.split(",")], default=[0])
    parser.add_argument("--town-path", type=Path, nargs="*", default=[], help="folders with other towns")
    parser.add_argument("--share", type=float, default=1.0, help="of the vehicles")
    parser.add_argument("--out", type=Path, default=Path("runs/flow"))
    parser.add_argument("--pictures", action="store_true", help="draws the first incidents of each kind")
    return parser.parse_args()


if __name__ == "__main__":
    main()
