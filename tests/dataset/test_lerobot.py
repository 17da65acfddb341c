"""LeRobot's format, read back by its documented paths and columns alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.dataset.lerobot import Feature, LeRobotWriter

pytest.importorskip("av")
CAMERA = "observation.images.front"
FEATURES = {
    "observation.state": Feature("float32", ("x", "y", "speed")),
    "action": Feature("float32", ("throttle", "steer")),
    "command": Feature("int64", ("command",)),
}


class Reader:
    """What LeRobot's own reader does, in a few lines: paths from info.json, places from the episodes' table."""

    def __init__(self, folder: Path) -> None:
        import pyarrow.parquet as pq

        self.folder = folder
        self.info = json.loads((folder / "meta/info.json").read_text())
        self.stats = json.loads((folder / "meta/stats.json").read_text())
        self.episodes: list[dict[str, Any]] = []
        for path in sorted((folder / "meta/episodes").glob("*/*.parquet")):
            self.episodes += pq.read_table(path).to_pylist()
        self.tasks = {
            row["task_index"]: row["task"] for row in pq.read_table(folder / "meta/tasks.parquet").to_pylist()
        }
        self.rows: list[dict[str, Any]] = []
        for path in sorted((folder / "data").glob("*/*.parquet")):
            self.rows += pq.read_table(path).to_pylist()

    def picture(self, index: int, camera: str) -> np.ndarray:
        """The picture whose time stamp in the film is that of the row."""
        import av

        row = self.rows[index]
        episode = self.episodes[row["episode_index"]]
        at = episode[f"videos/{camera}/from_timestamp"] + row["timestamp"]
        path = self.info["video_path"].format(
            video_key=camera,
            chunk_index=episode[f"videos/{camera}/chunk_index"],
            file_index=episode[f"videos/{camera}/file_index"],
        )
        with av.open(str(self.folder / path)) as film:
            for frame in film.decode(video=0):
                if abs(frame.time - at) < 1e-4:  # LeRobot's tolerance
                    return frame.to_ndarray(format="rgb24")
        raise AssertionError(f"no picture at {at}")


def write(folder: Path, lengths: tuple[int, ...] = (4, 3, 5), **limits: float) -> list[dict[str, Any]]:
    """Episodes with a colour of their own in every picture; their rows."""
    writer = LeRobotWriter(folder, 4, FEATURES, {CAMERA: (32, 48)}, "car", **limits)
    draw, rows = np.random.default_rng(1), []
    for length in lengths:
        columns = {
            "observation.state": draw.random((length, 3)).astype(np.float32),
            "action": draw.random((length, 2)).astype(np.float32),
            "command": draw.integers(1, 7, length),
        }
        colours = draw.integers(0, 255, (length, 3), np.uint8)
        pictures = [{CAMERA: np.tile(colour, (32, 48, 1)).astype(np.uint8)} for colour in colours]
        tasks = ["turn left" if k % 2 else "follow the lane" for k in range(length)]
        writer.add_episode(columns, tasks, pictures)
        for k in range(length):
            rows.append(
                {name: values[k] for name, values in columns.items()} | {"colour": colours[k], "task": tasks[k]}
            )
    writer.close()
    return rows


def test_rows_and_pictures_read_back(tmp_path: Path) -> None:
    written = write(tmp_path / "d")
    read = Reader(tmp_path / "d")
    assert len(read.rows) == read.info["total_frames"] == len(written) == 12
    assert [e["length"] for e in read.episodes] == [4, 3, 5]
    assert read.info["splits"] == {"train": "0:3"}
    for k, (row, want) in enumerate(zip(read.rows, written, strict=True)):
        np.testing.assert_array_equal(np.array(row["observation.state"], np.float32), want["observation.state"])
        np.testing.assert_array_equal(np.array(row["action"], np.float32), want["action"])
        assert (row["command"], row["index"]) == (want["command"], k)
        assert read.tasks[row["task_index"]] == want["task"]
        assert row["timestamp"] == row["frame_index"] / 4
        shown = read.picture(k, CAMERA).reshape(-1, 3).astype(int).mean(axis=0)
        assert np.abs(shown - want["colour"]).max() < 6.0  # colours lose a little in a film


def test_files_follow_each_other_when_they_are_full(tmp_path: Path) -> None:
    written = write(tmp_path / "d", data_mb=0.0, video_mb=0.0)
    read = Reader(tmp_path / "d")
    assert [e["data/file_index"] for e in read.episodes] == [0, 1, 2]
    assert [e[f"videos/{CAMERA}/file_index"] for e in read.episodes] == [0, 1, 2]
    assert [e[f"videos/{CAMERA}/from_timestamp"] for e in read.episodes] == [0.0, 0.0, 0.0]
    shown = read.picture(11, CAMERA).reshape(-1, 3).astype(int).mean(axis=0)
    assert np.abs(shown - written[11]["colour"]).max() < 6.0


def test_statistics_are_those_of_the_rows(tmp_path: Path) -> None:
    written = write(tmp_path / "d")
    read = Reader(tmp_path / "d")
    states = np.array([row["observation.state"] for row in written], np.float64)
    stats = read.stats["observation.state"]
    np.testing.assert_allclose(stats["mean"], states.mean(axis=0))
    np.testing.assert_allclose(stats["std"], states.std(axis=0))
    np.testing.assert_allclose(stats["q50"], np.median(states, axis=0))
    assert stats["count"] == [12]
    np.testing.assert_allclose(read.episodes[1]["stats/observation.state/max"], states[4:7].max(axis=0))
    first = written[0]["colour"] / 255.0
    np.testing.assert_allclose(np.ravel(read.episodes[0][f"stats/{CAMERA}/mean"]), first)
    assert np.shape(read.stats[CAMERA]["q99"]) == (3, 1, 1)


def test_the_same_episodes_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write(tmp_path / name)
    files = [p.relative_to(tmp_path / "a") for p in sorted((tmp_path / "a").rglob("*")) if p.is_file()]
    assert len(files) == 6
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file
