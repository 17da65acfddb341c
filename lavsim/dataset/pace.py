"""How fast datasets are made on this machine: what `lavsim bench` and `benchmarks/collect.py` measure.

The scene is that of the budget: `us_large_a`, 100 vehicles, 50 walkers, no parked cars; weather drawn anew every 10 s.
Whole episodes are timed, their set-up included, as they are when a dataset is collected.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from lavsim.dataset import folder
from lavsim.dataset.drive import drive_episode, info_of
from lavsim.dataset.plan import CollectPlan
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.redrive import RenderTask, render_episode
from lavsim.dataset.schema import file_of
from lavsim.dataset.tally import bytes_of

SCENE = CollectPlan(towns=("us_large_a",), vehicles=(100, 100), walkers=(50, 50), length=(400.0, 1000.0))
FRAMES, LOG_FRAMES = 120, 400  # of an episode with blobs, and as a log alone
Clock = Callable[[], float]


@dataclass(frozen=True)
class Pace:
    """What was measured.

    Attributes:
        frames_per_s: Kept frames a second, the median over episodes.
        bytes_per_frame: Of all files.
    """

    frames_per_s: float
    bytes_per_frame: float


def collect_pace(
    log_only: bool = False, episodes: int = 3, plan: CollectPlan = SCENE, parked: float | None = 0.0,
    clock: Clock = time.perf_counter,
) -> Pace:  # fmt: skip
    """Collects on one core.

    Args:
        log_only: Whether logs alone are kept.
        episodes: How many are timed, after one that warms up.
        plan: What is driven.
        parked: Share of parking spaces taken; None: the town's own.
        clock: Tells the time [s].
    """
    frames = LOG_FRAMES if log_only else FRAMES
    plan = plan.model_copy(update={"log_only": log_only, "episode_frames": frames})
    with _folder() as root:
        return _pace([_timed(clock, partial(_drive, root, plan, number, parked)) for number in range(episodes + 1)])


def render_pace(episodes: int = 3, plan: CollectPlan = SCENE, clock: Clock = time.perf_counter) -> Pace:
    """Renders tables and blobs of logs, their labels included, on one core."""
    logs = plan.model_copy(update={"log_only": True, "episode_frames": FRAMES})
    with _folder() as source, _folder() as root:
        for number in range(episodes + 1):
            _drive(source, logs, number, 0.0)
        info_of(plan.model_copy(update={"episode_frames": FRAMES})).write(root)
        tasks = [RenderTask(source / file_of("log", number), number, root, {}) for number in range(episodes + 1)]
        return _pace([_timed(clock, partial(render_episode, task, _silent)) for task in tasks])


def _drive(root: Path, plan: CollectPlan, number: int, parked: float | None) -> EpisodeRecord:
    episode = plan.episode(number)
    return drive_episode(root, plan, replace(episode, spec=replace(episode.spec, parked=parked)), _silent)


def _timed(clock: Clock, work: Callable[[], EpisodeRecord]) -> tuple[float, EpisodeRecord]:
    begun = clock()
    record = work()
    return clock() - begun, record


def _pace(timed: list[tuple[float, EpisodeRecord]]) -> Pace:
    """The pace of all but the first."""
    rates = [record.frames / seconds for seconds, record in timed[1:]]
    sizes = [bytes_of(record) / record.frames for _, record in timed[1:]]
    return Pace(float(np.median(rates)), float(np.median(sizes)))


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        root = Path(name) / "data"
        folder.claim(root, resume=False, overwrite=False)
        yield root


def _silent(_: object) -> None:
    pass
