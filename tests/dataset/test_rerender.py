"""A dataset shipped as its logs alone becomes the dataset collected with blobs, to the same bytes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from lavsim.cli import main
from lavsim.dataset import folder
from lavsim.dataset.check import check
from lavsim.dataset.collect import collect
from lavsim.dataset.noise import ControlNoise
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.rerender import render
from lavsim.errors import DatasetError, LogError, OutputError
from tests.dataset.collected import digests, short_plan

PLAN = short_plan(frames=20, noise=ControlNoise(share=1.0, every=2.0))


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Collected as logs alone; not to be changed."""
    return collect(PLAN, tmp_path_factory.mktemp("logs") / "data").root


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Collected with blobs; not to be changed."""
    plan = PLAN.model_copy(update={"log_only": False})
    return collect(plan, tmp_path_factory.mktemp("whole") / "data").root


def test_logs_alone_become_the_dataset_collected_with_blobs(logs: Path, whole: Path, tmp_path: Path) -> None:
    made = render(logs, tmp_path / "data")
    assert digests(tmp_path / "data") == digests(whole)
    assert (made.frames, len(made.records)) == (24, 2)


def test_in_place_and_after_a_kill_too(logs: Path, whole: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(logs, root)
    first = folder.whole_episodes(root)[1]
    render(root)
    assert digests(root) == digests(whole)
    first.write(root)  # killed before the second record
    (root / "blobs/ep_000001.tar").rename(root / "blobs/ep_000001.tar.partial")
    render(root)
    assert digests(root) == digests(whole)
    assert render(root).frames == 24  # nothing is left to do


@pytest.mark.slow
def test_other_processes_render_the_same(logs: Path, whole: Path, tmp_path: Path) -> None:
    render(logs, tmp_path / "data", workers=2)
    assert digests(tmp_path / "data") == digests(whole)


def test_labels_come_back_from_the_log_and_so_does_the_wish_under_noise(whole: Path) -> None:
    table = Dataset(whole).table(0)
    assert table["target_speed"].max() > 0.0
    after = table.columns["tick_control"]  # its first row of a frame was applied in the tick after the frame before
    applied = np.stack([after.row(frame)[0] for frame in range(1, len(table))])
    wished = table["wish"][:-1]
    assert np.array_equal(applied[:, [0, 2]], wished[:, [0, 2]])
    assert np.abs(applied[:, 1] - wished[:, 1]).max() > 0.01


def test_other_sensors_make_another_dataset(logs: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    render(logs, root, suite="lav")
    dataset = Dataset(root)
    assert [field.name for field in dataset.info.blobs] == ["rgb_0", "rgb_1", "rgb_2", "tel_rgb", "lidar"]
    assert dataset.read(0, 3, ["rgb_1"])["rgb_1"].shape == (288, 256, 3)
    assert not list(check(root))
    with pytest.raises(OutputError, match="blobs of other sensors already"):
        render(logs, root, resume=True)
    with pytest.raises(OutputError, match="already holds a dataset"):
        render(logs, root)


def test_a_log_by_itself_becomes_a_dataset(logs: Path, tmp_path: Path) -> None:
    log = tmp_path / "drives/drive.lavlog"
    log.parent.mkdir()
    shutil.copy(logs / "logs/ep_000001.lavlog", log)
    with pytest.raises(OutputError, match="give --out"):
        render(log)
    made = render(log, tmp_path / "data", suite="lav")
    assert made.records[0].facts == {"log": "drive"}
    assert Dataset(tmp_path / "data").table(0)["target_speed"].max() > 0.0
    log.write_bytes(log.read_bytes()[:-200])  # cut short: what there is is rendered
    assert render(log.parent, tmp_path / "again", suite="lav", labels=False).records[0].ending == "the log is cut short"


def test_an_agent_that_drives_differently_here_is_told(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from agents.behavior.agent import BehaviorAgent

    root = tmp_path / "data"
    shutil.copytree(logs, root)
    before = digests(root)
    step = BehaviorAgent.run_step

    def late(self: BehaviorAgent, data: dict[str, tuple[int, object]], time: float) -> object:
        control = step(self, data, time)
        return control if time < 1.0 else type(control)(throttle=0.1)

    monkeypatch.setattr(BehaviorAgent, "run_step", late)
    with pytest.raises(LogError, match=r"ep_000000\.lavlog: at tick 20 the agent drives differently .* --no-labels"):
        render(root)
    assert {k: v for k, v in digests(root).items() if "meta" not in k} == {
        k: v for k, v in before.items() if "meta" not in k
    }
    render(root, labels=False)
    assert set(Dataset(root).table(0)["brake_cause"]) <= {"none", "unknown"}


def test_empty_episodes_stay_where_they_are(logs: Path, tmp_path: Path) -> None:
    source = tmp_path / "source"
    shutil.copytree(logs, source)
    record = EpisodeRecord.read(source / "episodes/ep_000000.json")
    folder.remove(source, 0)
    EpisodeRecord(**{**vars(record), "frames": 0, "ticks": 0, "files": {}, "ending": "crashed: x"}).write(source)
    assert [r.frames for r in render(source, tmp_path / "data", suite="lav").records] == [0, 12]


def test_what_is_nothing_to_render_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DatasetError, match="holds no logs"):
        render(tmp_path)
    with pytest.raises(DatasetError, match="there is no"):
        render(tmp_path / "nowhere.lavlog", tmp_path / "out")
    assert main(["render", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_command_line_renders(logs: Path, whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(logs), "--out", str(tmp_path / "data")]) == 0
    assert "24 frames in 2 episodes" in capsys.readouterr().out
    assert digests(tmp_path / "data") == digests(whole)
    assert json.loads((tmp_path / "data/meta/plan.json").read_text())["plan"]["log_only"] is False
