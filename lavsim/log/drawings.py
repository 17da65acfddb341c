"""The side file with an agent's drawings: `*.lavdraw` beside the log, written on request and never part of it.

File: `MAGIC`, then blocks of (length, CRC-32, payload); a payload is zstd over a message (`lavsim.messages`) with some
ticks' drawings. A file cut anywhere is readable up to its last whole block.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zstandard

from lavsim.drawings import Drawing, checked_all
from lavsim.errors import ConfigError, LogError
from lavsim.messages import MessageError, pack, unpack
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.simulation import Simulation

MAGIC = b"LAVDRAW\x01"
SUFFIX = ".lavdraw"
_BLOCK = struct.Struct("<II")
_HEAD = struct.Struct("<I")
_TICKS = 40  # of a block
_LARGEST = 2**28  # [bytes] of a block's content


class DrawingsWriter:
    """Observer that keeps what the agent shows at every tick.

    Args:
        path: The file, replaced if it exists.
        source: Gives the drawings of the step just made.
    """

    def __init__(self, path: Path, source: Callable[[], dict[str, Drawing]]) -> None:
        self._path, self._source = path, source
        self._pending: list[tuple[int, dict[str, Drawing]]] = []

    def start(self, simulation: Simulation) -> None:
        """Opens the file."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("wb")
        self._file.write(MAGIC)

    def observe(self, snapshot: Snapshot) -> str | None:
        """Keeps the drawings of a tick; never ends the drive."""
        drawings = self._source()
        if drawings:
            self._pending.append((snapshot.tick, drawings))
        if len(self._pending) == _TICKS:
            self._flush()
        return None

    def finish(self, result: EpisodeResult) -> None:
        """Writes what is left."""
        self._flush()
        self._file.close()

    def _flush(self) -> None:
        if not self._pending:
            return
        header, buffers, size = pack(self._pending)
        body = bytearray(size)
        at = 0
        for data in buffers:
            body[at : at + data.nbytes] = data
            at += -(-data.nbytes // 64) * 64
        payload = zstandard.ZstdCompressor(level=3).compress(_HEAD.pack(len(header)) + header + bytes(body))
        self._file.write(_BLOCK.pack(len(payload), zlib.crc32(payload)) + payload)
        self._file.flush()
        self._pending = []


def read_drawings(path: Path) -> Iterator[tuple[int, dict[str, Drawing]]]:
    """Tick and drawings by name, in order; ends where the file is cut.

    Raises:
        LogError: no such file, not a side file, or a damaged block.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise LogError(f"{path.name}: {error.strerror or error}.") from None
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError(f"{path.name} holds no drawings (*{SUFFIX}): its first bytes are not theirs.")
        while len(head := file.read(_BLOCK.size)) == _BLOCK.size:
            length, crc = _BLOCK.unpack(head)
            payload = file.read(length)
            if len(payload) < length:
                return
            if zlib.crc32(payload) != crc:
                raise LogError(f"{path.name}: a block is damaged (checksum differs).")
            yield from _ticks(path, payload)


def _ticks(path: Path, payload: bytes) -> Iterator[tuple[int, dict[str, Drawing]]]:
    try:
        content = zstandard.ZstdDecompressor().decompress(payload, max_output_size=_LARGEST)
        size = _HEAD.unpack_from(content)[0]
        entries: Any = unpack(content[_HEAD.size : _HEAD.size + size], content[_HEAD.size + size :])
        for tick, drawings in entries:
            yield int(tick), checked_all(drawings)
    except (MessageError, ConfigError, zstandard.ZstdError, struct.error, TypeError, ValueError) as error:
        raise LogError(f"{path.name}: a block can't be read: {error}") from None
