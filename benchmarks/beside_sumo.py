"""Vehicle-ticks a second of lavsim's traffic beside SUMO's, on the same town and with as many vehicles.

`python benchmarks/beside_sumo.py`: needs the packages `eclipse-sumo`, `libsumo` and `sumolib`. SUMO drives our own xodr
through netconvert, in steps of 0.05 s, as it comes (Krauss' model, lane changes, lights, collision checks); of lavsim
the whole tick counts: drivers, lights, contacts and the Snapshot. Everything runs on one core, in turns, each simulator
and count in a process of its own; medians of the rounds are printed.
"""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

STEP = 0.05  # [s]
WARM_UP = 1200  # ticks, until traffic moves as it will
TICKS = 200  # of a round
EDGES = 400  # of a vehicle's random way: nobody arrives while we measure
COUNTS = (100, 500)

Round = Callable[[], tuple[float, int]]  # seconds of `TICKS` ticks, vehicles on the road


def ours(town_name: str, count: int, _folder: Path) -> Round:
    """Rounds of lavsim."""
    from flow import Drive

    from lavsim.map.town_files import load_town
    from lavsim.traffic.profiles import Population

    logging.disable(logging.WARNING)
    drive = Drive(load_town(town_name), Population(count), seed=0)
    for _ in range(WARM_UP):
        drive.tick()

    def measure() -> tuple[float, int]:
        begun = time.process_time()
        for _ in range(TICKS):
            drive.tick()
        return time.process_time() - begun, len(drive.traffic)

    return measure


def theirs(_town_name: str, count: int, folder: Path) -> Round:
    """Rounds of SUMO."""
    import libsumo

    net = folder / "town.net.xml"
    routes = folder / f"{count}.rou.xml"
    routes.write_text(random_ways(net, count))
    libsumo.start(
        ["sumo", "-n", str(net), "-r", str(routes), "--step-length", str(STEP), "--time-to-teleport", "-1",
         "--no-step-log", "--no-warnings", "--seed", "0", "--max-depart-delay", "-1"]
    )  # fmt: skip
    for _ in range(WARM_UP):
        libsumo.simulationStep()

    def measure() -> tuple[float, int]:
        begun = time.process_time()
        for _ in range(TICKS):
            libsumo.simulationStep()
        return time.process_time() - begun, libsumo.vehicle.getIDCount()

    return measure


def random_ways(net: Path, count: int) -> str:
    """A route file: `count` vehicles at random places that take a random branch at each junction, like ours."""
    import sumolib

    edges = [e for e in sumolib.net.readNet(str(net)).getEdges() if e.allows("passenger") and e.getLength() > 10.0]
    draw = random.Random(0)
    lines = ["<routes>"]
    for vehicle in range(count):
        edge = draw.choice(edges)
        way = [edge]
        while len(way) < EDGES:
            ahead = [e for e in sorted(way[-1].getOutgoing(), key=lambda e: e.getID()) if e.allows("passenger")]
            if not ahead:
                break
            way.append(draw.choice(ahead))
        names = " ".join(e.getID() for e in way)
        lines.append(f'<vehicle id="{vehicle}" depart="0" departPos="random_free" departLane="best" departSpeed="0">')
        lines.append(f'<route edges="{names}"/></vehicle>')
    return "\n".join([*lines, "</routes>"])


def serve(make: Callable[[str, int, Path], Round], town: str, count: int, folder: Path, pipe: Connection) -> None:
    """A process that measures a round whenever it is asked."""
    pin_to_one_core()
    measure = make(town, count, folder)
    pipe.send(None)
    while pipe.recv():
        pipe.send(measure())


def pin_to_one_core() -> None:
    """The same core for all, so that they can't differ by it."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def make_net(town: str, folder: Path) -> None:
    """SUMO's network of a bundled town."""
    import sumo

    import lavsim.towns

    xodr = Path(next(iter(lavsim.towns.__path__))) / f"{town}.xodr"
    program = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    subprocess.run(
        [program, "--opendrive", xodr, "-o", folder / "town.net.xml"], check=True, capture_output=True, text=True
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--town", default="us_large_a")
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    runs = [(name, make, count) for count in COUNTS for name, make in (("lavsim", ours), ("SUMO", theirs))]
    with tempfile.TemporaryDirectory() as name:
        make_net(arguments.town, Path(name))
        pipes: list[Connection] = []
        for _, make, count in track(runs, "starting", console=Console(stderr=True)):
            here, there = context.Pipe()
            context.Process(target=serve, args=(make, arguments.town, count, Path(name), there), daemon=True).start()
            here.recv()
            pipes.append(here)
        figures: list[list[tuple[float, int]]] = [[] for _ in runs]
        for _ in track(range(arguments.rounds), "measuring", console=Console(stderr=True)):
            for pipe, found in zip(pipes, figures, strict=True):
                pipe.send(True)
                found.append(pipe.recv())
        for pipe in pipes:
            pipe.send(False)
    show(arguments.town, runs, figures)


def show(town: str, runs: list[tuple[str, Any, int]], figures: list[list[tuple[float, int]]]) -> None:
    """Medians and their ratios."""
    rates: dict[tuple[str, int], float] = {}
    table = Table("simulator", "vehicles", "on the road", "ms a tick", "vehicle-ticks/s", title=town)
    for (name, _, count), rounds in zip(runs, figures, strict=True):
        seconds = float(np.median([s for s, _ in rounds])) / TICKS
        present = float(np.median([n for _, n in rounds]))
        rates[name, count] = present / seconds
        table.add_row(name, str(count), f"{present:.0f}", f"{1e3 * seconds:.3f}", f"{rates[name, count]:,.0f}")
    console = Console()
    console.print(table)
    for count in COUNTS:
        console.print(f"lavsim / SUMO at {count} vehicles: {rates['lavsim', count] / rates['SUMO', count]:.2f}")
    few, many = COUNTS
    ratio = rates["lavsim", few] / rates["lavsim", many]
    console.print(f"lavsim's cost a vehicle at {many} over that at {few}: {ratio:.2f} (goal 1.5 or less)")


if __name__ == "__main__":
    main()
