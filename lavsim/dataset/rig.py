"""The sensors of a dataset at a kept tick: what they read, and what they saw of each actor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.codecs import find_codec
from lavsim.dataset.schema import BLOB, FieldSpec
from lavsim.errors import SensorError
from lavsim.kernel import kernel
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import ArraySpec, Sensor, make_sensor
from lavsim.sensors.bev import Bev
from lavsim.sensors.camera import ColourCamera, TagCamera
from lavsim.sensors.lidar import Lidar, SemanticLidar
from lavsim.world.snapshot import Snapshot

_PER_TICK = ("sensor.other.gnss", "sensor.other.imu", "sensor.speedometer")  # go to the table instead


@dataclass(frozen=True)
class Readings:
    """What the rig gives.

    Attributes:
        blobs: By field.
        lidar_now: How many of the LiDAR's points are of the newest tick.
        hits: (N,) points on each actor of the snapshot.
        pixels: (N, C) pixels of each actor in each camera.
    """

    blobs: dict[str, NDArray[Any]]
    lidar_now: int
    hits: NDArray[np.int32]
    pixels: NDArray[np.int32]


class Rig:
    """The sensors of a suite whose readings are kept as blobs.

    Actors are counted in the pictures of cameras of class tags and in the points of the LiDAR.

    Colour and tags of cameras on one mount come from one pass. A LiDAR's scan is this tick's half sweep and then the
    one before, each in the sensor's frame of its own tick: without motion compensation, as LAV's recorder and agent do
    it. Sensors for which it knows nothing better are kept as they are read.

    Args:
        suite: Sensor dicts; ids make the names of the fields, in lower case.
    """

    def __init__(self, suite: Sequence[Mapping[str, Any]]) -> None:
        self._sensors = [make_sensor(values) for values in suite if values.get("type") not in _PER_TICK]
        self.fields = tuple(_field(sensor) for sensor in self._sensors)
        self.cameras = tuple(
            f.name for f, s in zip(self.fields, self._sensors, strict=True) if isinstance(s, TagCamera)
        )

    @property
    def has_scan(self) -> bool:
        """Whether there is a LiDAR whose scan is put together of two ticks."""
        return any(map(_is_scanner, self._sensors))

    @property
    def history(self) -> int:
        """How many snapshots before the current one are read."""
        return max((max(s.history, int(_is_scanner(s))) for s in self._sensors), default=0)

    def read(
        self, history: Sequence[Snapshot], scene: Scene, draws: Draws, names: Sequence[str] | None = None
    ) -> Readings:
        """The readings at the newest snapshot.

        Args:
            history: Snapshots, newest last.
            scene: What there is to see.
            draws: Root of the drive's draws.
            names: Fields wanted; all if None.
        """
        now = history[-1]
        chosen = [
            (field.name, sensor)
            for field, sensor in zip(self.fields, self._sensors, strict=True)
            if names is None or field.name in names
        ]
        hits, lidar_now = np.zeros(len(now.ids), np.int32), 0
        blobs: dict[str, NDArray[Any]] = {}
        pixels = []
        # A scene keeps what it has drawn for one tick only, so LiDARs, which look at two, come first.
        for name, sensor in sorted(chosen, key=lambda item: not _is_scanner(item[1])):
            if isinstance(sensor, Lidar) and _is_scanner(sensor):
                blobs[name], lidar_now = self._scan(sensor, history, scene, draws, hits)
            elif isinstance(sensor, TagCamera):
                blobs[name], instance = sensor.view.labels(now, scene, sensor.config.tags)
                pixels.append(_count(instance.ravel(), now.ids))
            elif isinstance(sensor, ColourCamera):
                blobs[name] = np.asarray(cv2.cvtColor(sensor.read(history[-1:], scene, draws), cv2.COLOR_BGRA2RGB))
            else:
                blobs[name] = np.asarray(sensor.read(history[-(sensor.history + 1) :], scene, draws))
        counts = np.stack(pixels, axis=1) if pixels else np.zeros((len(now.ids), 0), np.int32)
        return Readings(blobs, lidar_now, hits, counts)

    def _scan(
        self, lidar: Lidar, history: Sequence[Snapshot], scene: Scene, draws: Draws, hits: NDArray[np.int32]
    ) -> tuple[NDArray[np.float32], int]:
        """Points (N, 4) of two half sweeps, newest first, and how many are of the newest; counts who is hit."""
        ids = history[-1].ids
        parts = []
        for snapshot in history[-2:]:
            sweep = lidar.sweep(snapshot, scene, draws)
            rows = sweep.solids - len(scene.statics.corners)
            hits += _count(scene.actors(snapshot).instance[rows[rows >= 0]], ids)
            parts.append(sweep.points)
        return np.concatenate(parts[::-1]), len(parts[-1])


def _is_scanner(sensor: Sensor) -> bool:
    """Whether its scan is put together of two ticks."""
    return isinstance(sensor, Lidar) and not isinstance(sensor, SemanticLidar) and not sensor.model.full_sweep


def _field(sensor: Sensor) -> FieldSpec:
    spec = sensor.spec
    if not isinstance(spec, ArraySpec):
        raise SensorError(f"a dataset keeps arrays; {sensor.config.id!r} of type {sensor.config.type!r} gives several.")
    name = sensor.config.id.lower()
    shape: tuple[int | str, ...]
    if isinstance(sensor, ColourCamera):
        shape, codec, unit, about = (*_size(sensor), 3), "jpeg90", "red, green, blue", "colour"
    elif isinstance(sensor, TagCamera):
        shape, codec, unit, about = _size(sensor), "zstd", "Tag", "class ids, CARLA's table up to 0.9.13"
        if sensor.config.tags == "new":
            about = "class ids, CARLA's table from 0.9.14 on"
    elif _is_scanner(sensor):
        shape, codec, unit = ("points", 4), "lidar_cm", "m, m, m, 1"
        about = "x, y, z, intensity: this tick's half sweep (`lidar_now` points), then the one before in its own frame"
    elif isinstance(sensor, Bev) and "limit" not in sensor.config.names:
        config = sensor.config
        shape, codec, unit = (len(sensor.channels), config.height, config.width), "packbits_zstd", "255 where set"
        about = ", ".join(sensor.channels)
    else:
        shape = tuple("values" if size is None else size for size in spec.shape)
        codec, unit, about = "npy_zstd", spec.unit, sensor.config.type
    dtype = str(np.dtype(spec.dtype)) if np.dtype(spec.dtype).names is None else "record"
    frame = {"lidar_cm": "lidar", "packbits_zstd": "ego"}.get(codec, "image" if len(shape) > 1 else "sensor")
    return FieldSpec(name, dtype, shape, unit, frame, codec, BLOB, f"{name}.{find_codec(codec).suffix}", about)


def _size(sensor: ColourCamera | TagCamera) -> tuple[int, int]:
    return sensor.config.height, sensor.config.width


def _count(seen: NDArray[np.int32], ids: NDArray[np.int32]) -> NDArray[np.int32]:
    """(N,) how often each of `ids` is among `seen`."""
    order = np.argsort(ids, kind="stable")
    counts = np.zeros(len(ids), np.int32)
    counts[order] = _count_sorted(seen, ids[order])
    return counts


@kernel
def _count_sorted(seen, ids):  # type: ignore[no-untyped-def]
    """Runs of one id, as images have them, are looked up once."""
    counts = np.zeros(len(ids), np.int32)
    last, at = -1, -1
    for n in range(len(seen)):
        actor = seen[n]
        if actor == 0:
            continue
        if actor != last:
            last, at = actor, np.searchsorted(ids, actor)
            if at == len(ids) or ids[at] != actor:
                at = -1
        if at >= 0:
            counts[at] += 1
    return counts
