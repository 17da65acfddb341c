"""Reads a recorded drive, whole or cut short."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.errors import LogError
from lavsim.log.codec import decode_block
from lavsim.log.writer import LOG_SCHEMA, MAGIC, SECTION
from lavsim.world.snapshot import ActorTable, Snapshot

_BLOCK_HEAD = struct.Struct("<IH")  # first tick, ticks


@dataclass(frozen=True)
class _Block:
    offset: int
    length: int
    crc: int
    first: int
    ticks: int


class LogReader:
    """A drive on disk as a sequence of snapshots.

    Args:
        path: A `*.lavlog` file.

    Attributes:
        header: What was driven: town, route, seed, rules and so on.
        status: How the drive ended; None when the file was cut short.

    Raises:
        LogError: no such file, not a log, or a log of a newer schema.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header: dict[str, Any] = {}
        self.status: dict[str, Any] | None = None
        self._blocks: list[_Block] = []
        self._table = ActorTable.empty()
        self._cached: tuple[int, list[Snapshot]] = (-1, [])
        self._scan()

    @property
    def town_name(self) -> str:
        return str(self.header["town"])

    @property
    def table(self) -> ActorTable:
        """All actors of the drive."""
        return self._table

    def __len__(self) -> int:
        return sum(block.ticks for block in self._blocks)

    def __getitem__(self, index: int) -> Snapshot:
        """Snapshot number `index` of the file; negative numbers count from the end.

        Raises:
            IndexError: beyond the end.
            LogError: its block is damaged.
        """
        index = index + len(self) if index < 0 else index
        for number, block in enumerate(self._blocks):
            if 0 <= index < block.ticks:
                return self._read(number)[index]
            index -= block.ticks
        raise IndexError(f"{self.path.name} holds {len(self)} ticks")

    def __iter__(self) -> Iterator[Snapshot]:
        for number in range(len(self._blocks)):
            yield from self._read(number)

    def _read(self, number: int) -> list[Snapshot]:
        if self._cached[0] != number:
            block = self._blocks[number]
            with self.path.open("rb") as file:
                file.seek(block.offset)
                payload = file.read(block.length)
            if zlib.crc32(payload) != block.crc:
                raise LogError(f"{self.path.name}: the block at tick {block.first} is damaged (checksum differs).")
            self._cached = (number, decode_block(payload, self._table))
        return self._cached[1]

    def _scan(self) -> None:
        """Finds all whole sections; what follows a cut is left out."""
        try:
            size = os.path.getsize(self.path)
            file = self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path.name}: {error.strerror or error}.") from None
        with file:
            if file.read(len(MAGIC)) != MAGIC:
                raise LogError(f"{self.path.name} is no recorded drive (*.lavlog): its first bytes are not a log's.")
            rows: list[dict[str, Any]] = []
            while True:
                head = file.read(SECTION.size)
                if len(head) < SECTION.size:
                    break
                tag, length, crc = SECTION.unpack(head)
                start = file.tell()
                if start + length > size:
                    break
                if tag == b"TICK":
                    first, ticks = _BLOCK_HEAD.unpack(file.read(_BLOCK_HEAD.size))
                    self._blocks.append(_Block(start, length, crc, first, ticks))
                else:
                    self._meta(tag, file.read(length), crc, rows)
                file.seek(start + length)
        self._table = ActorTable.empty().extended(rows)
        if not self.header:
            raise LogError(f"{self.path.name} is cut before the end of its header.")

    def _meta(self, tag: bytes, payload: bytes, crc: int, rows: list[dict[str, Any]]) -> None:
        if zlib.crc32(payload) != crc:
            raise LogError(f"{self.path.name}: section {tag.decode(errors='replace')} is damaged (checksum differs).")
        value = json.loads(payload)
        if tag == b"HEAD":
            if value.get("schema") != LOG_SCHEMA:
                raise LogError(f"{self.path.name} has schema {value.get('schema')}; this version reads {LOG_SCHEMA}.")
            self.header = value
        elif tag == b"ACTR":
            rows.extend(value)
        elif tag == b"DONE":
            self.status = value
