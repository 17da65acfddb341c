"""How much faster two workers score than one process, and whether their files agree.

`python benchmarks/workers.py`: drives the same eight routes three times each, as the leaderboard does, with one and
with two workers, prints the wall-clock times, their ratio and the median of it over `--rounds`, and fails below 1.7. A
round takes eight minutes; only a machine with nothing else to do says anything. With one repetition the end of a run
counts more: one worker has nothing left to do while the other ends the last drive. A drive before the first round
compiles the kernels where that has not been done, which would else count for the one process alone.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
AT_LEAST = 1.7  # times as fast, on two cores


def score(out: Path, arguments: argparse.Namespace, workers: int, routes: str | None = None) -> float:
    """Wall-clock seconds of a whole run, start of Python and report included; of `routes`, else of the chosen ones."""
    command = [sys.executable, "-m", "lavsim", "score", "--agent", arguments.agent]
    command += ["--routes", routes or arguments.routes, "--out", str(out), "--repetitions", str(arguments.repetitions)]
    command += ["--route-ids", arguments.route_ids] if arguments.route_ids and not routes else []
    began = time.perf_counter()
    subprocess.run(
        [*command, "--workers", str(workers), "--overwrite"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL
    )
    return time.perf_counter() - began


def results(out: Path) -> dict[str, Any]:
    """The results file without its wall-clock field."""
    content: dict[str, Any] = json.loads((out / "results.json").read_text())
    for record in [*content["_checkpoint"]["records"], content["_checkpoint"]["global_record"]]:
        del record["meta"]["duration_system"]
    return content


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--agent", default="agents.behavior:BehaviorAgent")
    parser.add_argument("--routes", default="devtest")
    parser.add_argument("--route-ids", help="some of the routes; the fewer, the more a run's start counts")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=1)
    arguments = parser.parse_args()
    print(
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; {arguments.agent} on {arguments.routes}, "
        f"{arguments.repetitions} repetitions"
    )
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        alone, together = Path(folder) / "one", Path(folder) / "many"
        score(Path(folder) / "warm", arguments, 1, routes="quick")
        for number in range(arguments.rounds):
            serial = score(alone, arguments, 1)
            parallel = score(together, arguments, arguments.workers)
            assert results(alone) == results(together), "the files differ"
            ratios.append(serial / parallel)
            print(
                f"round {number + 1}: 1 process {serial:.1f} s, {arguments.workers} workers {parallel:.1f} s, "
                f"ratio {ratios[-1]:.2f}, files equal",
                flush=True,
            )
    median = statistics.median(ratios)
    print(f"median ratio {median:.2f}; load {os.getloadavg()[0]:.1f}")
    if arguments.workers == 2 and median < AT_LEAST:
        sys.exit(f"two workers should be {AT_LEAST} times as fast as one")


if __name__ == "__main__":
    main()
