"""Frames of approaches on disk, a shard an episode, beside the data whose moments they are."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.lav.data.approaches import Posed, approaches_of, posed
from lavsim.dataset.codecs import decode, find_codec
from lavsim.dataset.files import write_file
from lavsim.dataset.reader import Dataset
from lavsim.dataset.rig import Rig
from lavsim.dataset.schema import file_of
from lavsim.dataset.shard import ShardReader, ShardWriter
from lavsim.errors import ConfigError, DatasetError
from lavsim.log.reader import LogReader
from lavsim.log.replay import draws_of, town_of
from lavsim.random import Draws
from lavsim.render.scene import get_scene

STAGED_SCHEMA = 1
_NOTE = "ep_{:06d}.json"


class Told(NamedTuple):
    """What frames show; all (N,).

    Attributes:
        episode, frame: Where they lie; frames count from 0 in each episode.
        state: `LightState` of the light that governs the ego, UNKNOWN where none does.
        light_distance, sign_distance: From the ego's front to the line [m]; NaN where there is none.
    """

    episode: NDArray[np.int64]
    frame: NDArray[np.int64]
    state: NDArray[np.int64]
    light_distance: NDArray[np.float64]
    sign_distance: NDArray[np.float64]


def write_episode(folder: Path, data: Dataset, episode: int, frames: int, names: tuple[str, ...]) -> None:
    """Draws, renders and writes the frames of an episode; the note that comes last says that they are there.

    Raises:
        ConfigError: the data has no log of the episode.
    """
    made_from = origin_of(data, episode, frames, names)
    if _note(folder, episode).get("made_from") == made_from:
        return
    folder.mkdir(parents=True, exist_ok=True)
    fields = [field for field in data.info.fields if field.name in names]
    tar, index = _shard_of(folder, episode)
    writer = ShardWriter(tar, index, [field.member for field in fields])
    rows = []
    try:
        for shown, blobs in _rendered(data, episode, frames, names):
            writer.add([find_codec(field.codec).encode(blobs[field.name]) for field in fields])
            rows.append([int(shown.state), _plain(shown.light_distance), _plain(shown.sign_distance)])
        writer.finish()
    except BaseException:
        writer.abandon()
        raise
    note = {"made_from": made_from, "names": [field.name for field in fields], "rows": rows}
    write_file(folder / _NOTE.format(episode), (json.dumps(note) + "\n").encode())


def origin_of(data: Dataset, episode: int, frames: int, names: tuple[str, ...]) -> dict[str, Any]:
    """What an episode's frames are a function of.

    Raises:
        ConfigError: the data has no log of it.
    """
    log = data.episodes[episode].files.get(file_of("log", episode))
    if log is None:
        raise ConfigError(f"{data.root.name} has no log of episode {episode} to render approaches from.")
    return {"schema": STAGED_SCHEMA, "log": log.sha256, "frames": frames, "names": sorted(names)}


def _rendered(
    data: Dataset, episode: int, frames: int, names: tuple[str, ...]
) -> Iterator[tuple[Posed, dict[str, NDArray[Any]]]]:
    reader = LogReader(data.root / file_of("log", episode))
    town, drive = town_of(reader), draws_of(reader)
    scene, rig, ways = get_scene(town), Rig(data.info.record.suite), approaches_of(town)
    draws = Draws.of_seed(int(reader.header["seed"])).stream("approaches")
    ticks = np.sort([draws.integer(3, len(reader), number) for number in range(frames)])
    for number, tick in enumerate(ticks.tolist()):
        shown = posed(reader[tick], town, ways, draws.stream("frame", number))
        yield shown, rig.read([shown.snapshot], scene, drive, names).blobs


class StagedFrames:
    """Reads frames of approaches. May be handed to other processes.

    Args:
        folder: Where they lie.
        data: Whose moments they are.

    Raises:
        DatasetError: there are none of this data.
    """

    def __init__(self, folder: Path, data: Dataset) -> None:
        self._folder = folder
        self._fields = {field.name: field for field in data.info.fields}
        self._shards: dict[int, ShardReader] = {}
        self._names: tuple[str, ...] = ()
        rows = []
        for episode in data.episodes:
            note = _note(folder, episode)
            self._names = tuple(note.get("names", self._names))
            rows += [[episode, number, *row] for number, row in enumerate(note.get("rows", []))]
        if not rows:
            raise DatasetError(f"{folder} holds no approaches of {data.root.name}.")
        table = np.array(rows, np.float64)
        episode, frame, state = table[:, :3].astype(np.int64).T
        self.told = Told(episode, frame, state, table[:, 3], table[:, 4])

    def __len__(self) -> int:
        return len(self.told.state)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_shards": {}}

    def read(self, number: int, names: tuple[str, ...]) -> dict[str, Any]:
        """Readings of frame `number` by name.

        Raises:
            DatasetError: a file is missing or damaged.
        """
        episode, frame = int(self.told.episode[number]), int(self.told.frame[number])
        if episode not in self._shards:
            members = [self._fields[name].member for name in self._names]
            self._shards[episode] = ShardReader(*_shard_of(self._folder, episode), members)
        shard, fields = self._shards[episode], [self._fields[name] for name in names]
        return {field.name: decode(field.codec, shard.read(frame, field.member), field.shape) for field in fields}


def _shard_of(folder: Path, episode: int) -> tuple[Path, Path]:
    return folder / f"ep_{episode:06d}.tar", folder / f"ep_{episode:06d}.index"


def _note(folder: Path, episode: int) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads((folder / _NOTE.format(episode)).read_text())
    except (OSError, ValueError):
        return {}
    return found


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else round(float(value), 3)
