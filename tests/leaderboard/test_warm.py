"""Kernels compiled before a run in another process, and drives that leave nothing in memory."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import lavsim.kernel as kernels
from lavsim.log.reader import LogReader
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.world.snapshot import Snapshot
from leaderboard import warm
from leaderboard.drive import DriveTask
from leaderboard.evaluator import _tasks
from leaderboard.observer import CriteriaObserver
from leaderboard.routes import read_routes
from leaderboard.warm import is_warm, warm_up
from tests.leaderboard.test_evaluator import steady


def first_task(folder: Path) -> DriveTask:
    made = steady(folder, 1)
    return next(_tasks(read_routes(made.routes), made))


class Children:
    """Stands for the processes that compile."""

    def __init__(self, fails: bool = False) -> None:
        self.tasks: list[Any] = []
        self.fails = fails

    def __call__(self, workers: int) -> Children:
        assert workers == 1
        return self

    def run(self, work: Any, tasks: list[Any]) -> Iterator[Any]:
        self.tasks += tasks
        if self.fails:
            raise ValueError("the route leads nowhere")
        return iter(())


@pytest.fixture
def caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Caches of two modules in use, both new."""
    folders = {name: tmp_path / name for name in ("first", "second")}
    for folder in folders.values():
        folder.mkdir()
    monkeypatch.setattr(kernels, "_folders", folders)
    return folders


@pytest.mark.parametrize("fails", [False, True])
def test_a_child_compiles_once_what_is_new(
    fails: bool, tmp_path: Path, caches: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    children, task = Children(fails), first_task(tmp_path)
    monkeypatch.setattr(warm, "ProcessExecutor", children)
    assert not is_warm()
    warm_up(task)
    warm_up(task)
    assert is_warm()
    assert children.tasks == [task]
    caches["third"] = tmp_path / "third"  # a module that changed has a new cache
    caches["third"].mkdir()
    warm_up(task)
    assert children.tasks == [task, task]


def test_a_drive_leaves_nothing_in_memory(tmp_path: Path) -> None:
    task = first_task(tmp_path)

    def alive() -> dict[str, int]:
        gc.collect()
        kinds = (Simulation, Snapshot, CriteriaObserver, SensorSuite, LogReader)
        counts = dict.fromkeys((kind.__name__ for kind in kinds), 0)
        for thing in gc.get_objects():
            if type(thing) in kinds:
                counts[type(thing).__name__] += 1
        return counts

    before = alive()
    for _ in range(3):
        warm._compile(task, print)
    assert alive() == before
