"""Has kernels compiled before the first drive, in a process that ends.

A compiler keeps what it worked with: half a gigabyte once the kernels of a drive are compiled, and 0.3 more for
pictures. Code that comes from the cache on disk takes 20 MB. So what is not in the cache yet is compiled by a child,
and several workers don't each compile the same.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lavsim.kernel as kernels
from lavsim.agent import AgentPlan, Readings, Track
from lavsim.episode import Observer, run_episode
from lavsim.executor import ProcessExecutor
from lavsim.log.writer import LogWriter
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.types import Control
from leaderboard.drive import DriveTask
from leaderboard.metrics import MetricsObserver
from leaderboard.observer import CriteriaObserver
from leaderboard.picture import draw_drive

_MARK = "warm"  # file in a module's cache: its kernels were compiled for a drive
_TICKS = 4


def warm_up(task: DriveTask) -> None:
    """Sees to it that the kernels that `task` needs are in the cache."""
    if is_warm():
        return
    with contextlib.suppress(Exception):  # whatever is wrong with the route, checks and drive will tell
        for _ in ProcessExecutor(1).run(_compile, [task]):
            pass
    for folder in kernels._folders.values():
        with contextlib.suppress(OSError):
            (folder / _MARK).touch()


def is_warm() -> bool:
    """Whether the kernels of all modules in use have been compiled for a drive before, as the modules are now."""
    return all((folder / _MARK).exists() for folder in kernels._folders.values())


def _compile(task: DriveTask, report: Callable[[Any], None]) -> None:
    """Drives `task` for some ticks, judged and recorded, and draws it if it is to be drawn."""
    simulation = Simulation(task.spec())
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "warm.lavlog"
        observers: list[Observer] = [CriteriaObserver(task.rules), MetricsObserver(), LogWriter(log)]
        suite = SensorSuite(get_scene(simulation.town), [], simulation.draws)
        run_episode(simulation, _Parked(), observers, suite, max_ticks=_TICKS)
        if task.pictures:
            draw_drive(log, Path(folder) / "warm.png", (), task.town_path)


class _Parked:
    """An agent that stays where it is."""

    track = Track.SENSORS

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        """Nothing is to be set up."""

    def sensors(self) -> list[dict[str, Any]]:
        return []

    def step(self, readings: Readings, time: float) -> Control:
        return Control(0.3)

    def close(self) -> None:
        """Nothing is to be ended."""
