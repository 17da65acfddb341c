"""Writes a drive to disk while it happens.

File: `MAGIC`, then sections of (tag, payload length, CRC-32, payload): `HEAD` (JSON), `ACTR` (new rows of the actor
table, JSON), `TICK` (a block of ticks), `DONE` (how it ended, JSON). A file cut anywhere is readable up to its last
whole section. Nothing in it depends on the clock or on where it lies.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lavsim.log.codec import BLOCK_TICKS, encode_block
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.simulation import Simulation

MAGIC = b"LAVLOG\x00\x01"
SECTION = struct.Struct("<4sII")
LOG_SCHEMA = 1


class LogWriter:
    """Observer that keeps every tick.

    Args:
        path: The file, `*.lavlog`; replaced if it exists.
        extra: More header entries (JSON), the sensor suite and look of the drive for instance.
    """

    def __init__(self, path: Path, extra: dict[str, Any] | None = None) -> None:
        self._path = path
        self._extra = extra or {}
        self._pending: list[Snapshot] = []
        self._actors = 0

    def start(self, simulation: Simulation) -> None:
        """Opens the file and writes the header."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("wb")
        self._file.write(MAGIC)
        self._section(b"HEAD", _json({"schema": LOG_SCHEMA, **simulation.header(), **self._extra}))

    def observe(self, snapshot: Snapshot) -> str | None:
        """Keeps a tick; never ends the drive."""
        self._pending.append(snapshot)
        if len(self._pending) == BLOCK_TICKS:
            self._flush()
        return None

    def finish(self, result: EpisodeResult) -> None:
        """Writes what is left and how the drive ended."""
        self._flush()
        self._section(b"DONE", _json(result.summary()))
        self._file.close()

    def _flush(self) -> None:
        if not self._pending:
            return
        table = self._pending[-1].table
        fresh = [table.row(row) for row in range(self._actors, len(table.ids))]
        if fresh:
            self._section(b"ACTR", _json(fresh))
            self._actors = len(table.ids)
        self._section(b"TICK", encode_block(self._pending))
        self._pending = []

    def _section(self, tag: bytes, payload: bytes) -> None:
        self._file.write(SECTION.pack(tag, len(payload), zlib.crc32(payload)) + payload)
        self._file.flush()


def _json(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
