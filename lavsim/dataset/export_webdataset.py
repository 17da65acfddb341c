"""Exports a dataset as WebDataset shards that need nothing of ours: JPEG, PNG, NPY and JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lavsim.dataset.card import LICENCE
from lavsim.dataset.files import write_file
from lavsim.dataset.merge import Watch, new_folder
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import FieldSpec
from lavsim.dataset.webdataset import NAME, SampleWriter, npy_bytes, npz_bytes
from lavsim.errors import DatasetError, UnknownName

_TABLE = "json"


def export_webdataset(
    source: Path, out: Path, fields: Sequence[str] | None = None, watch: Watch | None = None
) -> dict[str, Any]:
    """Writes a dataset's frames as samples `EEEEEE_FFFFFF`, episode and frame, in order.

    A sample has its table's row as `json` (arrays as lists, numbers that are not known as null), colours as `NAME.jpg`,
    tags as `NAME.png`, BEV and others as `NAME.npz` (array `data`), LiDAR as `NAME.npy` (float32, N x 4).

    Args:
        source: The dataset; without blobs they are rendered from its logs.
        out: Folder to make: shards and `dataset.json`, which says what they hold.
        fields: Readings wanted; all if None. The row is always there.
        watch: Is told the share that is done.

    Returns:
        What `dataset.json` holds.

    Raises:
        DatasetError: the dataset has no tables, or is damaged.
        UnknownName: no such reading.
        OutputError: `out` exists or can't be written.
    """
    dataset = Dataset(source)
    if not dataset.info.columns:
        raise DatasetError(f"{source} holds logs alone; make its tables with: lavsim render.")
    blobs = _chosen(dataset, fields)
    with new_folder(out) as root:
        writer, done = SampleWriter(root), 0
        for record in dataset.episodes.values():
            for frame in range(record.frames):
                writer.add(f"{record.episode:06d}_{frame:06d}", _sample(dataset, record.episode, frame, blobs))
                done += 1
                if watch is not None:
                    watch(done / len(dataset))
        writer.close()
        about = _about(dataset, blobs, writer.shards)
        write_file(root / "dataset.json", (json.dumps(about, indent=1, sort_keys=True) + "\n").encode())
        write_file(root / "README.md", _card(about).encode())
    return about


def _chosen(dataset: Dataset, fields: Sequence[str] | None) -> list[FieldSpec]:
    blobs = {field.name: field for field in dataset.info.blobs}
    if fields is None:
        return list(blobs.values())
    for name in fields:
        if name not in blobs:
            raise UnknownName("reading", name, blobs)
    return [blobs[name] for name in fields]


def _sample(dataset: Dataset, episode: int, frame: int, blobs: Sequence[FieldSpec]) -> dict[str, bytes]:
    row = dataset.table(episode).row(frame)
    text = json.dumps({name: _plain(value) for name, value in row.items()}, allow_nan=False)
    files = {_TABLE: text.encode()}
    decoded = [field for field in blobs if not _is_jpeg(field)]
    values = dataset.read(episode, frame, [field.name for field in decoded]) if decoded else {}
    for field in blobs:
        if field.name in values:
            files[_member(field)] = _packed(field, values[field.name])
        else:
            files[_member(field)] = dataset.encoded(episode, frame, field.name)  # as it is: packing twice would blur it
    return dict(sorted(files.items()))


def _packed(field: FieldSpec, value: Any) -> bytes:
    suffix = _member(field).rpartition(".")[2]
    if suffix == "png":
        done, data = cv2.imencode(".png", value)
        if not done:
            raise DatasetError(f"{field.name} could not be packed as PNG.")
        return bytes(data)
    return npy_bytes(value) if suffix == "npy" else npz_bytes(data=value)


def _member(field: FieldSpec) -> str:
    if _is_jpeg(field):
        return f"{field.name}.jpg"
    if field.is_ragged and field.codec == "lidar_cm":
        return f"{field.name}.npy"
    is_image = len(field.shape) == 2 and field.dtype == "uint8"
    return f"{field.name}.{'png' if is_image else 'npz'}"


def _is_jpeg(field: FieldSpec) -> bool:
    return field.codec.startswith("jpeg")


def _plain(value: Any) -> Any:
    """In JSON types; what is not finite is null."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            return np.where(np.isfinite(value), value.astype(object), np.array(None)).tolist()
        return value.tolist()
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _about(dataset: Dataset, blobs: Sequence[FieldSpec], shards: int) -> dict[str, Any]:
    last = NAME.format(max(shards - 1, 0))
    begin, digits, end = NAME.partition("{:06d}")[0], last[6:12], NAME.partition("{:06d}")[2]
    return {
        "shards": f"{begin}{{000000..{digits}}}{end}" if shards else "",
        "samples": len(dataset),
        "key": "episode_frame",
        "rate": "4 frames a second; the field tick tells where frames are left out",
        "row": {f.name: {"unit": f.unit, "frame": f.frame, "about": f.about} for f in dataset.info.columns},
        "readings": {
            _member(f): {"dtype": f.dtype, "shape": list(f.shape), "unit": f.unit, "about": f.about} for f in blobs
        },
        "sensors": [dict(values) for values in dataset.info.record.suite],
        "versions": dict(dataset.info.versions),
    }


def _card(about: dict[str, Any]) -> str:
    readings = "\n".join(
        f"* `{name}`: {entry['dtype']} {' x '.join(map(str, entry['shape']))}, {entry['about']}"
        for name, entry in sorted(about["readings"].items())
    )
    return (
        f"---\nlicense: {LICENCE}\ntask_categories:\n- robotics\ntags:\n- webdataset\n- lavsim\n"
        "- autonomous-driving\nconfigs:\n- config_name: default\n  data_files: shard-*.tar\n---\n\n"
        f"# Driving demonstrations of lavsim\n\n{about['samples']} frames as WebDataset shards, `{about['shards']}`, "
        "in the order of the drives. A sample's key is EPISODE_FRAME; its members:\n\n"
        "* `json`: the frame's row: ego, guidance, labels, all actors; `dataset.json` says what each entry is\n"
        f"{readings}\n"
    )
