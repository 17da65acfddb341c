"""Drives that failed, taken over by the expert: the same up to the handover, frames from there on."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from lavsim.cli import main
from lavsim.dataset.check import check
from lavsim.dataset.fork import Failure, ForkConfig, ForkTask, apart, drive_fork, fork
from lavsim.dataset.reader import Dataset
from lavsim.dataset.rerender import render
from lavsim.errors import LogError, OutputError
from lavsim.log.reader import LogReader
from lavsim.log.replay import resume
from lavsim.log.writer import LogWriter
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from leaderboard.failures import failures_of
from leaderboard.run import LOGS, Run
from tests.drives import straight_drive
from tests.leaderboard.runs import make_run

TICKS, FAILS = 160, 148
CONFIG = ForkConfig(before=2.0, after=1.5)
WORLD = straight_drive(traffic="lav", vehicles=15, walkers=5)
HANDED_OVER = 105  # 148 less 40, at a frame's tick


def learner(path: Path, spec: DriveSpec, changed: int | None = None) -> Path:
    """The log of a drive that wanders to the right; `changed` is another seed in its header."""
    simulation = Simulation(spec)
    log = LogWriter(path, {} if changed is None else {"seed": changed})
    log.start(simulation)
    log.observe(simulation.snapshot)
    for tick in range(TICKS - 1):
        log.observe(simulation.tick(Control(throttle=0.5, steer=0.02 if tick > 60 else 0.0)))
    log.finish(type("Result", (), {"summary": lambda self: {"ticks": TICKS, "ending": "x", "agent_status": 0}})())
    return path


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A learner's drive; not to be changed."""
    return learner(
        tmp_path_factory.mktemp("learner") / "a.lavlog", straight_drive(traffic="lav", vehicles=15, walkers=5)
    )


@pytest.fixture(scope="module")
def forked(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its fork; not to be changed."""
    return fork([Failure(drive, FAILS, "red_light")], tmp_path_factory.mktemp("forks"), CONFIG)[0]


def test_a_fork_is_the_drive_up_to_the_handover_and_the_experts_from_there(drive: Path, forked: Path) -> None:
    before, after = LogReader(drive), LogReader(forked)
    assert after.header["handover"] == HANDED_OVER
    assert after.header["fork"] == {"log": "a.lavlog", "tick": FAILS, "what": "red_light"}
    assert after.status == {"ticks": HANDED_OVER + 30, "ending": "tick limit", "agent_status": 0}
    same = [np.array_equal(before.at_tick(t).pose, after.at_tick(t).pose) for t in range(1, HANDED_OVER + 1)]
    assert all(same)
    assert not np.array_equal(before.controls()[HANDED_OVER], after.controls()[HANDED_OVER])
    assert resume(forked, HANDED_OVER + 20).snapshot.tick == HANDED_OVER + 20, "it is a log like any other"


def test_frames_begin_where_the_expert_drives(forked: Path, tmp_path: Path) -> None:
    made = render(forked.parent, tmp_path / "data", suite="lav")
    assert made.frames == 7  # every fifth tick of 105 to 135
    table = Dataset(tmp_path / "data").table(0)
    assert table["tick"].tolist() == list(range(HANDED_OVER, HANDED_OVER + 31, 5))
    assert np.isfinite(table["wish"]).all()
    assert [len(table.row(k, ("tick_pose",))["tick_pose"]) for k in range(7)] == [5] * 7
    driven = LogReader(forked).at_tick(HANDED_OVER + 1).control
    assert np.array_equal(table["wish"][0], driven), "what the expert asks for at the first frame is what is done"
    assert check(tmp_path / "data", agents=True) == []


def test_forks_that_are_there_stay_and_the_others_are_made(drive: Path, forked: Path, tmp_path: Path) -> None:
    failures = [Failure(drive, FAILS, "red_light"), Failure(drive, 60, "collisions_vehicle")]
    out = tmp_path / "forks"
    fork(failures, out, CONFIG)
    bytes_of = {path.name: path.read_bytes() for path in sorted(out.iterdir())}
    assert list(bytes_of) == ["fork_00000.lavlog", "fork_00001.lavlog"]
    assert bytes_of["fork_00001.lavlog"] == forked.read_bytes(), "a fork depends on its drive alone"
    (out / "fork_00001.lavlog").unlink()
    with pytest.raises(OutputError, match="holds forks already; give --resume"):
        fork(failures, out, CONFIG)
    told: list[str] = []
    fork(failures, out, CONFIG, workers=2, resume=True, on_done=lambda task, ending: told.append(task.out.name))
    assert told == ["fork_00001.lavlog"]
    assert {path.name: path.read_bytes() for path in sorted(out.iterdir())} == bytes_of


def test_a_drive_that_is_another_one_here_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    log = learner(tmp_path / "b.lavlog", WORLD, changed=77)
    with pytest.raises(LogError, match=r"b\.lavlog: driven again, tick 105 differs"):
        drive_fork(ForkTask(Failure(log, FAILS, "red_light"), CONFIG, tmp_path / "fork.lavlog"), lambda _: None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.lavlog"]


def test_of_failures_close_together_the_first_counts(tmp_path: Path) -> None:
    a, b = tmp_path / "a", tmp_path / "b"
    found = [
        Failure(b, 20, "x"),
        Failure(a, 400, "x"),
        Failure(a, 100, "x"),
        Failure(a, 380, "x"),
        Failure(a, 130, "x"),
    ]
    assert [(each.log.name, each.tick) for each in apart(found, 10.0)] == [("a", 100), ("a", 380), ("b", 20)]
    assert ForkTask(Failure(a, 30, "x"), CONFIG, a).tick == 5, "not before the first frame"


def test_failures_of_a_run_are_its_infractions_and_who_is_blocked_failed_when_he_last_moved(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    assert [(each.tick, each.what) for each in failures_of(run)] == [(120, "collisions_vehicle"), (240, "red_light")]
    assert [each.what for each in failures_of(run, ("red_light",))] == ["red_light"]


def test_the_command_line_forks_a_run(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = make_run(tmp_path / "run")
    shutil.copy(drive, run.folder / LOGS / "a.lavlog")
    content = json.loads((run.folder / "run.json").read_text())
    blocked = {"key": "vehicle_blocked", "tick": FAILS, "message": "", "position": [0.0, 0.0, 0.0]}
    content["drives"] = [{**content["drives"][0], "log": f"{LOGS}/a.lavlog", "infractions": [blocked]}]
    (run.folder / "run.json").write_text(json.dumps(content))
    assert [each.tick for each in failures_of(Run.load(run.folder))] == [FAILS], "it moves"
    arguments = ["fork", str(run.folder), "--out", str(tmp_path / "forks")]
    assert main([*arguments, "--kinds", "red_light"]) == 0
    assert "no failures, no forks" in capsys.readouterr().out
    assert main([*arguments, "--before", "2", "--after", "1.5"]) == 0
    told = capsys.readouterr().out
    assert "fork_00000.lavlog  a, vehicle_blocked: tick limit" in told
    assert f"lavsim render {tmp_path / 'forks'} --out DATA" in told
    for wrong, message in ((["--kinds", "red_lights"], "Did you mean 'red_light'?"), (["--before", "0"], "before")):
        assert main([*arguments, *wrong]) == 2
        assert message in capsys.readouterr().err
