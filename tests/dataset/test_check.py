"""`check` is silent about a good dataset and names what is wrong with a bad one; the reader refuses the same files."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.behavior import BehaviorAgent
from lavsim.dataset.check import check
from lavsim.dataset.files import FileFacts, read_sealed, write_sealed
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import VERSION_KEY, DatasetInfo
from lavsim.dataset.tables import Column, read_table, write_table
from lavsim.errors import DatasetError, LavsimError
from lavsim.types import Control

LOG, TABLE, TAR, INDEX = (
    "logs/ep_000001.lavlog", "tables/ep_000001.parquet", "blobs/ep_000001.tar", "blobs/ep_000001.index",
)  # fmt: skip
RECORD, INFO = "episodes/ep_000001.json", "meta/info.json"


@pytest.fixture
def copy(recorded: Path, tmp_path: Path) -> Path:
    """A dataset to spoil."""
    return shutil.copytree(recorded, tmp_path / "copy")


def texts(root: Path) -> list[str]:
    return [str(finding) for finding in check(root)]


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(bytes(data))


def use(root: Path) -> None:
    """Reads everything of episode 1, as training would."""
    data = Dataset(root)
    for frame in range(data.episodes[1].frames):
        data.read(1, frame)


def test_a_good_dataset_has_no_findings(recorded: Path) -> None:
    told: list[tuple[int, int]] = []
    assert check(recorded, all_blobs=True, progress=lambda *at: told.append(at)) == []
    assert told == [(1, 2), (2, 2)]


@pytest.mark.parametrize("damage", [cut, flip])
@pytest.mark.parametrize("name", [TABLE, TAR, INDEX, RECORD, INFO])
def test_a_damaged_file_is_refused_by_its_name(copy: Path, name: str, damage: Callable[[Path], None]) -> None:
    damage(copy / name)
    with pytest.raises(LavsimError) as refusal:
        use(copy)
    message = str(refusal.value)
    assert Path(name).name in message
    assert "\n" not in message
    assert any(word in message for word in ("cut short", "damaged", "is no"))
    found = texts(copy)
    assert any(text.startswith(name) for text in found)
    assert len(found) < 5


@pytest.mark.parametrize("damage", [cut, flip])
def test_a_damaged_log_is_found(copy: Path, damage: Callable[[Path], None]) -> None:
    damage(copy / LOG)
    assert texts(copy)[0].startswith(f"{LOG}: ep_000001.lavlog is ")


@pytest.mark.parametrize("name", [RECORD, INFO])
def test_a_file_of_a_future_version_is_refused(copy: Path, name: str) -> None:
    content = json.loads((copy / name).read_text())
    content[VERSION_KEY] = 2
    (copy / name).write_text(json.dumps(content))
    wanted = rf"^{Path(name).name} has schema_version 2; this version of lavsim reads 1\.$"
    with pytest.raises(DatasetError, match=wanted):
        Dataset(copy)
    assert texts(copy)[0].startswith(name)


@pytest.mark.parametrize("name", [TABLE, TAR, INDEX])
def test_a_missing_file_is_refused(copy: Path, name: str) -> None:
    (copy / name).unlink()
    with pytest.raises(DatasetError, match=f"{Path(name).name} is missing"):
        use(copy)
    assert texts(copy) == [f"{name}: {Path(name).name} is missing."]


def test_a_folder_that_is_no_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"is no dataset: it has no meta/info\.json\.$"):
        Dataset(tmp_path)
    assert len(check(tmp_path)) == 1


def test_a_gap_is_found(copy: Path) -> None:
    (copy / "episodes/ep_000000.json").unlink()
    found = texts(copy)
    assert found[0] == "episodes are missing: 0."
    assert len(found) == 5  # and four files that no record names


def test_an_episode_that_is_there_twice_is_found(copy: Path) -> None:
    record = EpisodeRecord.read(copy / RECORD)
    for name in record.files:
        shutil.copy(copy / name, copy / name.replace("ep_000001", "ep_000002"))
    files = {name.replace("ep_000001", "ep_000002"): facts for name, facts in record.files.items()}
    EpisodeRecord(2, *[getattr(record, n) for n in ("town", "route_id", "seed", "frames", "ticks", "distance", "ending",
                  "agent_status")], files).write(copy)  # fmt: skip
    assert texts(copy) == ["logs/ep_000002.lavlog: it is the drive of episode 1 once more."]


def test_what_a_kill_leaves_is_found(copy: Path) -> None:
    (copy / "logs/ep_000002.lavlog.partial").write_bytes(b"x")
    (copy / "blobs/ep_000002.tar").write_bytes(b"x")
    found = texts(copy)
    assert [text.split(":")[0] for text in found] == ["blobs/ep_000002.tar", "logs/ep_000002.lavlog.partial"]


def test_a_table_that_differs_from_its_log_is_found(copy: Path) -> None:
    info = DatasetInfo.read(copy)
    table = read_table((copy / TABLE).read_bytes(), TABLE, info.columns)
    moved = table.columns["position"].values.copy()
    moved[4, 1] += 0.001
    table.columns["position"] = Column(moved)
    reseal(copy, TABLE, write_table(copy / TABLE, table, info.columns, {}))
    assert texts(copy) == [f"{TABLE}: frame 4, tick 25: position is not that of the log."]


def test_a_blob_of_another_shape_is_found(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lavsim.dataset.reader.decode", lambda *_: np.zeros(3, np.uint8))
    assert "000000.rgb_0.jpg: its shape is (3,), not (288, 256, 3)." in texts(copy)[0]


def test_records_of_crashed_drives_are_empty_episodes(copy: Path) -> None:
    EpisodeRecord(2, "t", "r", 0, 0, 0, 0.0, "crashed: ValueError", 0, {}).write(copy)
    assert check(copy) == []
    assert len(Dataset(copy)) == len(Dataset(copy).table(0)) + len(Dataset(copy).table(1))


def reseal(root: Path, name: str, facts: FileFacts) -> None:
    """Makes the record of episode 1 agree with a changed file."""
    content = read_sealed(root / RECORD, VERSION_KEY, 1)
    content["files"][name] = {"bytes": facts.bytes, "sha256": facts.sha256}
    write_sealed(root / RECORD, content)


def test_an_agent_that_drives_differently_by_now_is_found(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert check(recorded, agents=True) == []
    drive = BehaviorAgent.run_step

    def timid(agent: BehaviorAgent, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        control = drive(agent, input_data, timestamp)
        return replace(control, throttle=0.5 * control.throttle)

    monkeypatch.setattr(BehaviorAgent, "run_step", timid)
    found = [str(finding) for finding in check(recorded, agents=True)]
    assert len(found) == 2
    assert found[1].startswith(f"{LOG}: ep_000001.lavlog: at tick ")


def test_drives_recorded_elsewhere_have_no_log(copy: Path) -> None:
    content = read_sealed(copy / RECORD, VERSION_KEY, 1)
    del content["files"][LOG]
    (copy / LOG).unlink()
    write_sealed(copy / RECORD, content)
    assert check(copy) == []
    content["frames"] += 1
    write_sealed(copy / RECORD, content)
    assert f"{TABLE}: it has not 13 frames." in texts(copy)


def test_no_damage_goes_unnoticed_or_crashes_the_reader(copy: Path) -> None:
    """A flipped bit or a cut anywhere: what is read is what was written, or one line names the file."""
    names = ["lidar", "sem_2", "position", "actor_id"]
    wanted = Dataset(copy).read(1, 6, names)
    files = [copy / name for name in (TABLE, TAR, INDEX, RECORD, INFO)]
    rng = np.random.default_rng(0)
    for number in range(40):
        path = files[number % len(files)]
        data = path.read_bytes()
        spoilt = bytearray(data)
        if number % 3:
            spoilt[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        else:
            del spoilt[int(rng.integers(len(data))) :]
        path.write_bytes(bytes(spoilt))
        refusal = ""
        try:
            found = Dataset(copy).read(1, 6, names)
        except LavsimError as error:
            refusal = str(error)
        same = not refusal and all(np.array_equal(found[name], wanted[name]) for name in names)
        assert same or path.name in refusal
        path.write_bytes(data)
