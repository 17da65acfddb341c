"""Imports LAV's own lmdb trajectories as a dataset: tables and blobs, and no log.

LAV keeps less than we do. Fields that it can't tell are not there: lights, route, weather, throttle and brake, what the
sensors saw of each actor. Heights and kinds of actors are usual ones for their size, all ground lies at z = 0, others
move along their heading, and ticks are counted from the first measurement on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.card import write_card
from lavsim.dataset.codecs import find_codec
from lavsim.dataset.lav_frames import (
    OUR_LAYERS,
    classes_from_lav,
    command_from_lav,
    decode_image,
    goal_from_lav,
    layers_from_png,
    sizes_from_lav,
)
from lavsim.dataset.lav_lmdb import LavFrame, LavTrajectory, trajectories
from lavsim.dataset.merge import Watch, new_folder
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import TICKS_PER_FRAME, DatasetInfo, FieldSpec, RecordConfig, file_of
from lavsim.dataset.shard import ShardWriter
from lavsim.dataset.tables import Table, write_table
from lavsim.errors import DatasetError
from lavsim.sensors.suites import find_suite
from lavsim.types import Role

_SUITE = "lav_data"
_COLUMNS = (
    "tick", "position", "yaw", "velocity", "speed", "brake", "brake_cause", "brake_actor", "command", "goal",
    "tick_gnss", "tick_imu", "tick_speed", "actor_id", "actor_class", "actor_role", "actor_blueprint",
    "actor_position", "actor_yaw", "actor_pitch", "actor_velocity", "actor_size", "pitch",
)  # fmt: skip


def import_lav(source: Path, out: Path, watch: Watch | None = None) -> Dataset:
    """Makes a dataset of LAV's trajectories, an episode each, in the order of their names.

    Args:
        source: Folder of trajectories, or one of them.
        out: Folder to make.
        watch: Is told the share that is done.

    Raises:
        DatasetError: there is no trajectory, or one is damaged; or the package lmdb is missing.
        OutputError: `out` exists or can't be written.
    """
    found, info = trajectories(source), lav_info()
    with new_folder(out) as root:
        info.write(root)
        for number, folder in enumerate(found):
            with LavTrajectory(folder) as trajectory:
                _episode(root, number, info, trajectory)
            if watch is not None:
                watch((number + 1) / len(found))
        write_card(root)
    return Dataset(out)


def lav_info() -> DatasetInfo:
    """What a dataset says of itself that was imported from LAV's."""
    layers = {"type": "sensor.lavsim.bev", "id": "BEV", "attributes": {"layers": ",".join(OUR_LAYERS)}}
    suite = tuple(layers if values["id"] == "BEV" else values for values in find_suite(_SUITE))
    whole = DatasetInfo.of(RecordConfig(suite), config={"imported_from": "LAV's lmdb trajectories"})
    columns = [field for field in whole.columns if field.name in _COLUMNS]
    return replace(whole, fields=(*columns, *(_as_stored(field) for field in whole.blobs)))


def _as_stored(field: FieldSpec) -> FieldSpec:
    if field.codec.startswith("jpeg"):
        return replace(field, about="colour, in the JPEG that LAV's recorder made")
    return replace(field, about="x, y, z, intensity: two half sweeps") if field.name == "lidar" else field


def _episode(root: Path, number: int, info: DatasetInfo, trajectory: LavTrajectory) -> None:
    """Writes an episode of a trajectory."""
    shard = ShardWriter(
        root / file_of("shard", number), root / file_of("index", number), [field.member for field in info.blobs]
    )
    rows: list[dict[str, Any]] = []
    tick = 0
    try:
        for t, frame in enumerate(trajectory):
            tick += len(frame.gnss)
            rows.append(_row(frame, tick))
            try:
                shard.add(list(_blobs(frame, info.blobs)))
            except ValueError as error:
                raise DatasetError(f"{trajectory.folder.name}, frame {t}: {error}.") from None
        packed, index = shard.finish()
    except BaseException:
        shard.abandon()
        raise
    table = Table.of_rows(rows, info.columns)
    path = root / file_of("table", number)
    facts = write_table(path, table, info.columns, {"town": trajectory.town, "episode": str(number)})
    files = {file_of("table", number): facts, file_of("shard", number): packed, file_of("index", number): index}
    steps = np.diff(table["position"][:, :2], axis=0)
    EpisodeRecord(
        episode=number,
        town=trajectory.town,
        route_id=trajectory.folder.name,
        seed=0,
        frames=len(rows),
        ticks=tick,
        distance=round(float(np.hypot(steps[:, 0], steps[:, 1]).sum()), 3),
        ending="imported",
        agent_status=0,
        files=files,
        facts={"weather": "unknown"},
        breaks=_breaks(table["tick"]),
    ).write(root)


def _breaks(ticks: NDArray[np.int32]) -> tuple[int, ...]:
    """Frames before which LAV's recorder left some out."""
    return tuple(int(k) + 1 for k in np.flatnonzero(np.diff(ticks) != TICKS_PER_FRAME))


def _row(frame: LavFrame, tick: int) -> dict[str, Any]:
    """A frame in our columns."""
    yaw = np.radians(frame.ori.astype(np.float64))
    yaw = np.mod(yaw + np.pi, 2.0 * np.pi) - np.pi
    classes = classes_from_lav(frame.type, frame.bbox)
    count, ticks = len(frame.id), len(frame.gnss)
    position = np.column_stack([frame.loc.astype(np.float64), np.zeros(count)])
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(count)])
    velocity = (ahead * frame.spd[:, None]).astype(np.float32)
    return {
        "tick": tick,
        "position": position[0],
        "yaw": yaw[0],
        "pitch": 0.0,
        "velocity": velocity[0],
        "speed": frame.spd[0],
        "brake": frame.bra,
        "brake_cause": "unknown" if frame.bra else "none",
        "brake_actor": 0,
        "command": command_from_lav(frame.cmd),
        "goal": goal_from_lav(frame.nxp),
        "tick_gnss": np.column_stack([frame.gnss[:, :2].astype(np.float64), np.zeros(ticks)]),
        "tick_imu": np.column_stack([frame.lin_acc, frame.ang_vel, frame.gnss[:, 2]]),
        "tick_speed": frame.gnss[:, 3],
        "actor_id": frame.id,
        "actor_class": classes,
        "actor_role": np.where(np.arange(count) == 0, int(Role.EGO), int(Role.TRAFFIC)),
        "actor_blueprint": [""] * count,
        "actor_position": position,
        "actor_yaw": yaw,
        "actor_pitch": np.zeros(count),
        "actor_velocity": velocity,
        "actor_size": sizes_from_lav(frame.bbox, classes),
    }


def _blobs(frame: LavFrame, fields: Sequence[FieldSpec]) -> Iterator[bytes]:
    """The frame's readings as our codecs have them; colours stay the files that they are."""
    for field in fields:
        name, _, number = field.name.partition("_")
        if field.codec.startswith("jpeg"):
            yield frame.tel_rgb if name == "tel" else frame.rgb[int(number)]
            continue
        if name == "lidar":
            value: NDArray[Any] = frame.lidar
        elif name == "bev":
            value = layers_from_png(frame.maps)
        else:
            value = decode_image(frame.tel_sem if name == "tel" else frame.sem[int(number)], cv2.IMREAD_GRAYSCALE)
        shape = tuple(size for size in field.shape if not isinstance(size, str))
        if value.shape[-len(shape) :] != shape:
            raise ValueError(f"{field.name} has the shape {value.shape}, not {field.shape}")
        yield find_codec(field.codec).encode(value)
