"""Reads a recorded drive, whole or cut short."""

from __future__ import annotations

import json
import os
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import zstandard
from numpy.typing import NDArray

from lavsim.errors import LogError
from lavsim.log.codec import Block, decode_block
from lavsim.log.predict import CHANNELS
from lavsim.log.writer import HEAD_CRC, LOG_SCHEMA, MAGIC, SECTION
from lavsim.world.snapshot import ActorTable, Snapshot

_KEPT = 2  # decoded blocks: sensors that look back step over the border of two


@dataclass(frozen=True)
class _Section:
    """Where a section lies; `offset` is that of its payload."""

    tag: bytes
    offset: int
    length: int
    first: int
    ticks: int
    crc: int


class LogReader:
    """A drive on disk as a sequence of snapshots.

    Args:
        path: A `*.lavlog` file.

    Attributes:
        header: What was driven: town, route, seed, rules and so on.
        status: How the drive ended; None when the file was cut short.

    Raises:
        LogError: no such file, no log, a log of another format, or damaged outside its blocks of ticks.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header: dict[str, Any] = {}
        self.status: dict[str, Any] | None = None
        self._table = ActorTable.empty()
        self._starts = np.zeros((0, CHANNELS), dtype=np.int32)
        self._kept: dict[int, Block] = {}
        self._blocks = self._scan()
        self._ends = np.cumsum([block.ticks for block in self._blocks], dtype=np.int64)

    @property
    def town_name(self) -> str:
        return str(self.header["town"])

    @property
    def table(self) -> ActorTable:
        """All actors of the drive."""
        return self._table

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, index: int) -> Snapshot:
        """Snapshot number `index` of the file; negative numbers count from the end.

        Raises:
            IndexError: beyond the end.
            LogError: its block is damaged.
        """
        index = index + len(self) if index < 0 else index
        if not 0 <= index < len(self):
            raise IndexError(f"{self.path.name} holds {len(self)} ticks")
        number = int(np.searchsorted(self._ends, index, side="right"))
        block = self._block(number)
        return block.snapshot(index - int(self._ends[number]) + len(block), self._table)

    def __iter__(self) -> Iterator[Snapshot]:
        for number in range(len(self._blocks)):
            yield from self._block(number).snapshots(self._table)

    def at_tick(self, tick: int) -> Snapshot:
        """The snapshot of world tick `tick`.

        Raises:
            IndexError: the file does not hold it.
            LogError: its block is damaged.
        """
        number = bisect_right(self._blocks, tick, key=lambda block: block.first) - 1
        if number < 0 or tick >= self._blocks[number].first + self._blocks[number].ticks:
            raise IndexError(f"{self.path.name} holds no tick {tick}")
        return self._block(number).snapshot(tick - self._blocks[number].first, self._table)

    def controls(self) -> NDArray[np.float32]:
        """(T, 5) the ego's control of every tick, as `Snapshot.control`."""
        parts = [self._block(number).ego[:, 6:] for number in range(len(self._blocks))]
        return np.concatenate(parts) if parts else np.zeros((0, 5), np.float32)

    def _block(self, number: int) -> Block:
        if number not in self._kept:
            section = self._blocks[number]
            with self.path.open("rb") as file:
                payload = self._payload(file, section)
            try:
                block = decode_block(payload, section.first, section.ticks, self._table, self._starts)
            except LogError as error:
                raise LogError(f"{self.path.name}: the block at tick {section.first} is {error}") from None
            while len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = block
        return self._kept[number]

    def _payload(self, file: BinaryIO, section: _Section) -> bytes:
        file.seek(section.offset)
        payload = file.read(section.length)
        if zlib.crc32(payload) != section.crc:
            what = f"the block at tick {section.first}" if section.ticks else f"section {section.tag.decode()}"
            raise LogError(f"{self.path.name}: {what} is damaged (checksum differs).")
        return payload

    def _scan(self) -> list[_Section]:
        """Reads all whole sections but the blocks of ticks, which it returns; what follows a cut is left out."""
        try:
            file = self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path.name}: {error.strerror or error}.") from None
        with file:
            self._check_format(file.read(len(MAGIC) + 1))
            sections = list(self._sections(file))
            rows: list[dict[str, Any]] = []
            for section in sections:
                if section.tag == b"HEAD":
                    self.header = json.loads(self._payload(file, section))
                elif section.tag == b"ACTR":
                    rows += json.loads(zstandard.decompress(self._payload(file, section)))
                elif section.tag == b"DONE":
                    self.status = json.loads(self._payload(file, section))
        if not self.header:
            raise LogError(f"{self.path.name} is cut before the end of its header.")
        self._table = self._table.extended(rows)
        self._starts = np.array([row["start"] for row in rows], dtype=np.int32).reshape(-1, CHANNELS)
        return [section for section in sections if section.tag == b"TICK"]

    def _check_format(self, begin: bytes) -> None:
        if len(begin) <= len(MAGIC) or not begin.startswith(MAGIC):
            raise LogError(f"{self.path.name} is no recorded drive (*.lavlog): its first bytes are not a log's.")
        if begin[-1] != LOG_SCHEMA:
            raise LogError(f"{self.path.name} has log format {begin[-1]}; this version of lavsim reads {LOG_SCHEMA}.")

    def _sections(self, file: BinaryIO) -> Iterator[_Section]:
        """Whole sections from where `file` stands; ends at a cut."""
        size = os.fstat(file.fileno()).st_size
        start = file.tell()
        while True:
            file.seek(start)
            head = file.read(SECTION.size + HEAD_CRC.size)
            if len(head) < SECTION.size + HEAD_CRC.size:
                return
            if HEAD_CRC.unpack(head[SECTION.size :]) != (zlib.crc32(head[: SECTION.size]),):
                raise LogError(f"{self.path.name}: the section at byte {start} is damaged (checksum differs).")
            tag, length, first, ticks, crc = SECTION.unpack(head[: SECTION.size])
            section = _Section(tag, start + len(head), length, first, ticks, crc)
            start = section.offset + length
            if start > size:
                return
            yield section
