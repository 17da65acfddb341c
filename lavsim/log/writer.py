"""Writes a drive to disk while it happens.

File: `MAGIC`, the number of the format, then sections: a head (tag, payload length, first tick, ticks, CRC-32 of the
payload, CRC-32 of the head), then the payload. `HEAD` (JSON), `ACTR` (new rows of the actor table, packed JSON), `TICK`
(a block of ticks), `DONE` (how it ended, JSON). Sections are only ever appended, so a file cut anywhere is readable up
to its last whole section. Nothing in it depends on the clock or on where it lies.
"""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zstandard

from lavsim.log.codec import BLOCK_TICKS, Block, encode_block
from lavsim.log.predict import CHANNELS
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.simulation import Simulation

MAGIC = b"LAVLOG\x00"
LOG_SCHEMA = 2
SECTION = struct.Struct("<4sIIHI")
HEAD_CRC = struct.Struct("<I")


class LogWriter:
    """Observer that keeps every tick.

    Args:
        path: The file, `*.lavlog`; replaced if it exists.
        extra: More header entries (JSON), the sensor suite and look of the drive for instance.
        block_ticks: Ticks that are packed together, and lost together when the process is killed.
    """

    def __init__(self, path: Path, extra: dict[str, Any] | None = None, block_ticks: int = BLOCK_TICKS) -> None:
        self._path = path
        self._extra = extra or {}
        self._block_ticks = block_ticks
        self._pending: list[Snapshot] = []
        self._starts = np.zeros((0, CHANNELS), dtype=np.int32)

    def start(self, simulation: Simulation) -> None:
        """Opens the file and writes the header."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("wb")
        self._file.write(MAGIC + bytes([LOG_SCHEMA]))
        self._section(b"HEAD", _json({"schema": LOG_SCHEMA, **simulation.header(), **self._extra}))

    def observe(self, snapshot: Snapshot) -> str | None:
        """Keeps a tick; never ends the drive."""
        self._pending.append(snapshot)
        if len(self._pending) == self._block_ticks:
            self._flush()
        return None

    def finish(self, result: EpisodeResult) -> None:
        """Writes what is left and how the drive ended."""
        self._flush()
        self._section(b"DONE", _json(result.summary()))
        self.close()

    def close(self) -> None:
        """Closes the file as it is, without how the drive ended; may be called twice."""
        self._file.close()

    def _flush(self) -> None:
        if not self._pending:
            return
        table, block = self._pending[-1].table, Block.of(self._pending)
        known = len(self._starts)
        if known < len(table.ids):
            fresh = np.zeros((len(table.ids) - known, CHANNELS), dtype=np.int32)
            is_fresh = block.rows >= known
            fresh[block.rows[is_fresh] - known] = block.starts()[is_fresh]
            self._starts = np.concatenate([self._starts, fresh])
            rows = [{**table.row(known + k), "start": start.tolist()} for k, start in enumerate(fresh)]
            self._section(b"ACTR", zstandard.compress(_json(rows)))
        self._section(b"TICK", encode_block(block, table, self._starts), block.first, len(block))
        self._pending = []

    def _section(self, tag: bytes, payload: bytes, first: int = 0, ticks: int = 0) -> None:
        head = SECTION.pack(tag, len(payload), first, ticks, zlib.crc32(payload))
        self._file.write(head + HEAD_CRC.pack(zlib.crc32(head)) + payload)
        self._file.flush()


def _json(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
