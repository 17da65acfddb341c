"""Times of loading towns and of nearest-lane queries, on one core; medians of processor time.

`python benchmarks/maps.py [FOLDER …]`: the bundled towns and those in FOLDER.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

from lavsim.map.town_files import build_town, load_town, town_names
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType

ROUNDS = 7
QUERIES = 10_000
SCRIPT = "import time\nfrom pathlib import Path\nfrom lavsim.map.town_files import load_town\nt=time.process_time()\n"


def median(action: Callable[[], object]) -> float:
    """Milliseconds of `action`."""
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return 1000.0 * statistics.median(times)


def near_lanes(town: TownMap) -> np.ndarray:
    """Points within some metres of driving lanes."""
    rng = np.random.default_rng(0)
    lanes = town.lanes
    rows = np.concatenate([np.arange(lanes.first[k], lanes.first[k + 1]) for k in lanes.where(LaneType.DRIVING)])
    return lanes.points[rng.choice(rows, QUERIES), :3] + rng.normal(0.0, 2.0, (QUERIES, 3)) * (1.0, 1.0, 0.0)


def in_a_new_process(name: str, folders: list[Path], cache: str) -> float:
    """Milliseconds of `load_town` in a fresh process, without imports."""
    code = f"{SCRIPT}load_town({name!r}, {[str(f) for f in folders]!r})\nprint(time.process_time()-t)"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "LAVSIM_CACHE": cache}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    return 1000.0 * float(done.stdout)


def main(folders: list[Path]) -> None:
    """Prints the table."""
    print(f"{'town':<14}{'lanes':>7}{'build':>10}{'cold':>10}{'cached':>10}{'10k nearest':>13}{'with z':>10}   [ms]")
    for name in town_names(folders):
        with tempfile.TemporaryDirectory() as cache:
            in_a_new_process(name, folders, cache)  # compiles kernels where that is still to be done
            cold = statistics.median(in_a_new_process(name, folders, f"{cache}/{k}") for k in range(3))
            cached = statistics.median(in_a_new_process(name, folders, cache) for _ in range(3))
        town = load_town(name, folders)
        points = near_lanes(town)
        town.nearest(points[:10])
        town.nearest(points[:10, :2])
        built = median(partial(build_town, name, town.data))
        plain, solid = median(partial(town.nearest, points[:, :2])), median(partial(town.nearest, points))
        print(
            f"{name:<14}{len(town.lanes):>7}{built:>10.1f}{cold:>10.1f}{cached:>10.1f}{plain:>13.2f}{solid:>10.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main([Path(a) for a in sys.argv[1:]])
