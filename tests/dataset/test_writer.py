"""A recorded drive is the dataset that was seen live, whole or not there at all."""

import json
import tarfile
from pathlib import Path

import numpy as np
import pytest

from lavsim.dataset.files import FileFacts
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.dataset.writer import EpisodeWriter
from lavsim.episode import EpisodeResult
from lavsim.log.reader import LogReader
from lavsim.simulation import Simulation
from lavsim.types import Control
from tests.dataset.recorded import SUITE, TICKS, drive, make_dataset, record
from tests.drives import straight_drive


def files_below(root: Path) -> dict[str, FileFacts]:
    return {str(path.relative_to(root)): FileFacts.of(path) for path in root.rglob("*") if path.is_file()}


def test_a_drive_recorded_again_gives_the_same_bytes(recorded: Path, tmp_path: Path) -> None:
    record(tmp_path, 1, DatasetInfo.read(recorded), drive(1))
    again, first = files_below(tmp_path), files_below(recorded)
    assert len(again) == 5
    assert all(first[name] == facts for name, facts in again.items())


def test_every_fifth_tick_is_a_frame(recorded: Path) -> None:
    data = Dataset(recorded)
    assert list(data.episodes) == [0, 1]
    assert len(data) == 2 * (TICKS // 5)
    assert data.table(0)["tick"].tolist() == list(range(5, TICKS + 1, 5))
    assert [len(data.table(0).columns["tick_pose"].row(k)) for k in range(3)] == [5, 5, 5]
    assert data.episodes[0].ticks == TICKS == len(LogReader(recorded / "logs/ep_000000.lavlog"))


def test_a_shard_is_a_plain_tar_file(recorded: Path) -> None:
    data = Dataset(recorded)
    with tarfile.open(recorded / "blobs/ep_000000.tar") as tar:
        names = tar.getnames()
        assert names[:2] == ["000000.rgb_0.jpg", "000000.sem_0.zst"]
        assert len(names) == len(data.info.blobs) * data.episodes[0].frames
        for item in data.info.blobs:
            member = tar.extractfile(f"000007.{item.member}")
            assert member is not None
            assert member.read() == data.encoded(0, 7, item.name)


def test_fields_are_as_the_schema_says(recorded: Path) -> None:
    data = Dataset(recorded)
    frame = data.read(1, 11)
    assert list(frame) == [item.name for item in data.info.fields]
    sizes: dict[str, int] = {}
    for item in data.info.fields:
        value = np.asarray(frame[item.name])
        assert value.dtype == (object if item.dtype == "string" and item.shape else np.asarray(value).dtype)
        if item.dtype != "string":
            assert value.dtype == np.dtype(item.dtype), item.name
        assert value.ndim == len(item.shape), item.name
        for size, wanted in zip(value.shape, item.shape, strict=True):
            assert size == (sizes.setdefault(wanted, size) if isinstance(wanted, str) else wanted), item.name


def test_an_interrupted_drive_leaves_nothing(tmp_path: Path) -> None:
    simulation = Simulation(straight_drive())
    writer = EpisodeWriter(tmp_path, 0, DatasetInfo.of(RecordConfig(SUITE)))
    writer.start(simulation)
    for _ in range(7):
        writer.observe(simulation.tick(Control(throttle=0.5)))
    assert len(files_below(tmp_path)) == 2
    writer.finish(EpisodeResult(7, "interrupted"))
    assert files_below(tmp_path) == {}
    assert writer.record is None


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation(straight_drive())
    writer = EpisodeWriter(tmp_path, 3, DatasetInfo.of(RecordConfig(SUITE)))
    writer.start(simulation)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("lavsim.dataset.shard.PartialFile.write", full)
    for _ in range(3):
        writer.observe(simulation.tick(Control()))
    with pytest.raises(OSError, match="No space left on device"):
        writer.observe(simulation.tick(Control()))
    assert files_below(tmp_path) == {}


def test_logs_alone_hold_the_drive(recorded: Path, tmp_path: Path) -> None:
    make_dataset(tmp_path, episodes=1, blobs=False, tables=False)
    names = {"meta/info.json", "logs/ep_000000.lavlog", "episodes/ep_000000.json"}
    assert set(files_below(tmp_path)) == names
    assert files_below(tmp_path)["logs/ep_000000.lavlog"] == files_below(recorded)["logs/ep_000000.lavlog"]
    assert Dataset(tmp_path).episodes[0].frames == Dataset(recorded).episodes[0].frames


def test_nothing_written_depends_on_clock_or_place(recorded: Path) -> None:
    for path in recorded.rglob("*.json"):
        text = path.read_text()
        assert str(recorded) not in text
        assert "/" not in json.dumps(json.loads(text).get("record", {}))
