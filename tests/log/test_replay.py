"""Recorded drives driven on, judged and rendered again."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lavsim.log.replay as replay_module
from lavsim.errors import LogError
from lavsim.log.reader import LogReader
from lavsim.log.replay import digest_of, recent_of, restore, resume, route_of, save, town_of
from lavsim.log.writer import LogWriter
from lavsim.simulation import Simulation
from lavsim.types import Control
from leaderboard.observer import CriteriaObserver
from leaderboard.rules import get_rules
from tests.drives import follow, hazard, straight_drive

TICKS, FORK = 160, 97
ROOT = Path(__file__).parents[2]


class Result:
    failure = None

    def summary(self) -> dict[str, str]:
        return {"ending": "tick limit"}


def drive() -> Simulation:
    return Simulation(
        straight_drive(traffic="lav", vehicles=20, scenarios=(hazard("DynamicObjectCrossing", 30, distance="12"),))
    )


def act(simulation: Simulation) -> None:
    simulation.tick(follow(simulation.route, simulation.snapshot))


def swerve(simulation: Simulation) -> None:
    """What nobody did in the recorded drive."""
    simulation.tick(Control(throttle=0.9, steer=0.3 * np.sin(0.1 * simulation.snapshot.tick)))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str], bytes]:
    """A log, the digest of each of its ticks, and the drive saved at tick `FORK`."""
    path = tmp_path_factory.mktemp("drive") / "drive.lavlog"
    simulation, writer = drive(), LogWriter(path)
    writer.start(simulation)
    digests, saved = [], b""
    for _ in range(TICKS):
        digests.append(digest_of(simulation.snapshot))
        writer.observe(simulation.snapshot)
        if simulation.snapshot.tick == FORK:
            saved = save(simulation)
        act(simulation)
    writer.finish(Result())  # type: ignore[arg-type]
    return path, digests, saved


Recorded = tuple[Path, list[str], bytes]


def test_a_resumed_drive_goes_on_as_the_recorded_one(recorded: Recorded) -> None:
    path, digests, saved = recorded
    for simulation in (resume(path, FORK), restore(saved)):
        for digest in digests[FORK - 1 :]:
            assert digest_of(simulation.snapshot) == digest
            act(simulation)


def test_a_fork_equals_the_same_change_of_the_first_drive(recorded: Recorded) -> None:
    path, _, saved = recorded
    first = drive()
    while first.snapshot.tick < FORK:
        act(first)
    forks = [resume(LogReader(path), FORK), restore(saved)]
    for _ in range(60):
        for simulation in (first, *forks):
            swerve(simulation)
        assert len({digest_of(simulation.snapshot) for simulation in (first, *forks)}) == 1
    assert not np.array_equal(LogReader(path).at_tick(FORK + 60).pose[0], first.snapshot.pose[0])
    assert save(first) == save(forks[0]) == save(forks[1])


def test_another_process_forks_to_the_same_bytes(recorded: Recorded) -> None:
    path, _, saved = recorded
    (path.parent / "saved").write_bytes(saved)
    code = (
        "import sys; from pathlib import Path; from lavsim.log.replay import *;"
        "from tests.log.test_replay import swerve\n"
        "for s in (resume(Path(sys.argv[1]), int(sys.argv[3])), restore(Path(sys.argv[2]).read_bytes())):\n"
        "    for _ in range(60): swerve(s)\n"
        "    print(digest_of(s.snapshot))"
    )
    command = [sys.executable, "-c", code, str(path), str(path.parent / "saved"), str(FORK)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    here = restore(saved)
    for _ in range(60):
        swerve(here)
    assert done.stdout.split() == [digest_of(here.snapshot)] * 2


def test_a_drift_is_reported_at_its_first_tick(recorded: Recorded, monkeypatch: pytest.MonkeyPatch) -> None:
    class Drifting(Simulation):
        def _publish(self) -> Any:
            snapshot = super()._publish()
            if snapshot.tick >= 50:
                pose = snapshot.pose.copy()
                pose[3, 0] += 1
                self._recent[-1] = replace(snapshot, pose=pose)
            return self._recent[-1]

    monkeypatch.setattr(replay_module, "Simulation", Drifting)
    resume(recorded[0], 49)
    with pytest.raises(LogError, match=r"^drive\.lavlog: driven again, tick 50 differs .* in pose of actor \d+\.$"):
        resume(recorded[0], TICKS)
    with pytest.raises(LogError, match=f"saved drive, driven again, differs at tick {FORK}"):
        restore(recorded[2])


def test_another_town_is_refused_in_one_line(recorded: Recorded, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = LogReader(recorded[0])
    reader.header["town_digest"] = "0123"
    with pytest.raises(
        LogError, match=r"^drive\.lavlog was driven in eu_small_a 0123 with scenery .*; here it is [^\n]*$"
    ):
        resume(reader, 10)
    monkeypatch.setattr(replay_module, "SCENERY_VERSION", -1)
    with pytest.raises(LogError, match=r"^the saved drive was driven in eu_small_a [^\n]*$"):
        restore(recorded[2])


def test_what_can_not_be_resumed_is_refused(recorded: Recorded) -> None:
    path, _, saved = recorded
    for tick in (0, TICKS + 1):
        with pytest.raises(LogError, match=f"drive.lavlog holds ticks 1 to {TICKS}; it can't be resumed at {tick}"):
            resume(path, tick)
    reader = LogReader(path)
    del reader.header["seed"]
    with pytest.raises(LogError, match="another version of lavsim: its header lacks 'seed'"):
        resume(reader, 10)
    for damaged in (b"", b"abc", saved[:-1], saved[:50] + bytes([saved[50] ^ 1]) + saved[51:]):
        with pytest.raises(LogError, match="not a saved drive, or a damaged one"):
            restore(damaged)


def test_a_log_is_judged_as_the_drive_was(recorded: Recorded) -> None:
    """Criteria see the same snapshots live and from the log, so they say the same."""
    simulation = drive()
    live, again = CriteriaObserver(get_rules("1.0")), CriteriaObserver(get_rules("1.0"))
    live.start(simulation)
    for _ in range(TICKS):
        live.observe(simulation.snapshot)
        act(simulation)
    reader = LogReader(recorded[0])
    town = town_of(reader)
    again.watch(town, route_of(reader, town))
    for snapshot in reader:
        again.observe(snapshot)
    for criteria in (live, again):
        criteria.close(None)
    assert again.verdict() == live.verdict()
    assert live.verdict().ticks == TICKS
    assert live.verdict().completion > 0.0


def test_what_was_recent_at_a_tick_is_found_across_blocks(tmp_path: Path) -> None:
    simulation, writer = Simulation(straight_drive()), LogWriter(tmp_path / "a.lavlog", block_ticks=10)
    writer.start(simulation)
    recent = []
    for _ in range(35):
        writer.observe(simulation.snapshot)
        recent.append([digest_of(s) for s in simulation.recent(4)])
        act(simulation)
    writer.finish(Result())  # type: ignore[arg-type]
    reader = LogReader(tmp_path / "a.lavlog")
    for index in (34, 0, 2, 10, 11, 30):
        assert [digest_of(s) for s in recent_of(reader, index, 4)] == recent[index]
