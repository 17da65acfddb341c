"""Agents that mean harm: each loses its own route, the status says how, and nothing of it stays."""

from __future__ import annotations

from multiprocessing import resource_tracker
from pathlib import Path

import psutil
import pytest

from leaderboard.evaluator import evaluate
from leaderboard.run import Run
from tests.leaderboard.test_evaluator import AGENT, config, without_clock

# What it does, how its route ends, and a part of what is told.
CRASHED, NO_SETUP = "Failed - Agent crashed", "Failed - Agent couldn't be set up"
HARM = {
    "raise-in-constructor": (NO_SETUP, "set-up raised ValueError: no constructor"),
    "raise-in-setup": (NO_SETUP, "set-up raised ValueError: no setup"),
    "raise-in-set_global_plan": (NO_SETUP, "set-up raised ValueError: no set_global_plan"),
    "raise-in-sensors": (NO_SETUP, "set-up raised ValueError: no sensors"),
    "raise-in-run_step": (CRASHED, "run_step raised ValueError: no run_step"),
    "raise-in-destroy": ("Completed", None),
    "none": (CRASHED, "returned None"),
    "nan": (CRASHED, "steer=nan"),
    "text": (CRASHED, "throttle='full'"),
    "out-of-range": ("Completed", None),
    "sleep": ("Failed - Agent timed out", "run_step took longer than"),
    "hang-in-setup": (NO_SETUP, "set-up took longer than"),
    "allocate": (CRASHED, "over its limit of"),
    "exit": (CRASHED, "exit code 7"),
    "write-into-inputs": ("Completed", None),
    "threads": ("Completed", None),
    "children": ("Completed", None),
    "daemon-and-exit": (CRASHED, "exit code 0"),
    "daemon-and-kill-the-guard": (CRASHED, "killed by SIGKILL"),
}
STARTED = {"children": 3, "daemon-and-exit": 1, "daemon-and-kill-the-guard": 1}  # processes
SOME = ["raise-in-sensors", "out-of-range", "children", "daemon-and-exit"]
LIMITS = {"step_timeout": 10.0, "setup_timeout": 20.0, "memory_limit": 600 * 2**20}


def harm(folder: Path, moods: list[str]) -> Run:
    """A run with a drive for each mood, and honest ones between."""
    words = " ".join(moods)
    agent = str(AGENT.with_name("hostile_agent.py"))
    return evaluate(config(folder, words, agent=agent, **LIMITS))


def left_over(run: Run, started: int) -> list[int]:
    """Those of the processes that agents said they `started` that still run."""
    pids = [
        int(pid)
        for path in sorted((run.folder / "logs").glob("*.agent.txt"))
        for line in path.read_text(errors="replace").splitlines()
        if line.startswith("pids ")
        for pid in line.split()[1:]
    ]
    assert len(pids) == started
    return [pid for pid in pids if psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE]


@pytest.mark.parametrize("quick", [SOME, pytest.param(list(HARM), marks=pytest.mark.slow)], ids=["some", "all"])
def test_hostile_agents_lose_their_own_routes_alone(tmp_path: Path, quick: list[str]) -> None:
    resource_tracker.ensure_running()  # Python's own, which building a town starts and leaves
    before = {p.pid for p in psutil.Process().children(recursive=True)}
    moods = ["go", *(word for k, mood in enumerate(quick) for word in ((mood, "go") if k % 4 == 3 else (mood,)))]
    run = harm(tmp_path, moods)
    for number, mood in enumerate(moods):
        status, message = HARM.get(mood, ("Completed", None))
        record, drive = run.records[number], run.run["drives"][number]
        assert record["status"] == status, mood
        assert (message is None) == (drive["agent_message"] is None), mood
        assert message is None or message in drive["agent_message"], mood
    records = without_clock(run)["_checkpoint"]["records"]
    honest = [record for record, mood in zip(records, moods, strict=True) if mood == "go"]
    assert len({str([record["scores"], record["infractions"], record["meta"]]) for record in honest}) == 1
    assert not left_over(run, sum(STARTED.get(mood, 0) for mood in moods))
    assert {p.pid for p in psutil.Process().children(recursive=True)} <= before


@pytest.mark.slow
def test_hanging_in_destroy_costs_seconds(tmp_path: Path) -> None:
    run = harm(tmp_path, ["hang-in-destroy", "go"])
    assert [r["status"] for r in run.records] == ["Completed", "Completed"]


@pytest.mark.slow
def test_a_gigabyte_of_output_is_cut_and_costs_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "loud").mkdir()
    words = config(tmp_path / "loud", "print-a-gigabyte go", agent=str(AGENT.with_name("hostile_agent.py")))
    run = evaluate(words)
    assert [r["status"] for r in run.records] == ["Completed", "Completed"]
    sizes = [path.stat().st_size for path in sorted((run.folder / "logs").glob("*.agent.txt"))]
    assert 10**7 <= sizes[0] < 10**7 + 100
    assert sizes[1] < 1000
