"""Runs killed again and again, and resumed: the files they end with are those of a run nobody disturbed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from lavsim.random import Draws
from leaderboard.evaluator import evaluate
from leaderboard.record import RESULTS
from leaderboard.run import REPORT, Run
from tests.leaderboard.test_evaluator import AGENT, route_file, same, steady

ROOT = Path(__file__).parents[2]
ROUTES = 8
KILLS = 20


def score(folder: Path, routes: Path, workers: int) -> subprocess.Popen[bytes]:
    agent = str(AGENT.with_name("steady_agent.py"))
    command = [sys.executable, "-m", "lavsim", "score", "--agent", agent, "--routes", str(routes), "--out", str(folder)]
    return subprocess.Popen(
        [*command, "--resume", "--workers", str(workers)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def offspring(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    try:
        return psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_runs_lose_nothing(tmp_path: Path, workers: int) -> None:
    """Twenty kills; a run that ends between two of them is held to the whole one, and another is begun."""
    whole = evaluate(steady(tmp_path, ROUTES, pictures=True))
    routes, folders = route_file(tmp_path, ROUTES), [tmp_path / "killed"]
    moments = iter(Draws.of_seed(workers).stream("kills").uniform(0, 10 * KILLS, 1.0, 8.0))
    left: list[psutil.Process] = []
    kills = 0
    while kills < KILLS:
        process = score(folders[-1], routes, workers)
        try:
            assert process.wait(float(next(moments))) == 0
            folders.append(tmp_path / f"killed{len(folders)}")
        except subprocess.TimeoutExpired:
            left += offspring(process)
            os.kill(process.pid, signal.SIGKILL)  # the run alone: what it started must end by itself
            process.wait()
            kills += 1
            if (folders[-1] / RESULTS).exists():  # always whole, never half written
                Run.load(folders[-1])
    time.sleep(1.0)
    assert score(folders[-1], routes, workers).wait(600.0) == 0
    for out in folders:
        assert same(whole, Run.load(out))
        assert len(list((out / "pictures").glob("*.png"))) == ROUTES
        assert (out / REPORT).is_file()
        assert not [path for path in out.rglob("*") if path.suffix in (".partial", ".tmp")]
    _, alive = psutil.wait_procs(left, timeout=30.0)
    assert not alive, "a process was left behind"
