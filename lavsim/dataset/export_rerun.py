"""Exports a dataset as Rerun recordings, one an episode; needs the extra `rerun`.

Everything comes from the dataset: boxes, route and goal from its tables, cameras, LiDAR and BEV as they were stored.
The frame is that of `lavsim.rerun_export`: y points north.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.merge import Watch, new_folder
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import FieldSpec
from lavsim.errors import DatasetError
from lavsim.render.canvas import height_colours
from lavsim.render.frame import rotation
from lavsim.render.palette import TAG_BGR
from lavsim.rerun_export import APPLICATION, boxes_at, flipped, load_rerun
from lavsim.sensors.base import Sensor, make_sensor
from lavsim.sensors.bev import Bev
from lavsim.sensors.camera import ColourCamera, TagCamera
from lavsim.sensors.lidar import Lidar
from lavsim.types import DT, Tag

_CONTROLS = ("throttle", "steer", "brake")
_ROUTE, _GOAL = (29, 111, 216), (230, 140, 30)
_LOW, _HIGH = -1.5, 6.0  # [m] above the ego's origin, of the colours of points
_ROW = ("tick", "position", "yaw", "pitch", "speed", "control", "route", "goal", "actor_id", "actor_class",
        "actor_role", "actor_position", "actor_size", "actor_yaw")  # fmt: skip


def export_rerun(source: Path, out: Path, watch: Watch | None = None) -> dict[str, Any]:
    """Writes `ep_EEEEEE.rrd` for each episode of a dataset.

    Args:
        source: The dataset; without blobs they are rendered from its logs.
        out: Folder to make.
        watch: Is told the share that is done.

    Returns:
        How many episodes and frames were written.

    Raises:
        ConfigError: Rerun is not installed.
        DatasetError: the dataset has no tables, or is damaged.
        OutputError: `out` exists or can't be written.
    """
    rerun = load_rerun("--format rerun")
    dataset, done = Dataset(source), 0
    if not dataset.info.columns:
        raise DatasetError(f"{source} holds logs alone; make its tables with: lavsim render.")
    names = {field.name for field in dataset.info.columns}
    columns = [name for name in _ROW if name in names]
    readings = _readings(dataset)
    with new_folder(out) as root:
        for record in dataset.episodes.values():
            name = f"ep_{record.episode:06d}"
            # The id is the dataset's own, so that the same episode is the same recording.
            stream = rerun.RecordingStream(APPLICATION, recording_id=f"{source.name}-{name}")
            stream.save(root / f"{name}.rrd")
            _log_statics(rerun, stream, readings)
            for frame in range(record.frames):
                row = dataset.read(record.episode, frame, columns)
                stream.set_time("tick", sequence=int(row["tick"]))
                stream.set_time("time", duration=int(row["tick"]) * DT)
                _log_row(rerun, stream, row)
                for field, sensor in readings:
                    _log_reading(rerun, stream, dataset, (record.episode, frame), row, field, sensor)
                done += 1
                if watch is not None:
                    watch(done / len(dataset))
            stream.disconnect()
    return {"episodes": len(dataset.episodes), "frames": done}


def _readings(dataset: Dataset) -> list[tuple[FieldSpec, Sensor]]:
    """Sensors of the suite that have a field and can be shown."""
    fields = {field.name: field for field in dataset.info.blobs}
    sensors = [make_sensor(values) for values in dataset.info.record.suite]
    return [
        (fields[sensor.config.id.lower()], sensor)
        for sensor in sensors
        if sensor.config.id.lower() in fields and isinstance(sensor, ColourCamera | TagCamera | Lidar | Bev)
    ]


def _log_statics(rerun: Any, stream: Any, readings: list[tuple[FieldSpec, Sensor]]) -> None:
    stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    classes = [(int(tag), tag.name.lower(), tuple(int(v) for v in TAG_BGR[tag][::-1])) for tag in Tag]
    stream.log("cameras", rerun.AnnotationContext(classes), static=True)
    for field, sensor in readings:
        if isinstance(sensor, Bev):
            layers = [(k + 1, name) for k, name in enumerate(sensor.config.names)]
            stream.log(field.name, rerun.AnnotationContext([(0, "nothing", (34, 34, 34)), *layers]), static=True)


def _log_row(rerun: Any, stream: Any, row: dict[str, Any]) -> None:
    boxes = boxes_at(*(row[f"actor_{name}"] for name in ("position", "size", "yaw", "class", "role", "id")))
    stream.log("world/actors", rerun.Boxes3D(**boxes))
    stream.log("ego/speed", rerun.Scalars(float(row["speed"])))
    for name, value in zip(_CONTROLS, row.get("control", ()), strict=False):
        stream.log(f"ego/{name}", rerun.Scalars(float(value)))
    if len(row.get("route", ())):
        stream.log("world/route", rerun.LineStrips3D([_in_world(row, row["route"])], colors=[_ROUTE]))
    if "goal" in row:
        stream.log("world/goal", rerun.Points3D(_in_world(row, row["goal"][None]), colors=[_GOAL], radii=0.6))


def _log_reading(
    rerun: Any, stream: Any, dataset: Dataset, place: tuple[int, int], row: dict[str, Any], field: FieldSpec,
    sensor: Sensor,
) -> None:  # fmt: skip
    if isinstance(sensor, ColourCamera) and field.codec.startswith("jpeg"):  # as it is: packing twice would blur it
        data = dataset.encoded(*place, field.name)
        stream.log(f"cameras/{field.name}", rerun.EncodedImage(contents=data, media_type="image/jpeg"))
        return
    value = dataset.read(*place, [field.name])[field.name]
    if isinstance(sensor, ColourCamera):
        stream.log(f"cameras/{field.name}", rerun.Image(value))
    elif isinstance(sensor, TagCamera):
        stream.log(f"cameras/{field.name}", rerun.SegmentationImage(value))
    elif isinstance(sensor, Lidar):
        mount = sensor.config.mount
        points = value[:, :3].astype(np.float64) @ rotation(mount.roll, mount.pitch, mount.yaw).T
        points += np.array([mount.x, mount.y, mount.z])
        colours = height_colours(points[:, 2], _LOW, _HIGH)[:, ::-1]
        stream.log(f"world/{field.name}", rerun.Points3D(_in_world(row, points), colors=colours))
    else:
        on_top = np.zeros(value.shape[1:], np.uint8)
        for k, layer in enumerate(value):
            on_top[layer > 0] = k + 1
        stream.log(field.name, rerun.SegmentationImage(on_top))


def _in_world(row: dict[str, Any], points: NDArray[Any]) -> NDArray[np.float64]:
    """Points (N, 2 or 3) of the ego's frame [m] in Rerun's world."""
    local = np.zeros((len(points), 3))
    local[:, : points.shape[1]] = points
    turn = rotation(0.0, float(row.get("pitch", 0.0)), float(row["yaw"]))
    return flipped(local @ turn.T + row["position"])
