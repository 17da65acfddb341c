"""Writes datasets in LeRobot's format v3.0: tables in Parquet, cameras in MP4, both holding many episodes a file.

    meta/info.json                             features, paths, rate, totals, splits
    meta/stats.json                            statistics of each feature over everything
    meta/tasks.parquet                         a row a task, its text as the index
    meta/episodes/chunk-000/file-000.parquet   a row an episode: where its rows and pictures lie, its statistics
    data/chunk-000/file-000.parquet            a row a frame, a row group an episode
    videos/KEY/chunk-000/file-000.mp4          one camera, episodes one after another

This module knows the format and nothing of ours; `lavsim.dataset.export_lerobot` fills it. PyAV (the extra `video`)
encodes.

Source: LeRobot 0.4.4 (`lerobot.datasets`), whose reader opens what this writes.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.lerobot_video import CHUNK_FILES, PATH, QUANTILES, VIDEO_MB, Levels, Place, Video, quantile_name

VERSION = "v3.0"
_DATA_MB = 100
_SAMPLED = 25  # every so many pictures enter the statistics of a camera

# Columns that every dataset has, in order, with their NumPy type.
_OWN = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
        "task_index": "int64"}  # fmt: skip


@dataclass(frozen=True)
class Feature:
    """A column of numbers.

    Attributes:
        dtype: NumPy's name of the type.
        names: Of the entries of a row; one name makes the column a plain number.
    """

    dtype: str
    names: tuple[str, ...]

    @property
    def info(self) -> dict[str, Any]:
        return {"dtype": self.dtype, "shape": [len(self.names)], "names": list(self.names)}


class LeRobotWriter:
    """A dataset being written.

    Args:
        folder: Of the dataset, new or empty.
        rate: Frames a second.
        features: Columns by name ("observation.state", "action" …).
        cameras: Height, width [px] of each video by key ("observation.images.front").
        robot: What drives.
        data_mb, video_mb: Size at which a file is followed by the next [MiB].

    Raises:
        OutputError: PyAV is missing.
    """

    def __init__(
        self,
        folder: Path,
        rate: int,
        features: Mapping[str, Feature],
        cameras: Mapping[str, tuple[int, int]],
        robot: str,
        data_mb: float = _DATA_MB,
        video_mb: float = VIDEO_MB,
    ) -> None:
        self._folder, self._rate, self._robot = folder, rate, robot
        self._features, self._limit = dict(features), (data_mb, video_mb)
        folder.mkdir(parents=True, exist_ok=True)
        self._videos = {
            key: Video(folder / "videos" / key, rate, height, width, video_mb)
            for key, (height, width) in cameras.items()
        }
        self._place = Place()
        self._parquet: Any = None
        self._tasks: dict[str, int] = {}
        self._rows: list[dict[str, Any]] = []  # of meta/episodes
        self._columns: dict[str, list[NDArray[Any]]] = {}
        self._frames = 0

    def add_episode(
        self,
        columns: Mapping[str, NDArray[Any]],
        tasks: Sequence[str],
        pictures: Iterable[Mapping[str, NDArray[np.uint8]]] = (),
    ) -> None:
        """Appends an episode of N frames that follow each other at the dataset's rate.

        Args:
            columns: (N, D) or (N,) of each feature.
            tasks: What is being done in each frame, N texts.
            pictures: Of each frame, (H, W, 3) uint8 red, green, blue by camera.
        """
        count, number = len(tasks), len(self._rows)
        table = {name: np.asarray(columns[name], info.dtype).reshape(count, -1) for name, info in
                 self._features.items()}  # fmt: skip
        at = np.arange(count)
        for text in tasks:
            self._tasks.setdefault(text, len(self._tasks))
        own = {
            "timestamp": at / self._rate, "frame_index": at, "episode_index": np.full(count, number),
            "index": self._frames + at, "task_index": np.array([self._tasks[text] for text in tasks]),
        }  # fmt: skip
        table |= {name: np.asarray(own[name], dtype).reshape(count, 1) for name, dtype in _OWN.items()}
        begins = {key: video.begin(count) for key, video in self._videos.items()}
        seen = {key: Levels() for key in self._videos}
        for k, frame in enumerate(pictures):
            for key, video in self._videos.items():
                video.add(frame[key])
                if k % _SAMPLED == 0:
                    seen[key].add(frame[key])
        self._write_rows(table)
        row: dict[str, Any] = {
            "episode_index": number, "tasks": list(dict.fromkeys(tasks)), "length": count,
            "data/chunk_index": self._place.chunk, "data/file_index": self._place.file,
            "dataset_from_index": self._frames, "dataset_to_index": self._frames + count,
        }  # fmt: skip
        for key, (chunk, file, begin) in begins.items():
            row[f"videos/{key}/chunk_index"], row[f"videos/{key}/file_index"] = chunk, file
            row[f"videos/{key}/from_timestamp"] = begin / self._rate
            row[f"videos/{key}/to_timestamp"] = (begin + count) / self._rate
        for name, values in table.items():
            row |= {f"stats/{name}/{what}": value for what, value in _statistics(values).items()}
            self._columns.setdefault(name, []).append(values)
        for key, levels in seen.items():
            row |= {f"stats/{key}/{what}": value for what, value in levels.statistics().items()}
            self._videos[key].levels.join(levels)
        self._rows.append(row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        self._frames += count

    def __enter__(self) -> LeRobotWriter:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.close()
            return
        # What could not be written whole is of no use, and the disk that refused it may refuse its last bytes too.
        for file in (self._parquet, *self._videos.values()):
            if file is not None:
                with contextlib.suppress(Exception):
                    file.close()

    def close(self) -> None:
        """Completes all files."""
        if self._parquet is not None:
            self._parquet.close()
        for video in self._videos.values():
            video.close()
        self._write_meta()

    def _write_rows(self, table: Mapping[str, NDArray[Any]]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        arrays = [_arrow(values) for values in table.values()]
        rows = pa.Table.from_arrays(arrays, names=list(table))
        path = self._place.path(self._folder / "data", ".parquet")
        if self._parquet is not None and path.stat().st_size > self._limit[0] * 2**20:
            self._parquet.close()
            self._parquet = None
            self._place.next()
            path = self._place.path(self._folder / "data", ".parquet")
        if self._parquet is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._parquet = pq.ParquetWriter(path, rows.schema, compression="snappy")
        self._parquet.write_table(rows)

    def _write_meta(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        meta = self._folder / "meta"
        path = Place().path(meta / "episodes", ".parquet")
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.Table.from_pylist(self._rows), path, compression="snappy")
        pq.write_table(_tasks_table(list(self._tasks)), meta / "tasks.parquet", compression="snappy")
        stats = {name: _statistics(np.concatenate(parts)) for name, parts in self._columns.items()}
        stats |= {key: video.levels.statistics() for key, video in self._videos.items()}
        _write_json(meta / "stats.json", stats)
        _write_json(meta / "info.json", self._info())

    def _info(self) -> dict[str, Any]:
        features: dict[str, Any] = {key: video.info for key, video in self._videos.items()}
        features |= {name: feature.info for name, feature in self._features.items()}
        features |= {name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in _OWN.items()}
        return {
            "codebase_version": VERSION,
            "robot_type": self._robot,
            "total_episodes": len(self._rows),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": _DATA_MB,
            "video_files_size_in_mb": VIDEO_MB,
            "fps": self._rate,
            "splits": {"train": f"0:{len(self._rows)}"},
            "data_path": f"data/{PATH}.parquet",
            "video_path": f"videos/{{video_key}}/{PATH}.mp4" if self._videos else None,
            "features": features,
        }


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    """Of the rows (N, D), each a list of D numbers; "count" of rows."""
    exact = values.astype(np.float64)
    found: dict[str, Any] = {
        "min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist(),
        "mean": exact.mean(axis=0).tolist(), "std": exact.std(axis=0).tolist(), "count": [len(values)],
    }  # fmt: skip
    for q, row in zip(QUANTILES, np.quantile(exact, QUANTILES, axis=0), strict=True):
        found[quantile_name(q)] = row.tolist()
    return found


def _arrow(values: NDArray[Any]) -> Any:
    """A column: plain numbers for (N, 1), lists of D for (N, D)."""
    import pyarrow as pa

    flat = pa.array(values.ravel())
    return flat if values.shape[1] == 1 else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _tasks_table(tasks: Sequence[str]) -> Any:
    """LeRobot reads it with pandas and looks for the texts in the index, which pandas' own metadata names."""
    import pyarrow as pa

    plain = {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [plain | {"metadata": {"encoding": "UTF-8"}}],
        "columns": [
            plain | {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
            plain | {"name": "task", "field_name": "task"},
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n")
