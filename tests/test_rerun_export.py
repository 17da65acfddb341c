"""Drives for Rerun: the frame's turn on paper; the file only where Rerun is installed."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lavsim.cli import main
from lavsim.dataset.export_rerun import export_rerun
from lavsim.dataset.reader import Dataset
from lavsim.log.writer import LogWriter
from lavsim.rerun_export import boxes_of, flipped
from lavsim.simulation import Simulation
from lavsim.types import Control
from tests.dataset.made import actor, info_of, row_of, write_dataset, write_episode
from tests.drives import straight_drive
from tests.viewer import drives

SPIN = (10.0, 4.0, 0.5)  # of the ego in the dataset: x, y [m], yaw [rad]
HAS_RERUN = importlib.util.find_spec("rerun") is not None


def test_boxes_turn_with_the_frame() -> None:
    snapshot = drives.snapshots()[60]
    boxes = boxes_of(snapshot)
    x, y, z, w = boxes["quaternions"].T
    ahead = np.stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w)], axis=1)
    assert ahead == pytest.approx(flipped(np.column_stack([np.cos(snapshot.yaw), np.sin(snapshot.yaw), 0 * z]))[:, :2])
    assert boxes["centers"][0] == pytest.approx([snapshot.ego.x, -snapshot.ego.y, snapshot.ego.height / 2.0])
    assert boxes["half_sizes"] * 2.0 == pytest.approx(snapshot.sizes)
    assert boxes["labels"][0] == "car 1"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    simulation = Simulation(straight_drive())
    writer = LogWriter(tmp_path / "a.lavlog")
    writer.start(simulation)
    for _ in range(5):
        writer.observe(simulation.tick(Control(throttle=1.0)))
    writer._flush()
    writer.close()
    return tmp_path / "a.lavlog"


@pytest.mark.skipif(HAS_RERUN, reason="Rerun is installed")
def test_without_rerun_it_says_what_to_install(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(log), "--rerun", str(log.with_suffix(".rrd"))]) == 2
    assert "lavsim[rerun]" in capsys.readouterr().err


@pytest.mark.skipif(not HAS_RERUN, reason="Rerun is not installed: its wheel has 170 MB, so it is no part of 'dev'")
def test_recording_is_written(log: Path) -> None:
    path = log.with_suffix(".rrd")
    assert main(["show", str(log), "--rerun", str(path)]) == 0
    assert path.read_bytes().startswith(b"RRF")
    assert path.stat().st_size > 10_000


class Recorder:
    """In the place of Rerun's module and of a stream of it: keeps what is logged, as name and arguments."""

    def __init__(self) -> None:
        self.logged: list[tuple[str, str, Any]] = []
        self.times: list[dict[str, Any]] = []
        self.saved: list[Path] = []
        self.ViewCoordinates = SimpleNamespace(RIGHT_HAND_Z_UP="z up")

    def __getattr__(self, name: str) -> Any:
        return lambda *values, **named: (name, values, named)

    def RecordingStream(self, name: str, recording_id: str) -> Recorder:  # noqa: N802
        return self

    def save(self, path: Path) -> None:
        self.saved.append(path)
        path.write_bytes(b"RRF")

    def set_time(self, line: str, **value: Any) -> None:
        self.times.append({line: value})

    def log(self, place: str, thing: Any, static: bool = False) -> None:
        self.logged.append((place, thing[0] if isinstance(thing, tuple) else "", thing))

    def of(self, place: str) -> list[Any]:
        return [thing for at, _, thing in self.logged if at == place]


@pytest.fixture
def rerun(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    made = Recorder()
    monkeypatch.setitem(sys.modules, "rerun", made)
    return made


def test_episodes_of_a_dataset_are_recordings(rerun: Recorder, tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", (3, 2))
    assert main(["dataset", "export", str(tmp_path / "d"), "--format", "rerun", "--out", str(tmp_path / "r")]) == 0
    assert sorted(path.name for path in (tmp_path / "r").iterdir()) == ["ep_000000.rrd", "ep_000001.rrd"]
    dataset = Dataset(tmp_path / "d")
    (_, _, first), *_ = rerun.of("cameras/rgb_0")
    assert first == {"contents": dataset.encoded(0, 0, "rgb_0"), "media_type": "image/jpeg"}
    _, (tags,), _ = rerun.of("cameras/sem_0")[-1]
    np.testing.assert_array_equal(tags, dataset.read(1, 1, ["sem_0"])["sem_0"])
    for place in ("world/actors", "world/lidar", "bev", "ego/speed"):
        assert len(rerun.of(place)) - (place == "bev") * 2 == 5, place  # of BEV also the names of its layers


def test_what_an_ego_sees_stands_in_the_world(rerun: Recorder, tmp_path: Path) -> None:
    """A car 8 m ahead of an ego that is turned to the right, and the goal on it."""
    x, y, yaw = SPIN
    ahead = np.array([x + 8.0 * np.cos(yaw), y + 8.0 * np.sin(yaw), 0.0])
    info = info_of()
    info.write(tmp_path / "d")
    goal = np.array([8.0, 0.0], np.float32)
    values = {"position": (x, y, 0.0), "yaw": yaw, "goal": goal}
    write_episode(tmp_path / "d", info, 0, [row_of(info, 0, [actor(7, at=ahead)], **values)])
    export_rerun(tmp_path / "d", tmp_path / "r")
    ((_, _, boxes),) = rerun.of("world/actors")
    assert boxes["labels"] == ["car 1", "car 7"]
    assert boxes["centers"][1] == pytest.approx([ahead[0], -ahead[1], 0.75])
    ((_, (points,), _),) = rerun.of("world/goal")
    assert points[0] == pytest.approx([ahead[0], -ahead[1], 0.0], abs=1e-5)


def test_datasets_need_rerun_and_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if HAS_RERUN:
        pytest.skip("Rerun is installed")
    write_dataset(tmp_path / "d", (1,))
    assert main(["dataset", "export", str(tmp_path / "d"), "--format", "rerun", "--out", str(tmp_path / "r")]) == 2
    assert "lavsim[rerun]" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


@pytest.mark.skipif(not HAS_RERUN, reason="Rerun is not installed: its wheel has 170 MB, so it is no part of 'dev'")
def test_recordings_of_a_dataset_are_written(tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", (3, 2))
    assert export_rerun(tmp_path / "d", tmp_path / "r") == {"episodes": 2, "frames": 5}
    for path in (tmp_path / "r").iterdir():
        assert path.read_bytes().startswith(b"RRF")
        assert path.stat().st_size > 10_000
