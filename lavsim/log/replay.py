"""What a recorded drive needs to be rendered, judged or driven on: town, route, draws, and any of its ticks again.

A drive is a function of its header and of the ego's controls. So a tick is reached again by driving there once more,
without sensors (in `us_large_a` with 100 vehicles 4,100 ticks a second); nothing of the world's inside is kept.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from lavsim.errors import LogError
from lavsim.log.reader import LogReader
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.scenery import SCENERY_VERSION
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from lavsim.world.snapshot import Snapshot

SAVE_SCHEMA = 1
_COMPARED = ("rows", "pose", "velocity", "state", "ego_motion", "control", "lights", "contacts", "weather_values",
             "hazards")  # fmt: skip


def town_of(reader: LogReader, search_path: Sequence[Path] = ()) -> TownMap:
    """The town a log was driven in.

    Raises:
        UnknownName: no town of that name is at hand.
        LogError: the town or its scenery has changed since the drive.
    """
    return _town(reader.path.name, reader.header, search_path)


def route_of(reader: LogReader, town: TownMap) -> Route:
    """The dense route of a log, traced again."""
    return get_planner(town).trace(np.array(reader.header["keypoints"], dtype=np.float64))


def draws_of(reader: LogReader) -> Draws:
    """The root of all draws of a log's drive."""
    return Draws.of_seed(int(reader.header["seed"]))


def recent_of(reader: LogReader, index: int, count: int) -> list[Snapshot]:
    """The last `count` snapshots up to number `index`, newest last: what `Simulation.recent` gave at that tick."""
    return [reader[k] for k in range(max(0, index - count + 1), index + 1)]


def resume(log: LogReader | Path, tick: int, search_path: Sequence[Path] = ()) -> Simulation:
    """The simulation of a recorded drive at `tick`, ready to go on with any control.

    Every tick on the way is compared with the log, so what comes out is what was recorded, to the bit.

    Args:
        log: The drive.
        tick: World tick to stop at; the log's first one is 1.
        search_path: Folders with towns.

    Raises:
        UnknownName: no town of that name is at hand.
        LogError: the log has no such tick, its town is another one here, or this machine or version of lavsim drives
            differently from the one that recorded it; the message names the first tick that differs.
    """
    reader = log if isinstance(log, LogReader) else LogReader(log)
    name = reader.path.name
    if not len(reader) or not reader[0].tick <= tick <= reader[-1].tick:
        span = f"ticks {reader[0].tick} to {reader[-1].tick}" if len(reader) else "no tick"
        raise LogError(f"{name} holds {span}; it can't be resumed at {tick}.")
    simulation = _simulation(name, reader.header, search_path)
    for recorded in reader:
        if recorded.tick > simulation.snapshot.tick:
            simulation.tick(control_of(recorded.control))
        differs = _difference(recorded, simulation.snapshot)
        if differs is not None:
            raise LogError(f"{name}: driven again, tick {recorded.tick} differs from the recorded one in {differs}.")
        if recorded.tick == tick:
            break
    return simulation


def save(simulation: Simulation) -> bytes:
    """The drive so far, for `restore`: its header, the controls and a digest of the newest tick."""
    head = {
        "schema": SAVE_SCHEMA,
        "header": simulation.header(),
        "ticks": len(simulation.controls),
        "digest": digest_of(simulation.snapshot),
    }
    text = json.dumps(head, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    controls = np.array(simulation.controls, dtype="<f4")
    return zstandard.ZstdCompressor(write_checksum=True).compress(text + b"\n" + controls.tobytes())


def restore(saved: bytes, search_path: Sequence[Path] = ()) -> Simulation:
    """The simulation that was saved, in this or another process, ready to go on with any control.

    Raises:
        UnknownName: no town of that name is at hand.
        LogError: not what `save` gave, the town is another one here, or driving there again ends elsewhere.
    """
    try:
        text, _, data = zstandard.decompress(saved).partition(b"\n")
        head = json.loads(text)
        schema = head["schema"]
    except (zstandard.ZstdError, ValueError, KeyError, TypeError):
        raise LogError("not a saved drive, or a damaged one.") from None
    if schema != SAVE_SCHEMA:
        raise LogError(f"the saved drive has format {schema}; this version of lavsim reads {SAVE_SCHEMA}.")
    simulation = _simulation("the saved drive", head["header"], search_path)
    for control in np.frombuffer(data, "<f4").reshape(-1, 5)[len(simulation.controls) :]:
        simulation.tick(control_of(control))
    if digest_of(simulation.snapshot) != head["digest"]:
        raise LogError(f"the saved drive, driven again, differs at tick {simulation.snapshot.tick}.")
    return simulation


def digest_of(snapshot: Snapshot) -> str:
    """A digest of all that a snapshot says."""
    digest = hashlib.blake2b(snapshot.tick.to_bytes(8, "little"), digest_size=16)
    for name in _COMPARED:
        digest.update(getattr(snapshot, name).tobytes())
    return digest.hexdigest()


def _simulation(name: str, header: Mapping[str, Any], search_path: Sequence[Path]) -> Simulation:
    _town(name, header, search_path)
    try:
        spec = DriveSpec.from_header(header, tuple(search_path))
    except KeyError as error:
        raise LogError(f"{name} was recorded by another version of lavsim: its header lacks {error}.") from None
    return Simulation(spec)


def _town(name: str, header: Mapping[str, Any], search_path: Sequence[Path]) -> TownMap:
    town = load_town(str(header["town"]), search_path)
    recorded = (header["town_digest"], header["scenery_version"])
    if recorded != (town.digest, SCENERY_VERSION):
        raise LogError(
            f"{name} was driven in {town.name} {recorded[0]} with scenery {recorded[1]}; "
            f"here it is {town.digest} with scenery {SCENERY_VERSION}."
        )
    return town


def control_of(values: NDArray[np.float32]) -> Control:
    """The control whose `Snapshot.control` these are."""
    throttle, steer, brake, hand_brake, reverse = values.tolist()
    return Control(throttle, steer, brake, bool(hand_brake), bool(reverse))


def _difference(recorded: Snapshot, driven: Snapshot) -> str | None:
    """In what two snapshots of a tick differ, None if in nothing."""
    for name in _COMPARED:
        first, second = getattr(recorded, name), getattr(driven, name)
        if first.shape != second.shape:
            return f"{name}: {len(first)} were recorded, {len(second)} driven"
        if first.tobytes() == second.tobytes():
            continue
        if name in ("pose", "velocity", "state"):
            actors = driven.ids[np.any(first != second, axis=1)]
            return f"{name} of actor {actors[0]}" + (f" and {len(actors) - 1} more" if len(actors) > 1 else "")
        return name
    return None
