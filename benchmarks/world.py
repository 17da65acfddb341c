"""What the world's own part of a tick costs: `python benchmarks/world.py [--town us_large_a] [--bodies 150,500]`.

Bodies drive along lanes at 8 m/s without a driver's logic, among the town's solid scenery. Medians of 2,000 ticks.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np

from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.traffic.parked import park_cars
from lavsim.traffic.population import spawn_points
from lavsim.types import DT, Control, Role
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.lights import TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE
from lavsim.world.weather import CLEAR
from lavsim.world.world import World

TICKS = 2000
EGO = BLUEPRINTS["vehicle.lincoln.mkz_2017"]


def walls_of(town: TownMap) -> tuple[list[np.ndarray], np.ndarray]:
    """Footprints and heights of the town's solid scenery."""
    prisms = town.scenery.prisms
    solid = np.flatnonzero(prisms.solid)
    return [prisms.vertices[k, : prisms.count[k]] for k in solid], np.stack(
        [prisms.z0[solid], prisms.z1[solid]], axis=1
    )


def fill(town: TownMap, bodies: int, parked: float) -> tuple[World, np.ndarray]:
    """A world with `bodies` cars on drawn places of lanes, and those parked."""
    walls, wall_z = walls_of(town)
    world = World(walls, wall_z=wall_z)
    world.spawn(1, EGO, np.array([-1e3, -1e3, 0.0]), 0.0, Role.EGO)
    points = spawn_points(town)
    points = points[Draws.of_seed(0).permutation(0, len(points))][: bodies - 1]
    places = town.centre(points[:, 0].astype(int), points[:, 1])
    kinds = [kind for kind in BLUEPRINTS.values() if kind.weight > 0.0]
    rows = world.spawn_many(
        list(range(1000, 1000 + len(points))), [kinds[k % len(kinds)] for k in range(len(points))],
        places[:, :3], places[:, 3], Role.TRAFFIC, [(90, 90, 90)] * len(points),
    )  # fmt: skip
    park_cars(town, world, Draws.of_seed(0), parked)
    return world, rows


def timed(function: Callable[[], object], times: list[float]) -> None:
    start = time.perf_counter()
    function()
    times.append(time.perf_counter() - start)


def measure(town: TownMap, bodies: int, parked: float) -> dict[str, float]:
    """Milliseconds of each part."""
    start = time.perf_counter()
    world, rows = fill(town, bodies, parked)
    made = time.perf_counter() - start
    lights = TrafficLights(len(town.lights), town.light_groups)
    start_pose = world.pose[rows].copy()
    times: dict[str, list[float]] = {"step": [], "publish": [], "lights": []}
    hazards = np.zeros(0, HAZARD_DTYPE)
    for tick in range(TICKS):
        if tick % 20 == 0:  # back to their places: nobody drives them
            world.pose[rows], world.body[rows] = start_pose, 0.0
            world.body[rows, 0] = 8.0
        world.command[rows, 0], world.command[rows, 1] = 8.0, 0.002
        world.drive_ego(Control(brake=1.0))
        timed(world.step, times["step"])
        states = lights.states(world.tick * DT)
        timed(partial(lights.states, world.tick * DT), times["lights"])
        timed(partial(world.publish, states, CLEAR, hazards), times["publish"])
    found = {name: 1e3 * median(values) for name, values in times.items()}
    return {"rows": world.count, **found, "made": 1e3 * made}


def measure_crash(town: TownMap, bodies: int) -> float:
    """Milliseconds of a tick in which the ego pushes another car, among `bodies` that drive."""
    world, rows = fill(town, bodies, 0.0)
    world.spawn(2, BLUEPRINTS["vehicle.audi.tt"], world.pose[0] + np.array([4.8, 0.0, 0.0]), 0.0, Role.PARKED)
    times: list[float] = []
    for _ in range(100):
        world.drive_ego(Control(throttle=0.9))
        world.command[rows, 0] = 0.0
        spent: list[float] = []
        timed(world.step, spent)
        times += spent if world.touched[0] == world.tick else []
    return 1e3 * median(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--town", default="us_large_a")
    parser.add_argument("--bodies", default="150,500")
    parser.add_argument("--parked", type=float, default=0.0)
    options = parser.parse_args()
    town = load_town(options.town)
    fill(town, 10, options.parked)  # compiles
    print(f"{options.town}, {len(walls_of(town)[0])} walls; milliseconds, medians of {TICKS} ticks")
    for bodies in map(int, options.bodies.split(",")):
        found = measure(town, bodies, options.parked) | {"crash": measure_crash(town, bodies)}
        print("  ".join(f"{name} {value:.4g}" for name, value in found.items()))


if __name__ == "__main__":
    main()
