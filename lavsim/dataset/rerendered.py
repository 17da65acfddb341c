"""Sensor readings of frames rendered from logs when they are asked for: the bytes that blobs decode to."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.dataset.codecs import decode, find_codec
from lavsim.dataset.rig import Rig
from lavsim.dataset.schema import FieldSpec
from lavsim.log.reader import LogReader
from lavsim.log.replay import draws_of, recent_of, town_of
from lavsim.random import Draws
from lavsim.render.scene import Scene, get_scene

_LOGS = 8  # logs kept open


@dataclass(frozen=True)
class _Source:
    """A log and what its drive is rendered with; `first` is its first tick."""

    reader: LogReader
    first: int
    scene: Scene
    draws: Draws


class Rerendered:
    """Renders frames from logs.

    Args:
        suite: Sensor dicts.
        town_path: Folders with towns.
    """

    def __init__(self, suite: Sequence[Mapping[str, Any]], town_path: Sequence[Path] = ()) -> None:
        self._rig, self._town_path = Rig(suite), town_path
        self._sources: OrderedDict[Path, _Source] = OrderedDict()

    def read(self, log: Path, tick: int, fields: Sequence[FieldSpec]) -> dict[str, Any]:
        """The readings of some fields at a tick, after their codecs have rounded them.

        Raises:
            LogError: as `encoded`.
        """
        blobs = self.encoded(log, tick, fields)
        return {item.name: decode(item.codec, blobs[item.name], item.shape) for item in fields}

    def encoded(self, log: Path, tick: int, fields: Sequence[FieldSpec]) -> dict[str, bytes]:
        """The blobs of some fields at a tick.

        Raises:
            LogError: the log is damaged, or its town is another one here.
        """
        source = self._source(log)
        recent = recent_of(source.reader, tick - source.first, self._rig.history + 1)
        seen = self._rig.read(recent, source.scene, source.draws, [item.name for item in fields])
        return {item.name: find_codec(item.codec).encode(seen.blobs[item.name]) for item in fields}

    def _source(self, path: Path) -> _Source:
        if path in self._sources:
            self._sources.move_to_end(path)
            return self._sources[path]
        reader = LogReader(path)
        town = town_of(reader, self._town_path)
        self._sources[path] = _Source(reader, reader[0].tick, get_scene(town), draws_of(reader))
        if len(self._sources) > _LOGS:
            self._sources.popitem(last=False)
        return self._sources[path]
