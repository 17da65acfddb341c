"""What a town is made of, worked out from a file's records; and its copy on disk.

The copy is a JSON header and raw arrays with a checksum, under `lavsim.cache.cache_dir()`, named by the hash of the
town's file, a schema number and the hash of the code that works it out. What can't be read back is worked out again.
"""

from __future__ import annotations

import hashlib
import json
import logging
import zlib
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.cache import cache_dir, replace_atomically
from lavsim.errors import MapError
from lavsim.map.junction import Junction, build_junction
from lavsim.map.lane import LaneTable
from lavsim.map.lane_build import build_lanes
from lavsim.map.links import Report
from lavsim.map.opendrive import reference_origin
from lavsim.map.parking import ParkingSlot, build_parking
from lavsim.map.records import Network
from lavsim.map.section import RoadShape
from lavsim.map.signal import (
    LightGroup,
    Sign,
    TrafficLight,
    TriggerBox,
    build_groups,
    build_lights,
    build_signs,
    speed_signs,
)
from lavsim.map.stop_lines import StopLine, outline_in_world

Floats = NDArray[np.float64]

SCHEMA = 1
MAGIC = b"lavsim town\n"
CODE = (  # modules behind the data
    "conflicts",
    "curve",
    "derived",
    "junction",
    "lane",
    "lane_build",
    "links",
    "opendrive",
    "parking",
    "pieces",
    "records",
    "section",
    "signal",
    "speed_limits",
    "stop_lines",
    "turns",
)
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class TownData:
    """The derived part of a `TownMap`, see there."""

    lanes: LaneTable
    junctions: tuple[Junction, ...]
    lights: tuple[TrafficLight, ...]
    light_groups: tuple[LightGroup, ...]
    signs: tuple[Sign, ...]
    crosswalks: tuple[Floats, ...]
    parking: tuple[ParkingSlot, ...]
    geo_reference: tuple[float, float]
    report: tuple[str, ...]


def road_shapes(network: Network, source: str) -> dict[int, RoadShape]:
    """Curves of all roads by id.

    Raises:
        MapError: a curve makes no sense; with `source` and line.
    """
    shapes = {}
    for road in network.roads:
        try:
            shapes[road.id] = RoadShape(road)
        except MapError as error:
            raise MapError(f"{source}, line {road.line}: road {road.id}: {error}.") from None
    return shapes


def derive(network: Network, shapes: dict[int, RoadShape], source: str) -> TownData:
    """Works everything out.

    Raises:
        MapError: the records make no town; with `source`.
    """
    report = Report()
    try:
        lanes = build_lanes(network, shapes, network.junctions, speed_signs(network), report)
        lights, governing = build_lights(network, shapes, lanes)
        signs, guarding = build_signs(network, shapes, lanes)
    except MapError as error:
        text = str(error)
        raise MapError(f"{source}{',' if text.startswith('line ') else ':'} {text}") from None
    lanes = replace(lanes, light=governing, sign=guarding)
    return TownData(
        lanes=lanes,
        junctions=tuple(build_junction(k, record, lanes) for k, record in enumerate(network.junctions)),
        lights=lights,
        light_groups=build_groups(network, network.junctions, lights),
        signs=signs,
        crosswalks=tuple(
            outline_in_world(thing, shapes[road.id])
            for road in network.roads
            for thing in road.objects
            if thing.kind == "crosswalk"
        ),
        parking=build_parking(network, shapes),
        geo_reference=reference_origin(network.geo_reference),
        report=tell(network, report),
    )


def tell(network: Network, report: Report) -> tuple[str, ...]:
    """What was mended, dropped and not read, in sentences; the last in one."""
    sentences = [f"{repair[0].upper()}{repair[1:]}." for repair in network.repairs]
    sentences += [f"{sentence[0].upper()}{sentence[1:]}" for sentence in report.sentences()]
    if network.notes:
        sentences.append("Not read: " + ", ".join(note.removesuffix(" not read") for note in network.notes) + ".")
    return tuple(sentences)


@cache
def _code_digest() -> str:
    """Changes whenever the code that works out the data does, so that no stale copy is read."""
    digest = hashlib.sha256()
    for name in CODE:
        path = Path(__file__).with_name(f"{name}.py")
        digest.update(path.read_bytes() if path.exists() else b"")
    return digest.hexdigest()[:8]


def copy_path(digest: str) -> Path:
    """Where the copy of the town with that hash lies."""
    folder = cache_dir() / "towns"
    folder.mkdir(exist_ok=True)
    return folder / f"{digest}-{SCHEMA}-{_code_digest()}.town"


def save(data: TownData, digest: str) -> None:
    """Leaves a copy; a full or read-only disk is no error."""
    arrays: dict[str, NDArray[Any]] = {f"lanes.{f.name}": getattr(data.lanes, f.name) for f in fields(LaneTable)}
    for k, junction in enumerate(data.junctions):
        arrays[f"junctions.{k}"] = junction.polygon
    for k, polygon in enumerate(data.crosswalks):
        arrays[f"crosswalks.{k}"] = polygon
    for k, slot in enumerate(data.parking):
        arrays[f"parking.{k}"] = slot.polygon
    table, blobs, offset = {}, [], 0
    for name, array in arrays.items():
        blob = np.ascontiguousarray(array).tobytes()
        table[name] = [array.dtype.str, list(array.shape), offset]
        padding = -len(blob) % 16
        blobs += [blob, bytes(padding)]
        offset += len(blob) + padding
    body = b"".join(blobs)
    header = {
        "arrays": table,
        "size": len(body),
        "checksum": zlib.crc32(body),
        "junctions": [[j.index, j.id, j.lanes, j.controllers] for j in data.junctions],
        "lights": [asdict(light) for light in data.lights],
        "light_groups": [asdict(group) for group in data.light_groups],
        "signs": [asdict(sign) for sign in data.signs],
        "parking": [[p.x, p.y, p.yaw, p.length, p.width] for p in data.parking],
        "crosswalks": len(data.crosswalks),
        "geo_reference": data.geo_reference,
        "report": data.report,
    }
    text = json.dumps(header).encode()
    text += b" " * (-(len(MAGIC) + 8 + len(text)) % 16)
    check = zlib.crc32(text).to_bytes(4, "little")
    try:
        replace_atomically(copy_path(digest), MAGIC + len(text).to_bytes(4, "little") + check + text + body)
    except OSError as error:
        _log.info("no copy of the town is kept: %s", error)


def load(digest: str) -> TownData | None:
    """The copy of the town with that hash; None where there is none or it is damaged."""
    try:
        raw = copy_path(digest).read_bytes()
    except OSError:
        return None
    try:
        return _decode(raw)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        _log.info("a damaged copy of a town is worked out again: %s", error)
        return None


def _decode(raw: bytes) -> TownData:
    start = len(MAGIC) + 8
    if raw[: len(MAGIC)] != MAGIC or len(raw) < start:
        raise ValueError("no copy of a town")
    size = int.from_bytes(raw[len(MAGIC) : len(MAGIC) + 4], "little")
    text = raw[start : start + size]
    if len(text) != size or zlib.crc32(text).to_bytes(4, "little") != raw[len(MAGIC) + 4 : start]:
        raise ValueError("damaged header")
    header = json.loads(text)
    body = memoryview(raw)[start + size :]
    if len(body) != header["size"] or zlib.crc32(body) != header["checksum"]:
        raise ValueError("damaged arrays")

    def array(name: str) -> NDArray[Any]:
        kind, shape, offset = header["arrays"][name]
        count = int(np.prod(shape))
        return np.frombuffer(body, np.dtype(kind), count, offset).reshape(shape)

    return TownData(
        lanes=LaneTable(**{f.name: array(f"lanes.{f.name}") for f in fields(LaneTable)}),
        junctions=tuple(
            Junction(index, number, tuple(members), array(f"junctions.{k}"), tuple(controllers))
            for k, (index, number, members, controllers) in enumerate(header["junctions"])
        ),
        lights=tuple(TrafficLight(**_signal(light)) for light in header["lights"]),
        light_groups=tuple(
            LightGroup(group["junction"], tuple(tuple(phase) for phase in group["phases"]))
            for group in header["light_groups"]
        ),
        signs=tuple(Sign(**_signal(sign)) for sign in header["signs"]),
        crosswalks=tuple(array(f"crosswalks.{k}") for k in range(header["crosswalks"])),
        parking=tuple(ParkingSlot(array(f"parking.{k}"), *slot) for k, slot in enumerate(header["parking"])),
        geo_reference=(header["geo_reference"][0], header["geo_reference"][1]),
        report=tuple(header["report"]),
    )


def _signal(record: dict[str, Any]) -> dict[str, Any]:
    """Fields of a light or sign, from JSON's lists and dictionaries."""
    kinds: dict[str, Any] = {"stop_lines": StopLine, "boxes": TriggerBox, "early_boxes": TriggerBox}
    made: dict[str, Any] = {}
    for name, value in record.items():
        if name in kinds:
            made[name] = tuple(kinds[name](**entry) for entry in value)
        else:
            made[name] = tuple(value) if isinstance(value, list) else value
    return made
