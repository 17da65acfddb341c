"""Sensor readings of frames rendered from logs when they are asked for: the bytes that blobs decode to."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lavsim.dataset.codecs import decode, find_codec
from lavsim.dataset.rig import Rig
from lavsim.dataset.schema import FieldSpec
from lavsim.log.reader import LogReader
from lavsim.log.replay import draws_of, recent_of, town_of
from lavsim.render.scene import get_scene

_LOGS = 8  # logs kept open


class Rerendered:
    """Renders frames from logs.

    Args:
        suite: Sensor dicts.
        town_path: Folders with towns.
    """

    def __init__(self, suite: Sequence[Mapping[str, Any]], town_path: Sequence[Path] = ()) -> None:
        self._rig, self._town_path = Rig(suite), town_path
        self._logs: OrderedDict[Path, LogReader] = OrderedDict()

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
        reader = self._log(log)
        scene = get_scene(town_of(reader, self._town_path))
        index = tick - reader[0].tick
        recent = recent_of(reader, index, self._rig.history + 1)
        seen = self._rig.read(recent, scene, draws_of(reader), [item.name for item in fields])
        return {item.name: find_codec(item.codec).encode(seen.blobs[item.name]) for item in fields}

    def _log(self, path: Path) -> LogReader:
        if path in self._logs:
            self._logs.move_to_end(path)
            return self._logs[path]
        self._logs[path] = LogReader(path)
        if len(self._logs) > _LOGS:
            self._logs.popitem(last=False)
        return self._logs[path]
