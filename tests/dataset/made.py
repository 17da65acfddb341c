"""Small datasets made by hand: tables of plain numbers, images that tell which they are, no drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.dataset.codecs import find_codec
from lavsim.dataset.files import FileFacts, write_file
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import DatasetInfo, FieldSpec, RecordConfig, file_of
from lavsim.dataset.shard import ShardWriter
from lavsim.dataset.tables import Table, write_table
from lavsim.types import ActorClass, Role


def _camera(name: str, kind: str, yaw: float) -> dict[str, Any]:
    return {"type": f"sensor.camera.{kind}", "id": name, "x": 1.5, "y": 0.0, "z": 2.4, "roll": 0.0, "pitch": 0.0,
            "yaw": yaw, "width": 64, "height": 48, "fov": 64}  # fmt: skip


SUITE: tuple[dict[str, Any], ...] = (
    _camera("RGB_0", "rgb", 0.0),
    _camera("SEM_0", "semantic_segmentation", 0.0),
    {"type": "sensor.lidar.ray_cast", "id": "LIDAR", "x": 0.0, "y": 0.0, "z": 2.4, "roll": 0.0, "pitch": 0.0,
     "yaw": 0.0},
    {"type": "sensor.lavsim.bev", "id": "BEV"},
)  # fmt: skip


def info_of(suite: Sequence[Mapping[str, Any]] = SUITE, seed: int = 0, blobs: bool = True) -> DatasetInfo:
    """The description of a dataset with this suite."""
    return DatasetInfo.of(RecordConfig(tuple(suite), blobs=blobs), seed, {"made": "by hand"})


def row_of(info: DatasetInfo, tick: int, actors: Sequence[Mapping[str, Any]] = (), **values: Any) -> dict[str, Any]:
    """A frame: zeros but for `values`, the ego, and actors of `actor` below it."""
    everyone = [actor(1, role=Role.EGO, at=values.get("position", (0.0, 0.0, 0.0))), *actors]
    row: dict[str, Any] = {}
    for field in info.columns:
        if field.name.startswith("actor_"):
            row[field.name] = [one.get(field.name, blank(field, ())) for one in everyone]
        else:
            row[field.name] = blank(field, (1,) if field.shape[:1] == ("ticks",) else (0,))
    return row | {"tick": tick, "brake_cause": "none", "command": 4} | values


def actor(
    number: int,
    kind: ActorClass = ActorClass.CAR,
    role: Role = Role.TRAFFIC,
    at: Sequence[float] = (0.0, 0.0, 0.0),
    size: Sequence[float] = (4.5, 1.9, 1.5),
    **values: Any,
) -> dict[str, Any]:
    """One actor's part of a row."""
    return {
        "actor_id": number, "actor_class": int(kind), "actor_role": int(role), "actor_position": at,
        "actor_size": size, "actor_blueprint": "vehicle.seat.leon",
    } | {f"actor_{name}": value for name, value in values.items()}  # fmt: skip


def blank(field: FieldSpec, ragged: tuple[int, ...]) -> Any:
    """Zeros of a field; `ragged` is its first size where that varies in the frame itself."""
    shape = (*(ragged if field.is_ragged else ()), *field.inner_shape)
    if field.dtype == "string":
        return [] if field.is_ragged and ragged else ""
    return np.zeros(shape, field.dtype)


def blobs_of(info: DatasetInfo, number: int) -> list[bytes]:
    """Blobs of a frame, different in each."""
    draw, found = np.random.default_rng(number), []
    for field in info.blobs:
        shape = tuple(20 if isinstance(size, str) else size for size in field.shape)
        if field.codec == "lidar_cm":
            array = np.round(draw.uniform(-40.0, 40.0, shape), 2).astype(np.float32)
            array[:, 3] = np.round(np.abs(array[:, 3]) * 6.0) / 255.0
        elif field.codec == "jpeg90":
            array = np.full(shape, number * 40 % 255, np.uint8)
        elif field.codec == "packbits_zstd":
            array = np.where(draw.random(shape) > 0.5, 255, 0).astype(np.uint8)
        else:
            array = draw.integers(0, 23, shape, np.uint8)
        found.append(find_codec(field.codec).encode(array))
    return found


def write_episode(
    root: Path, info: DatasetInfo, episode: int, rows: Sequence[Mapping[str, Any]], **values: Any
) -> EpisodeRecord:
    """An episode of hand-made rows; its log is a stand-in."""
    files: dict[str, FileFacts] = {}
    town, seed = values.get("town", "eu_small_a"), values.get("seed", episode)
    files[file_of("log", episode)] = write_file(root / file_of("log", episode), b"log %d %d" % (episode, seed))
    path = root / file_of("table", episode)
    table = Table.of_rows(rows, info.columns)
    files[file_of("table", episode)] = write_table(path, table, info.columns, {"town": town})
    if info.record.blobs:
        shard, index = root / file_of("shard", episode), root / file_of("index", episode)
        writer = ShardWriter(shard, index, [field.member for field in info.blobs])
        for number in range(len(rows)):
            writer.add(blobs_of(info, 1000 * seed + number))
        files[file_of("shard", episode)], files[file_of("index", episode)] = writer.finish()
    record = EpisodeRecord(
        episode, town, str(episode), seed, len(rows), 5 * len(rows), 2.0 * len(rows), "route completed", 0, files,
        {"weather": "lav"}, values.get("breaks", ()),
    )  # fmt: skip
    record.write(root)
    return record


def write_dataset(root: Path, lengths: Sequence[int] = (4, 3), first_seed: int = 0, **values: Any) -> DatasetInfo:
    """A dataset with episodes of these many frames; towns take turns."""
    info = info_of(**values)
    info.write(root)
    for episode, length in enumerate(lengths):
        rows = [
            row_of(
                info, 5 * k, [actor(7, at=(10.0 + k, 2.0, 0.0), yaw=0.3)], speed=2.0 + k, position=(2.0 * k, 0.0, 0.0)
            )
            for k in range(length)
        ]
        town = ("eu_small_a", "us_large_a")[episode % 2]
        write_episode(root, info, episode, rows, town=town, seed=first_seed + episode)
    return info
