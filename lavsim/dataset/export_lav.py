"""Exports a dataset as LAV's own lmdb trajectories, for the released training code.

A trajectory is a stretch of an episode without a jump in time. What LAV's recorder kept for itself alone (six
lane-direction layers) is written empty; props, which it did not know, are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.export_lerobot import pieces
from lavsim.dataset.lav_frames import command_to_lav, encode_image, goal_to_lav, layers_to_png, types_to_lav
from lavsim.dataset.lav_lmdb import CAMERAS, LavFrame, write_trajectory
from lavsim.dataset.merge import Watch, new_folder
from lavsim.dataset.reader import Dataset
from lavsim.dataset.tables import Table
from lavsim.errors import DatasetError
from lavsim.sensors.base import make_sensor
from lavsim.sensors.bev import Bev
from lavsim.types import ActorClass

_RGB, _SEM = tuple(f"rgb_{k}" for k in range(CAMERAS)), tuple(f"sem_{k}" for k in range(CAMERAS))
_READINGS = (*_RGB, *_SEM, "tel_rgb", "tel_sem", "lidar", "bev")
_COLUMNS = (
    "yaw", "brake", "command", "goal", "tick_gnss", "tick_imu", "tick_speed", "actor_id", "actor_class",
    "actor_position", "actor_yaw", "actor_velocity", "actor_size",
)  # fmt: skip


def export_lav(source: Path, out: Path, watch: Watch | None = None) -> dict[str, Any]:
    """Writes a dataset as a folder of LAV's trajectories, `ep_000000`, and `ep_000000_1` … after jumps in time.

    Args:
        source: The dataset, of the suite `lav_data`; without blobs they are rendered from its logs.
        out: Folder to make.
        watch: Is told the share that is done.

    Returns:
        Numbers of what was written: trajectories, frames, towns.

    Raises:
        DatasetError: the dataset lacks a reading or a column, or is damaged; or the package lmdb is missing.
        OutputError: `out` exists or can't be written.
    """
    dataset = Dataset(source)
    _check(dataset)
    done, trajectories, towns = 0, 0, dict[str, int]()
    with new_folder(out) as root:
        for record in dataset.episodes.values():
            for number, piece in enumerate(pieces(record)):
                name = f"ep_{record.episode:06d}" + (f"_{number}" if number else "")
                frames = _watched(_frames(dataset, record.episode, piece), done, len(dataset), watch)
                done += write_trajectory(root / name, record.town, frames)
                trajectories, towns[record.town] = trajectories + 1, towns.get(record.town, 0) + len(piece)
    return {"trajectories": trajectories, "frames": done, "towns": towns}


def _check(dataset: Dataset) -> None:
    known = {field.name for field in dataset.info.fields}
    missing = [name for name in (*_READINGS, *_COLUMNS) if name not in known]
    if missing:
        raise DatasetError(f"{dataset.root} has no field {missing[0]!r}, which LAV's format needs (suite 'lav_data').")


def _watched(frames: Iterator[LavFrame], done: int, total: int, watch: Watch | None) -> Iterator[LavFrame]:
    for k, frame in enumerate(frames):
        yield frame
        if watch is not None:
            watch((done + k + 1) / total)


def _frames(dataset: Dataset, episode: int, piece: range) -> Iterator[LavFrame]:
    table, layers = dataset.table(episode), _layers(dataset)
    steer = _steer(table)
    # Packing a JPEG twice would blur it, so colours go as they are.
    jpegs = {field.name for field in dataset.info.blobs if field.codec.startswith("jpeg")}
    for frame in piece:
        values = dataset.read(episode, frame, [name for name in _READINGS if name not in jpegs])
        packed = {name: dataset.encoded(episode, frame, name) for name in _READINGS if name in jpegs}
        for name in (*_RGB, "tel_rgb"):
            if name not in packed:
                packed[name] = encode_image(".jpg", cv2.cvtColor(values[name], cv2.COLOR_RGB2BGR))
        named = {name: values["bev"][k] for k, name in enumerate(layers)}
        yield LavFrame(
            rgb=tuple(packed[name] for name in _RGB),
            sem=tuple(encode_image(".png", values[name]) for name in _SEM),
            tel_rgb=packed["tel_rgb"],
            tel_sem=encode_image(".png", values["tel_sem"]),
            maps=layers_to_png(named),
            lidar=values["lidar"],
            **_labels(table, frame),
            **_ticks(table, frame, steer),
        )


def _labels(table: Table, frame: int) -> dict[str, Any]:
    """Actors and guidance of a frame in LAV's units."""
    row = table.row(frame, [name for name in _COLUMNS if not name.startswith("tick_")])
    kept = np.flatnonzero(row["actor_class"] != ActorClass.PROP)  # the ego, which comes first, is none
    velocity = row["actor_velocity"][kept].astype(np.float64)
    return {
        "id": row["actor_id"][kept],
        "loc": row["actor_position"][kept, :2].astype(np.float32),
        "ori": np.degrees(row["actor_yaw"][kept]).astype(np.float32),
        "bbox": row["actor_size"][kept, :2] / np.float32(2.0),
        "type": types_to_lav(row["actor_class"][kept]),
        "spd": np.hypot(velocity[:, 0], velocity[:, 1]).astype(np.float32),
        "cmd": command_to_lav(int(row["command"])),
        "nxp": goal_to_lav(row["goal"]).astype(np.float32),
        "bra": int(row["brake"]),
    }


def _ticks(table: Table, frame: int, steer: NDArray[np.float32]) -> dict[str, Any]:
    """What was measured at each tick since the last frame."""
    row = table.row(frame, ("tick_gnss", "tick_imu", "tick_speed"))
    ends = table.columns["tick_gnss"].ends
    assert ends is not None
    asked = steer[ends[frame] : ends[frame + 1]]
    fixes = np.column_stack([row["tick_gnss"][:, :2], row["tick_imu"][:, 6], row["tick_speed"], asked])
    return {
        "gnss": fixes.astype(np.float32), "lin_acc": row["tick_imu"][:, :3].copy(),
        "ang_vel": row["tick_imu"][:, 3:6].copy(),
    }  # fmt: skip


def _steer(table: Table) -> NDArray[np.float32]:
    """(V,) of all ticks, what was asked for at each: LAV's recorder kept that, we what led to each, one tick later."""
    control = table.columns.get("tick_control")
    if control is None:
        return np.zeros(len(table.columns["tick_gnss"].values), np.float32)
    asked: NDArray[np.float32] = np.append(control.values[1:, 1], control.values[-1:, 1]).astype(np.float32)
    return asked


def _layers(dataset: Dataset) -> tuple[str, ...]:
    """Names of the BEV's channels."""
    for values in dataset.info.record.suite:
        sensor = make_sensor(values)
        if isinstance(sensor, Bev) and sensor.config.id.lower() == "bev":
            return sensor.channels
    raise DatasetError(f"{dataset.root} has no BEV.")
