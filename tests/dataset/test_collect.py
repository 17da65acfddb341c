"""Collecting: the dataset depends on the plan alone, whatever the workers, the interruptions and the disk do."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import time
from pathlib import Path
from typing import Any

import pytest

from lavsim.cli import main
from lavsim.dataset import collect as collecting
from lavsim.dataset import drive as driving
from lavsim.dataset import folder
from lavsim.dataset.collect import Collected, collect
from lavsim.dataset.plan import CollectPlan, EpisodePlan
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.tally import Progress, bytes_of
from lavsim.errors import AgentError, LavsimError, OutputError
from lavsim.log.reader import LogReader
from tests.dataset.collected import digests, short_plan


@pytest.fixture(scope="session")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset of `short_plan()`; not to be changed."""
    root = tmp_path_factory.mktemp("collected") / "data"
    collect(short_plan(), root)
    return root


def names(root: Path) -> set[str]:
    return {path for path in digests(root) if not path.startswith(("meta/", "README"))}


def test_the_dataset_is_the_shortest_run_of_episodes_with_frames_enough(collected: Path) -> None:
    records = folder.whole_episodes(collected)
    assert sorted(records) == [0, 1, 2]
    assert [records[number].frames for number in range(3)] == [12, 12, 12]
    assert {record.ending for record in records.values()} == {"tick limit"}
    assert names(collected) == {
        f"{d}/ep_00000{k}.{s}" for k in range(3) for d, s in (("logs", "lavlog"), ("episodes", "json"))
    }
    log = LogReader(collected / "logs/ep_000001.lavlog")
    assert len(log) == 60
    assert log.header["agent"] == {"target": "agents.behavior:BehaviorAgent", "config": None}
    assert records[0].facts["weather"] == "lav"


def test_two_processes_collect_what_one_collects(collected: Path, tmp_path: Path) -> None:
    seen: list[Progress] = []
    collect(short_plan(), tmp_path / "data", workers=2, on_progress=seen.append)
    assert digests(tmp_path / "data") == digests(collected)
    assert seen[-1].frames >= seen[-1].wanted == 30
    assert seen[-1].bytes >= sum(bytes_of(r) for r in folder.whole_episodes(collected).values()), "it may drive ahead"


def test_a_dataset_grows_into_the_larger_one(collected: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    collect(short_plan(frames=10), root)
    first = digests(root)["logs/ep_000000.lavlog"]
    collect(short_plan(), root, resume=True)
    assert digests(root) == digests(collected)
    assert digests(root)["logs/ep_000000.lavlog"] == first
    before = {path: path.stat().st_mtime_ns for path in root.rglob("ep_*")}
    collect(short_plan(), root, resume=True)  # nothing is left to do
    assert {path: path.stat().st_mtime_ns for path in root.rglob("ep_*")} == before


def test_what_a_kill_leaves_is_driven_again(collected: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(collected, root)
    (root / "episodes/ep_000001.json").unlink()  # killed between the log and its record
    (root / "logs/ep_000002.lavlog").rename(root / "logs/ep_000002.lavlog.partial")  # killed in the middle of it
    (root / "episodes/ep_000002.json").rename(root / "episodes/ep_000002.json.partial")
    (root / "blobs/ep_000007.tar.partial").write_bytes(b"half a shard")
    shutil.copy(root / "logs/ep_000000.lavlog", root / "logs/ep_000005.lavlog")
    collect(short_plan(), root, resume=True)
    assert digests(root) == digests(collected)


def test_episodes_beyond_the_last_one_needed_go(collected: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(collected, root)
    shutil.copy(root / "logs/ep_000002.lavlog", root / "logs/ep_000009.lavlog")
    record = EpisodeRecord.read(root / "episodes/ep_000002.json")
    facts = record.files["logs/ep_000002.lavlog"]
    values = {**vars(record), "episode": 9, "files": {"logs/ep_000009.lavlog": facts}}
    EpisodeRecord(**values).write(root)
    collect(short_plan(), root, resume=True)
    assert digests(root) == digests(collected)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 3}, "begun with seed = 2, not 3"),
        ({"vehicles": (4, 9)}, r"begun with vehicles = \[4, 8\], not \[4, 9\]"),
        ({"weathers": ("ClearNoon",)}, r"begun with weathers = \['lav'\], not \['ClearNoon'\]"),
        ({"frames": 29}, "begun for 30 frames; it can grow, not shrink"),
        ({"noise": {}}, "begun with noise = None, not"),
    ],
)
def test_another_plan_is_refused_by_the_field_that_differs(
    collected: Path, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    root = tmp_path / "data"
    shutil.copytree(collected, root)
    with pytest.raises(OutputError, match=message) as raised:
        collect(short_plan(**change), root, resume=True)
    assert "\n" not in str(raised.value)
    assert digests(root) == digests(collected)


def test_a_folder_that_holds_a_dataset_is_left_alone_unless_told(collected: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(collected, root)
    (root / "mine.txt").write_text("stays")
    with pytest.raises(OutputError, match=r"already holds a dataset .* --resume, --overwrite or another folder"):
        collect(short_plan(), root)
    with pytest.raises(OutputError, match="give one of them"):
        collect(short_plan(), root, resume=True, overwrite=True)
    collect(short_plan(seed=9, frames=1), root, overwrite=True)
    assert sorted(folder.whole_episodes(root)) == [0]
    assert (root / "mine.txt").read_text() == "stays"
    with pytest.raises(OutputError, match=r"mine\.txt is a file"):
        collect(short_plan(), root / "mine.txt")


def test_two_collections_never_write_into_one_folder(collected: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(collected, root)
    handle = os.open(root / "episodes", os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with pytest.raises(OutputError, match="another process writes into"):
        collect(short_plan(), root, resume=True)
    os.close(handle)
    collect(short_plan(), root, resume=True)


def test_a_damaged_episode_is_named_before_anything_is_driven(collected: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(collected, root)
    log = root / "logs/ep_000001.lavlog"
    log.write_bytes(log.read_bytes()[:-1])
    with pytest.raises(
        LavsimError, match=r"logs/ep_000001\.lavlog has \d+ bytes instead of \d+; delete ep_000001\.json"
    ):
        collect(short_plan(), root, resume=True)
    (root / "episodes/ep_000001.json").unlink()
    collect(short_plan(), root, resume=True)
    assert digests(root) == digests(collected)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_full_disk_stops_with_one_line_and_harms_nothing(
    collected: Path, tmp_path: Path, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "data"
    monkeypatch.setattr(collecting, "collect_episode", disk_full_at_the_second)
    with pytest.raises(OutputError, match=r"no space is left for .*12 of 30 frames are safe") as raised:
        collect(short_plan(), root, workers=workers)
    assert "--resume" in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not list(root.rglob("*.partial"))
    monkeypatch.undo()
    collect(short_plan(), root, resume=True)
    assert digests(root) == digests(collected)


def disk_full_at_the_second(task: driving.EpisodeTask, report: Any) -> EpisodeRecord:
    if task.number == 0:
        return driving.collect_episode(task, report)
    while not (task.root / "episodes/ep_000000.json").exists():
        time.sleep(0.05)
    (task.root / f"logs/ep_{task.number:06d}.lavlog.partial").write_bytes(b"half")
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_an_episode_that_crashes_is_an_empty_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = driving.drive_episode

    def fails_once(root: Path, plan: CollectPlan, episode: EpisodePlan, report: Any) -> EpisodeRecord:
        if episode.number == 1:
            raise ZeroDivisionError("in a hazard")
        return drive(root, plan, episode, report)

    monkeypatch.setattr(driving, "drive_episode", fails_once)
    made = collect(short_plan(frames=20), tmp_path / "data")
    assert [(r.frames, r.ending) for r in made.records] == [
        (12, "tick limit"), (0, "crashed: ZeroDivisionError: in a hazard"), (12, "tick limit"),
    ]  # fmt: skip


def test_an_agent_that_can_not_drive_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(LavsimError, match=r"agents\.nowhere"):
        collect(short_plan(agent="agents.nowhere:Agent"), tmp_path / "a")
    with pytest.raises(AgentError, match="can't drive"):
        collect(short_plan(agent="tests.dataset.test_collect:Broken"), tmp_path / "b")


class Broken:
    def __init__(self, path: str | None) -> None:
        raise RuntimeError("no weights")

    def sensors(self) -> list[Any]:
        return []

    def run_step(self, data: Any, timestamp: float) -> Any: ...


def test_the_command_line_collects_and_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "data"
    options = ["--towns", "eu_small_a", "--vehicles", "4-8", "--walkers", "0-2", "--length", "150-400", "--log-only",
               "--set", "episode_frames=12", "--seed", "2"]  # fmt: skip
    assert main(["collect", "--out", str(out), "--frames", "10", *options]) == 0
    assert "12 frames in 1 episodes" in capsys.readouterr().out
    assert json.loads((out / "meta/plan.json").read_text())["plan"] == short_plan(frames=10).to_json()
    assert main(["collect", "--out", str(out), "--frames", "10", *options]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["collect", "--out", str(out), "--frames", "1", "--hours", "1"]) == 2
    assert main(["collect", "--out", str(tmp_path / "b"), "--towns", "eu_smal_a"]) == 2
    assert "Did you mean 'eu_small_a'" in capsys.readouterr().err


def test_what_is_collected_says_how_much_it_is(collected: Path) -> None:
    made = Collected(collected, tuple(folder.whole_episodes(collected).values()))
    assert made.frames == 36
    assert made.bytes == sum((collected / name).stat().st_size for name in names(collected) if "logs" in name)


@pytest.mark.slow
def test_a_cluster_collects_what_one_process_collects(collected: Path, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    try:
        collect(short_plan(), tmp_path / "data", cluster="local")
    finally:
        ray.shutdown()
    assert digests(tmp_path / "data") == digests(collected)
