"""Random windows of a dataset read and decoded per second of processor time, on one core.

    python -m benchmarks.reading DATA [--steps 10] [--windows 300]

Files lie in the page cache after the first round; the median of the rounds counts. "table" are the motions of every
vehicle in the window, without any blob.
"""

from __future__ import annotations

import argparse
import os
import time
from itertools import islice
from pathlib import Path

import numpy as np

from lavsim.dataset.reader import Dataset
from lavsim.dataset.samples import motions_of
from lavsim.dataset.windows import Sampler, Windows

ROUNDS = 5
PARTS: tuple[tuple[str, tuple[str, ...] | None], ...] = (
    ("table", ()),
    ("LiDAR, BEV, table", ("lidar", "bev")),
    ("all fields", None),
)


def windows_per_second(data: Dataset, windows: Windows, names: tuple[str, ...] | None, count: int, seed: int) -> float:
    """Windows a second: the first frame's fields `names` (all if None) and the motions of the whole window."""
    begin = time.thread_time()
    for number in islice(Sampler(len(windows), seed), count):
        episode, first = windows[number]
        motions_of(data.table(episode), first, windows.steps)
        data.read(episode, first, names)
    return count / (time.thread_time() - begin)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--windows", type=int, default=300)
    args = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    data = Dataset(args.data)
    windows = Windows(list(data.episodes.values()), args.steps)
    print(f"{len(data)} frames, {len(windows)} windows of {args.steps} + 1 frames")
    for name, fields in PARTS:
        windows_per_second(data, windows, fields, args.windows, 0)
        rounds = [windows_per_second(data, windows, fields, args.windows, 1 + k) for k in range(ROUNDS)]
        print(f"{name:20s} {np.median(rounds):7.0f} a second")


if __name__ == "__main__":
    main()
