"""Flow, density and speed of a ring road beside what the following model says, as figures and as a picture.

`python benchmarks/fundamental_diagram.py [PICTURE]`: rings of 1 km with one lane at 30, 50 and 90 km/h, from 5 vehicles
to a jam. Drivers are those of background traffic, all in the same car: a bicycle would lead everybody at its own speed.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from lavsim.random import Draws
from lavsim.traffic.audit import TrafficAudit
from lavsim.traffic.drivers import draw_driver
from lavsim.types import DT, ActorIds
from lavsim.world.blueprints import find_blueprint
from tests.traffic.roads import Drive, circle, evenly

LIMITS = (30, 50, 90)  # [km/h]
COUNTS = (5, 15, 30, 40, 50, 60, 70, 85, 110)
WARM_UP, WATCHED = 2400, 1200  # ticks
LENGTH = 1000.0  # [m]
CAR = "vehicle.seat.leon"


def measure(limit: int, count: int) -> tuple[float, float, int]:
    """Density [1/km], flow [1/h] and contacts of `count` vehicles."""
    town = circle(LENGTH, limit)
    drive = Drive(town, evenly(town, count), blueprint=CAR)
    audit = TrafficAudit(town)
    metres = 0.0
    for tick in range(WARM_UP + WATCHED):
        snapshot = drive.tick()
        audit.update(snapshot)
        if tick >= WARM_UP:
            metres += float(snapshot.speeds[1:].sum()) * DT
    around = float(town.lanes.length.sum())
    return 1000.0 * count / around, 3600.0 * metres / (WATCHED * DT) / around, audit.report().contacts


def theory(limit: int, drivers: int = 200) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Density [1/km] and flow [1/h] of the same drivers in equilibrium: the slowest leads, then gaps set the speed."""
    draws = Draws.of_seed(0).stream("traffic")
    mix = [draw_driver(draws, int(ActorIds.TRAFFIC) + k) for k in range(drivers)]
    speeds = np.linspace(min(d.speed_factor for d in mix) * limit / 3.6, 0.0, 200)
    gap = np.mean([d.min_gap for d in mix]) + speeds * np.mean([d.headway for d in mix])
    density = 1000.0 / (gap + find_blueprint(CAR).size[0])
    return np.append(1e-3, density), 3.6 * np.append(1e-3, density) * np.append(speeds[0], speeds)


def draw(found: dict[int, NDArray[np.float64]], path: Path) -> None:
    """Flow and speed over density: points as measured, lines as the theory has them."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.2), constrained_layout=True)
    left.axhspan(1500.0, 2200.0, color="0.92", label="capacity of a real lane")
    for colour, (limit, points) in zip(("tab:green", "tab:blue", "tab:red"), found.items(), strict=True):
        density, flow = theory(limit)
        left.plot(density, flow, color=colour, lw=1.2)
        right.plot(density, flow / density, color=colour, lw=1.2)
        left.plot(points[:, 0], points[:, 1], "o", color=colour, ms=4.5, label=f"limit {limit} km/h")
        right.plot(points[:, 0], points[:, 1] / points[:, 0], "o", color=colour, ms=4.5)
    left.set(xlabel="density [vehicles/km]", ylabel="flow [vehicles/h]", xlim=(0.0, 140.0), ylim=(0.0, None))
    right.set(xlabel="density [vehicles/km]", ylabel="mean speed [km/h]", xlim=(0.0, 140.0), ylim=(0.0, None))
    left.legend(frameon=False)
    left.set_title("One lane that closes upon itself: points measured, lines in equilibrium", fontsize=9, loc="left")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Prints the figures and draws them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("picture", type=Path, nargs="?", default=Path("docs/pictures/fundamental_diagram.png"))
    picture = parser.parse_args().picture
    console = Console()
    found = {}
    for limit in LIMITS:
        rows = [measure(limit, count) for count in track(COUNTS, f"{limit} km/h", console=Console(stderr=True))]
        found[limit] = np.array(rows)
        best = found[limit][np.argmax(found[limit][:, 1])]
        console.print(
            f"limit {limit} km/h: free speed {found[limit][0, 1] / found[limit][0, 0]:.1f} km/h, "
            f"highest flow {best[1]:.0f} vehicles/h at {best[0]:.0f}/km (theory {theory(limit)[1].max():.0f}), "
            f"{found[limit][:, 2].sum():.0f} contacts"
        )
    draw(found, picture)


if __name__ == "__main__":
    main()
