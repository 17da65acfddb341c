"""Exports a dataset in LeRobot's format: cameras as films, the ego's state, the driver's action, commands as tasks.

LeRobot takes frames at a steady rate, so an episode here is a stretch without a jump in time; it has no place for
LiDAR, BEV, tags and other actors, which stay behind.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.card import LICENCE
from lavsim.dataset.files import write_file
from lavsim.dataset.lerobot import Feature, LeRobotWriter
from lavsim.dataset.merge import Watch, new_folder
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import TICKS_PER_FRAME, FieldSpec
from lavsim.dataset.tables import Table
from lavsim.errors import DatasetError
from lavsim.types import DT, RoadOption

RATE = round(1.0 / (TICKS_PER_FRAME * DT))
TASKS: dict[int, str] = {
    RoadOption.LEFT: "turn left at the junction",
    RoadOption.RIGHT: "turn right at the junction",
    RoadOption.STRAIGHT: "go straight on at the junction",
    RoadOption.LANEFOLLOW: "follow the road",
    RoadOption.CHANGELANELEFT: "change to the lane on the left",
    RoadOption.CHANGELANERIGHT: "change to the lane on the right",
}

FEATURES: dict[str, Feature] = {
    "observation.state": Feature("float32", ("x", "y", "yaw", "speed", "acceleration", "yaw_rate")),
    "observation.goal": Feature("float32", ("ahead", "right", "next_ahead", "next_right")),
    "observation.command": Feature("int64", ("command",)),
    "observation.brake": Feature("int64", ("brake",)),
    "action": Feature("float32", ("throttle", "steer", "brake")),
    "next.done": Feature("bool", ("done",)),
}


def export_lerobot(source: Path, out: Path, watch: Watch | None = None) -> dict[str, Any]:
    """Writes a dataset in LeRobot's format v3.0.

    Args:
        source: The dataset; without blobs its cameras are rendered from its logs.
        out: Folder to make.
        watch: Is told the share that is done.

    Returns:
        Numbers of what was written: episodes, frames, cameras.

    Raises:
        DatasetError: the dataset has no tables, lacks a column, or is damaged.
        OutputError: PyAV is missing, or `out` exists or can't be written.
    """
    dataset = Dataset(source)
    _check(dataset)
    cameras = [field for field in dataset.info.blobs if field.codec.startswith("jpeg")]
    sizes = {_key(field): (int(field.shape[0]), int(field.shape[1])) for field in cameras}
    done = episodes = 0
    with new_folder(out) as root:
        with LeRobotWriter(root, RATE, FEATURES, sizes, "car") as writer:
            for record in dataset.episodes.values():
                for piece in pieces(record):
                    frames = _frames(dataset, record.episode, piece, cameras, len(dataset), done, watch)
                    columns, tasks = _columns(dataset.table(record.episode), piece)
                    writer.add_episode(columns, tasks, frames)
                    done, episodes = done + len(piece), episodes + 1
        write_file(root / "README.md", _card(episodes, done, list(sizes)).encode())
    return {"episodes": episodes, "frames": done, "cameras": list(sizes)}


def pieces(record: EpisodeRecord) -> list[range]:
    """Frames of an episode in stretches without a jump in time."""
    bounds = [0, *record.breaks, record.frames]
    return [range(begin, end) for begin, end in pairwise(bounds) if end > begin]


def _check(dataset: Dataset) -> None:
    """Refuses a dataset that lacks what the format's features are made of."""
    if not dataset.info.columns:
        raise DatasetError(f"{dataset.root} holds logs alone; make its tables with: lavsim render.")
    known = {field.name for field in dataset.info.columns}
    needed = ("position", "yaw", "speed", "acceleration", "rotation_rate", "goal", "next_goal", "control", "wish")
    missing = [name for name in needed if name not in known]
    if missing:
        raise DatasetError(f"{dataset.root} has no column {missing[0]!r}, which LeRobot's features are made of.")


def _columns(table: Table, piece: range) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Features and task of each frame."""
    part = slice(piece.start, piece.stop)
    wish, applied = table["wish"][part, :3], table["control"][part, :3]
    count = len(piece)
    columns = {
        "observation.state": np.column_stack([
            table["position"][part, :2], table["yaw"][part], table["speed"][part], table["acceleration"][part, 0],
            table["rotation_rate"][part, 2],
        ]),
        "observation.goal": np.column_stack([table["goal"][part], table["next_goal"][part]]),
        "observation.command": table["command"][part],
        "observation.brake": table["brake"][part],
        "action": np.where(np.isfinite(wish), wish, applied),
        "next.done": np.arange(count) == count - 1,
    }  # fmt: skip
    follow = TASKS[RoadOption.LANEFOLLOW]
    return columns, [TASKS.get(int(command), follow) for command in table["command"][part]]


def _frames(
    dataset: Dataset, episode: int, piece: range, cameras: list[FieldSpec], total: int, done: int, watch: Watch | None
) -> Iterator[dict[str, NDArray[np.uint8]]]:
    names = [field.name for field in cameras]
    for k, frame in enumerate(piece):
        row = dataset.read(episode, frame, names)
        yield {_key(field): row[field.name] for field in cameras}
        if watch is not None:
            watch((done + k + 1) / total)


def _key(field: FieldSpec) -> str:
    return f"observation.images.{field.name}"


def _card(episodes: int, frames: int, cameras: list[str]) -> str:
    return (
        f"---\nlicense: {LICENCE}\ntask_categories:\n- robotics\ntags:\n- LeRobot\n- lavsim\n- autonomous-driving\n"
        "configs:\n- config_name: default\n  data_files: data/*/*.parquet\n---\n\n"
        f"# Driving demonstrations of lavsim\n\n{frames} frames in {episodes} episodes at {RATE} a second, in "
        f"LeRobot's format v3.0, with {len(cameras)} cameras: {', '.join(cameras) or 'none'}.\n\n"
        "`observation.state`: x east, y south [m], yaw clockwise [rad], speed [m/s], acceleration ahead [m/s²], yaw "
        "rate [rad/s]. `observation.goal`: the next two nodes of the plan ahead and to the right of the ego [m]. "
        "`observation.command`: 1 left, 2 right, 3 straight, 4 follow, 5 and 6 change to the left and right lane; also "
        "the task, in words. `observation.brake`: 1 where the expert stops for a light, a sign or a hazard. `action`: "
        "throttle and brake 0 to 1, steer -1 to 1, positive to the right, as the expert asked for.\n"
    )
