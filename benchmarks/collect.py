"""Frames a second and bytes a frame of collecting and rendering datasets.

    python -m benchmarks.collect [--episodes 3] [--workers 2] [--frames 1600]

The first table is of the bench scene on one core, in frames a second of the clock on the wall and of processor time
(which other work on the machine disturbs less), and of the training towns as they are collected. With `--workers` the
same dataset is then collected by one process and by so many, without blobs and with them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from lavsim.dataset.collect import collect
from lavsim.dataset.pace import SCENE, Pace, collect_pace, render_pace
from lavsim.dataset.plan import CollectPlan, named_towns
from lavsim.dataset.tally import Progress


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=3, help="timed for each figure")
    parser.add_argument("--workers", type=int, default=0, help="compare with so many processes")
    parser.add_argument("--frames", type=int, default=1600, help="collected for the comparison")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity") and not options.workers:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    if options.workers:
        compare(options.workers, options.frames)
        return
    n = options.episodes
    print(f"{'':34} {'frames/s':>9} {'of CPU':>9} {'bytes/frame':>12}")
    tell("bench scene, log alone", partial(collect_pace, True, n))
    tell("bench scene, blobs", partial(collect_pace, False, n))
    tell("bench scene, render", partial(render_pace, n))
    for town in named_towns("training"):
        plan = CollectPlan(towns=(town,), length=SCENE.length)
        tell(f"{town} as it is, log alone", partial(collect_pace, True, n, plan, None))
        tell(f"{town} as it is, blobs", partial(collect_pace, False, n, plan, None))


def tell(name: str, measure: Callable[..., Pace]) -> None:
    wall, cpu = measure(clock=time.perf_counter), measure(clock=time.process_time)
    print(f"{name:34} {wall.frames_per_s:9.1f} {cpu.frames_per_s:9.1f} {wall.bytes_per_frame:12,.0f}", flush=True)


def compare(workers: int, frames: int) -> None:
    """One process against several, each from its first kept frame on: what a long collection comes to."""
    for log_only in (True, False):
        plan = SCENE.model_copy(update={"frames": frames * (5 if log_only else 1), "log_only": log_only})
        rates = {count: collected(plan, count) for count in (1, workers)}
        gain = rates[workers] / rates[1]
        kind = "log alone" if log_only else "blobs"
        print(f"{kind:12} {rates[1]:8.1f} frames/s by one, {rates[workers]:8.1f} by {workers}: {gain:.2f} times")


def collected(plan: CollectPlan, workers: int) -> float:
    """Frames a second of a whole collection, its start left out."""
    marks: list[tuple[float, int]] = []

    def on_progress(progress: Progress) -> None:
        if progress.fresh:
            marks.append((time.perf_counter(), progress.fresh))

    root = Path(tempfile.mkdtemp())
    try:
        collect(plan, root / "data", workers=workers, on_progress=on_progress)
    finally:
        shutil.rmtree(root)
    (begin, first), (end, last) = marks[0], marks[-1]
    return (last - first) / (end - begin)


if __name__ == "__main__":
    main()
