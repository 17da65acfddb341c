"""How much faster two workers score than one process, and whether their files agree.

`python benchmarks/workers.py`: drives the same routes with one and with several workers in turns, and prints each
round's wall-clock times, their ratio, and the median. Only a machine with nothing else to do says anything.
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


def score(out: Path, agent: str, routes: str, workers: int) -> float:
    """Wall-clock seconds of a whole run, start of Python and report included."""
    command = [sys.executable, "-m", "lavsim", "score", "--agent", agent, "--routes", routes, "--out", str(out)]
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
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; {arguments.agent} on {arguments.routes}")
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        alone, together = Path(folder) / "one", Path(folder) / "many"
        for number in range(arguments.rounds):
            serial = score(alone, arguments.agent, arguments.routes, 1)
            parallel = score(together, arguments.agent, arguments.routes, arguments.workers)
            assert results(alone) == results(together), "the files differ"
            ratios.append(serial / parallel)
            print(
                f"round {number + 1}: 1 process {serial:.1f} s, {arguments.workers} workers {parallel:.1f} s, "
                f"ratio {ratios[-1]:.2f}, files equal",
                flush=True,
            )
    print(f"median ratio {statistics.median(ratios):.2f}; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
