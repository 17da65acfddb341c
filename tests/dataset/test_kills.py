"""A collection killed at any moment and gone on with ends as one that was left alone."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lavsim.dataset.check import check
from lavsim.dataset.collect import collect
from tests.dataset.collected import digests, short_plan

OPTIONS = ["--towns", "eu_small_a", "--vehicles", "4-8", "--walkers", "0-2", "--length", "150-400", "--seed", "2",
           "--workers", "2"]  # fmt: skip


def begin(root: Path, frames: int, episode_frames: int, *more: str) -> subprocess.Popen[bytes]:
    """A collection in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "lavsim", "collect", "--out", str(root), "--frames", str(frames), "--resume",
         "--set", f"episode_frames={episode_frames}", *OPTIONS, *more],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def workers_of(process: subprocess.Popen[bytes]) -> list[int]:
    """Processes of the group of `process`, itself included."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == process.pid:
            found.append(int(path.parent.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_a_collection_killed_in_the_middle_of_an_episode_goes_on(tmp_path: Path) -> None:
    root = tmp_path / "data"
    plan = short_plan(frames=300, episode_frames=60)
    process = begin(root, 300, 60, "--log-only")
    deadline = time.monotonic() + 120.0
    while not list(root.glob("logs/*.partial")) and time.monotonic() < deadline:
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)  # its workers see to it themselves that they end
    assert process.wait() == -signal.SIGKILL
    collect(plan, root, resume=True)
    collect(plan, tmp_path / "alone")
    assert digests(root) == digests(tmp_path / "alone")
    assert not check(root)


@pytest.mark.slow
def test_thirty_kills_at_random_moments_leave_the_dataset_of_none(tmp_path: Path) -> None:
    frames, episode_frames, kills = 2400, 40, 30
    plan = short_plan(frames=frames, episode_frames=episode_frames, log_only=False)
    collect(plan, tmp_path / "alone")
    dice, root, killed = random.Random(1), tmp_path / "data", 0
    while killed < kills:
        process = begin(root, frames, episode_frames)
        before = time.monotonic()
        while not list(root.glob("logs/*.partial")) and time.monotonic() < before + 120.0 and process.poll() is None:
            time.sleep(0.01)
        time.sleep(dice.uniform(0.0, 2.5))
        assert process.poll() is None, "done before all kills were spent"
        victims = workers_of(process)
        kind = killed % 3
        if kind == 0:
            os.kill(process.pid, signal.SIGKILL)
        elif kind == 1:
            for victim in victims:
                os.kill(victim, signal.SIGKILL)
        else:
            worker = dice.choice([v for v in victims if v != process.pid] or victims)
            os.kill(worker, signal.SIGKILL)  # the others go on; then all of them
            time.sleep(dice.uniform(0.0, 1.0))
            os.kill(process.pid, signal.SIGKILL)
        process.wait()
        killed += 1
    last = begin(root, frames, episode_frames)
    _, errors = last.communicate(timeout=1200)
    assert last.returncode == 0, errors.decode()
    assert not check(root, all_blobs=True)
    assert digests(root) == digests(tmp_path / "alone")
