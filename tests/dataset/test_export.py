"""Datasets in the formats of others."""

from __future__ import annotations

import io
import json
import shutil
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from lavsim.dataset.export_lerobot import TASKS, export_lerobot, pieces
from lavsim.dataset.export_webdataset import export_webdataset
from lavsim.dataset.reader import Dataset
from lavsim.dataset.webdataset import SampleWriter, read_samples
from lavsim.errors import DatasetError, OutputError, UnknownName
from tests.dataset.made import info_of, row_of, write_dataset, write_episode
from tests.dataset.test_lerobot import Reader


def test_samples_hold_what_the_dataset_does(tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", (3, 2))
    about = export_webdataset(tmp_path / "d", tmp_path / "w")
    assert (about["shards"], about["samples"]) == ("shard-{000000..000000}.tar", 5)
    assert json.loads((tmp_path / "w" / "dataset.json").read_text()) == about
    card = (tmp_path / "w" / "README.md").read_text()
    assert card.startswith("---\nlicense: mit\n")
    assert "* `bev.npz`: uint8 5 x 320 x 320" in card
    dataset = Dataset(tmp_path / "d")
    found = list(read_samples(tmp_path / "w"))
    assert [key for key, _ in found] == [f"{e:06d}_{f:06d}" for e, n in ((0, 3), (1, 2)) for f in range(n)]
    for key, files in found:
        assert set(files) == {"json", "rgb_0.jpg", "sem_0.png", "lidar.npy", "bev.npz"}
        episode, frame = map(int, key.split("_"))
        want, row = dataset.read(episode, frame), json.loads(files["json"])
        np.testing.assert_array_equal(np.load(io.BytesIO(files["lidar.npy"])), want["lidar"])
        np.testing.assert_array_equal(np.load(io.BytesIO(files["bev.npz"]))["data"], want["bev"])
        tags = cv2.imdecode(np.frombuffer(files["sem_0.png"], np.uint8), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(tags, want["sem_0"])
        assert files["rgb_0.jpg"] == dataset.encoded(episode, frame, "rgb_0")
        assert row["speed"] == want["speed"]
        assert row["actor_id"] == want["actor_id"].tolist()
        assert row["actor_blueprint"] == list(want["actor_blueprint"])


def test_what_is_not_known_is_null(tmp_path: Path) -> None:
    info = info_of()
    info.write(tmp_path / "d")
    wish = np.array([0.5, np.nan, 0.0, 0.0, 0.0], np.float32)
    write_episode(tmp_path / "d", info, 0, [row_of(info, 0, target_speed=np.nan, wish=wish)])
    export_webdataset(tmp_path / "d", tmp_path / "w")
    row = json.loads(next(iter(read_samples(tmp_path / "w")))[1]["json"])
    assert row["target_speed"] is None
    assert row["wish"] == [0.5, None, 0.0, 0.0, 0.0]


def test_fields_may_be_chosen(tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", (1,))
    export_webdataset(tmp_path / "d", tmp_path / "w", ["bev"])
    assert set(next(iter(read_samples(tmp_path / "w")))[1]) == {"json", "bev.npz"}
    with pytest.raises(UnknownName, match="Did you mean 'lidar'"):
        export_webdataset(tmp_path / "d", tmp_path / "x", ["lida"])
    with pytest.raises(OutputError, match="exists already"):
        export_webdataset(tmp_path / "d", tmp_path / "w")


def test_shards_follow_each_other_and_are_plain_tar(tmp_path: Path) -> None:
    writer = SampleWriter(tmp_path, samples=2)
    for k in range(5):
        writer.add(f"s{k}", {"cls": b"%d" % k, "x.bin": bytes(700)})
    writer.close()
    assert writer.shards == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"shard-00000{k}.tar" for k in range(3)]
    with tarfile.open(tmp_path / "shard-000001.tar") as tar:
        assert tar.getnames() == ["s2.cls", "s2.x.bin", "s3.cls", "s3.x.bin"]
        assert {(m.mtime, m.uid, m.uname) for m in tar.getmembers()} == {(0, 0, "")}
    assert [key for key, _ in read_samples(tmp_path)] == [f"s{k}" for k in range(5)]
    with pytest.raises(ValueError, match="no dot"):
        writer.add("a.b", {})


def test_a_shard_cut_short_is_refused(tmp_path: Path) -> None:
    writer = SampleWriter(tmp_path)
    writer.add("a", {"bin": bytes(5000)})
    writer.close()
    path = tmp_path / "shard-000000.tar"
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(DatasetError, match=r"shard-000000\.tar"):
        list(read_samples(tmp_path))


def test_lerobot_holds_stretches_without_a_jump(tmp_path: Path) -> None:
    pytest.importorskip("av")
    info = info_of()
    info.write(tmp_path / "d")
    ticks = [0, 5, 10, 700, 705]
    wish = [np.full(5, np.nan if k == 1 else 0.1 * k, np.float32) for k in range(5)]
    rows = [
        row_of(info, tick, command=1 + k % 2, speed=1.0 + k, wish=wish[k], control=np.full(5, 0.9, np.float32))
        for k, tick in enumerate(ticks)
    ]
    record = write_episode(tmp_path / "d", info, 0, rows, breaks=(3,))
    assert pieces(record) == [range(3), range(3, 5)]
    numbers = export_lerobot(tmp_path / "d", tmp_path / "l")
    assert numbers == {"episodes": 2, "frames": 5, "cameras": ["observation.images.rgb_0"]}
    read = Reader(tmp_path / "l")
    assert (read.info["fps"], read.info["robot_type"], [e["length"] for e in read.episodes]) == (4, "car", [3, 2])
    assert [row["timestamp"] for row in read.rows] == [0.0, 0.25, 0.5, 0.0, 0.25]
    assert [row["next.done"] for row in read.rows] == [False, False, True, False, True]
    assert [row["observation.state"][3] for row in read.rows] == [1.0, 2.0, 3.0, 4.0, 5.0]
    np.testing.assert_allclose([row["action"][0] for row in read.rows], [0.0, 0.9, 0.2, 0.3, 0.4], atol=1e-6)
    assert [read.tasks[row["task_index"]] for row in read.rows] == [TASKS[1 + k % 2] for k in range(5)]
    for number in range(5):
        shown, want = read.picture(number, "observation.images.rgb_0"), Dataset(tmp_path / "d").read(0, number)["rgb_0"]
        assert np.abs(shown.astype(int) - want).mean() < 4.0


def test_datasets_of_logs_alone_are_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    info = info_of()
    replace(info, fields=info.blobs, record=replace(info.record, tables=False)).write(tmp_path / "d")
    for export in (export_webdataset, export_lerobot):
        with pytest.raises(DatasetError, match="holds logs alone"):
            export(tmp_path / "d", tmp_path / "x")
    assert [path.name for path in tmp_path.iterdir()] == ["d"]


def test_logs_with_tables_export_the_very_files_that_blobs_would(tmp_path: Path, recorded: Path) -> None:
    """Without blobs sensors are rendered from the logs, and come out as the same bytes."""
    from dataclasses import replace

    from lavsim.dataset.schema import DatasetInfo

    bare = tmp_path / "bare"
    for name in ("logs", "tables", "episodes"):
        shutil.copytree(recorded / name, bare / name)
    info = DatasetInfo.read(recorded)
    replace(info, record=replace(info.record, blobs=False)).write(bare)
    chosen = ["rgb_2", "tel_sem", "bev"]
    for name, source in (("a", recorded), ("b", bare)):
        export_webdataset(source, tmp_path / name, chosen)
    assert (tmp_path / "a" / "shard-000000.tar").read_bytes() == (tmp_path / "b" / "shard-000000.tar").read_bytes()
