"""Blocks of ticks as bytes: what prediction does not explain, a symbol or two per actor and tick, zstd.

A block is read without any other block, given the actor table and where each actor started. Actors that keep still for
a whole block cost a bit. For the others a tick is two symbols of one byte each while every residual
(`lavsim.log.predict`) is -1, 0 or 1: one for yaw, vx, vy, x, y and one for the rest. Otherwise the symbol says so and
the residuals follow apart. The symbols of an actor lie together in time. 113 moving cars among 151 take 74 bytes a
tick so, where second differences take 114; packing takes 30 µs a tick.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from lavsim.errors import LogError
from lavsim.kernel import kernel
from lavsim.log.predict import (
    CHANNELS,
    MOTION,
    POSE,
    REST,
    STATE,
    VELOCITY,
    axles,
    find_changes,
    residuals_of,
    restore_values,
)
from lavsim.types import ActorClass
from lavsim.world.snapshot import CONTACT_DTYPE, HAZARD_DTYPE, ActorTable, Snapshot

BLOCK_TICKS = 200  # 10 s: what a kill loses at most; 100 cost 17 % more bytes, 400 save 11 %
_LEVEL = 9
_EGO_WORDS = 11  # motion 6, control 5
_WEATHER_WORDS = 10
_DIGITS = 5  # residuals that a symbol has room for: 3^5 = 243 symbols
_SURPRISE = 255  # the symbol of a tick whose residuals follow apart
_OF_ROWS = ("rows", "pose", "velocity", "state", "xyz", "yaw", "velocities", "speeds", "sizes", "is_vehicle",
            "is_background")  # fmt: skip
_OF_TICKS = ("ego_motion", "control", "lights", "weather_values")
_HEAD = struct.Struct("<HHB")  # rows, lights, whether angles and gait run in circles


@dataclass(frozen=True)
class Block:
    """Consecutive ticks of one drive, as arrays over time.

    Attributes:
        first: Number of the first tick.
        rows: (R,) rows of the actor table that occur, ascending.
        present: (T, R) when each of them was there.
        values: (T, R, CHANNELS) pose, velocity, state; meaningless where absent.
        ego: (T, 11) float32 `Snapshot.ego_motion` and `Snapshot.control`.
        weather: (T, 10) float32.
        lights: (T, L) uint8.
        status: (T,) uint8 `Snapshot.agent_status`.
        contacts: (C,) of all ticks, and `contact_ends` (T,) where those of each tick end.
        hazards: (H,) likewise with `hazard_ends`.
    """

    first: int
    rows: NDArray[np.int32]
    present: NDArray[np.bool_]
    values: NDArray[np.int32]
    ego: NDArray[np.float32]
    weather: NDArray[np.float32]
    lights: NDArray[np.uint8]
    status: NDArray[np.uint8]
    contacts: NDArray[np.void]
    contact_ends: NDArray[np.int64]
    hazards: NDArray[np.void]
    hazard_ends: NDArray[np.int64]

    @staticmethod
    def of(snapshots: Sequence[Snapshot]) -> Block:
        """The block of consecutive snapshots."""
        ticks = len(snapshots)
        seen = np.concatenate([s.rows for s in snapshots])
        occurs = np.zeros(seen.max() + 1, dtype=bool)
        occurs[seen] = True
        rows = np.flatnonzero(occurs).astype(np.int32)
        present = np.ones((ticks, len(rows)), dtype=bool)
        values = np.zeros((ticks, len(rows), CHANNELS), dtype=np.int32)
        where: Any = slice(None)
        if len(seen) < present.size:  # somebody came or went
            present[:] = False
            where = np.repeat(np.arange(ticks), [len(s.rows) for s in snapshots]) * len(rows)
            where += (np.cumsum(occurs) - 1)[seen]
            present.reshape(-1)[where] = True
        for channels, part in ((POSE, "pose"), (VELOCITY, "velocity"), (STATE, "state")):
            values.reshape(-1, CHANNELS)[where, channels] = np.concatenate([getattr(s, part) for s in snapshots])
        return Block(
            first=snapshots[0].tick,
            rows=rows,
            present=present,
            values=values,
            ego=np.hstack([np.stack([s.ego_motion for s in snapshots]), np.stack([s.control for s in snapshots])]),
            weather=np.stack([s.weather_values for s in snapshots]),
            lights=np.stack([s.lights for s in snapshots]),
            status=np.array([s.agent_status for s in snapshots], np.uint8),
            contacts=np.concatenate([s.contacts for s in snapshots]),
            contact_ends=np.cumsum([len(s.contacts) for s in snapshots]),
            hazards=np.concatenate([s.hazards for s in snapshots]),
            hazard_ends=np.cumsum([len(s.hazards) for s in snapshots]),
        )

    def __len__(self) -> int:
        return len(self.status)

    def starts(self) -> NDArray[np.int32]:
        """(R, CHANNELS) values of each row when it first occurs."""
        starts: NDArray[np.int32] = self.values[np.argmax(self.present, axis=0), np.arange(len(self.rows))]
        return starts

    def snapshot(self, index: int, table: ActorTable) -> Snapshot:
        """Tick number `index` of the block."""
        here = self.present[index]
        values = self.values[index][here]
        contacts, hazards = (
            items[(ends[index - 1] if index else 0) : ends[index]]
            for items, ends in ((self.contacts, self.contact_ends), (self.hazards, self.hazard_ends))
        )
        return Snapshot(
            tick=self.first + index,
            table=table,
            rows=self.rows[here],
            pose=values[:, POSE].copy(),
            velocity=values[:, VELOCITY].copy(),
            state=values[:, STATE].copy(),
            ego_motion=self.ego[index, :6].copy(),
            control=self.ego[index, 6:].copy(),
            lights=self.lights[index],
            contacts=contacts,
            weather_values=self.weather[index],
            hazards=hazards,
            agent_status=int(self.status[index]),
        )

    def snapshots(self, table: ActorTable) -> Iterator[Snapshot]:
        """All ticks in order.

        Their rows lie one behind the other, so what follows from a row alone is computed for all of them at once; each
        snapshot is handed its part.
        """
        row_ends, values = np.cumsum(np.count_nonzero(self.present, axis=1)), self.values[self.present]
        whole = Snapshot(
            tick=self.first,
            table=table,
            rows=np.broadcast_to(self.rows, self.present.shape)[self.present],
            pose=np.ascontiguousarray(values[:, POSE]),
            velocity=np.ascontiguousarray(values[:, VELOCITY]),
            state=np.ascontiguousarray(values[:, STATE]),
            ego_motion=np.ascontiguousarray(self.ego[:, :6]),
            control=np.ascontiguousarray(self.ego[:, 6:]),
            lights=self.lights,
            contacts=self.contacts,
            weather_values=self.weather,
            hazards=self.hazards,
        )
        of_rows = {name: getattr(whole, name) for name in _OF_ROWS}
        of_ticks = {name: getattr(whole, name) for name in _OF_TICKS}
        row = contact = hazard = 0
        for index, (row_end, contact_end, hazard_end, status) in enumerate(
            zip(row_ends.tolist(), self.contact_ends.tolist(), self.hazard_ends.tolist(), self.status.tolist(),
                strict=True)
        ):  # fmt: skip
            here = slice(row, row_end)
            parts = {name: array[here] for name, array in of_rows.items()}
            for name, array in of_ticks.items():
                parts[name] = array[index]
            parts["tick"], parts["table"], parts["agent_status"] = self.first + index, table, status
            parts["contacts"] = self.contacts[contact:contact_end]
            parts["hazards"] = self.hazards[hazard:hazard_end]
            yield Snapshot.of_parts(parts)
            row, contact, hazard = row_end, contact_end, hazard_end


def encode_block(block: Block, table: ActorTable, starts: NDArray[np.int32]) -> bytes:
    """The bytes of a block.

    Args:
        block: What happened.
        table: Actors of the drive so far.
        starts: (M, CHANNELS) values of each row of `table` that block and reader both know.
    """
    first = block.starts()
    changes, circular = find_changes(block.values, block.present, first)
    moving = np.flatnonzero(changes)
    moved, shown = block.values.take(moving, axis=1), block.present.take(moving, axis=1)
    residuals = residuals_of(moved, shown, _axles_of(table, block.rows[moving]), circular)
    parts = [
        block.rows.astype("<i4").tobytes(),
        np.packbits(changes).tobytes(),
        np.packbits(block.present).tobytes(),
        _planes(_zigzag((first - starts[block.rows]).T)),
        _pack(residuals, MOTION),
        _pack(residuals, REST),
        _planes(_xor(block.ego)),
        _planes(_xor(block.weather)),
        _difference(block.lights).tobytes(),
        np.diff(block.contact_ends, prepend=0).astype("<u2").tobytes(),
        np.diff(block.hazard_ends, prepend=0).astype("<u2").tobytes(),
        block.status.tobytes(),
        block.contacts.tobytes(),
        block.hazards.tobytes(),
    ]
    packed = zstandard.ZstdCompressor(level=_LEVEL).compress(b"".join(parts))
    return _HEAD.pack(len(block.rows), block.lights.shape[1], circular) + packed


def decode_block(payload: bytes, first: int, ticks: int, table: ActorTable, starts: NDArray[np.int32]) -> Block:
    """The block of `ticks` ticks from `first` on whose bytes these are.

    Args:
        payload: From `encode_block`.
        first: Number of the first tick.
        ticks: How many.
        table: As for `encode_block`; later rows do no harm.
        starts: Likewise.

    Raises:
        LogError: the bytes are not those of a block.
    """
    try:
        row_count, light_count, circular = _HEAD.unpack_from(payload)
        take = _Cursor(zstandard.ZstdDecompressor().decompress(payload[_HEAD.size :]))
        rows = take.array("<i4", row_count)
        changes = take.bits(row_count)
        present = take.bits(ticks * row_count).reshape(ticks, row_count)
        begin = _unzigzag(take.planes((CHANNELS, row_count))).T + starts[rows]
        moving = np.flatnonzero(changes)
        residuals = np.zeros((len(moving), ticks, CHANNELS), dtype=np.int32)
        _unpack(take, residuals, MOTION)
        _unpack(take, residuals, REST)
        values = np.repeat(begin[None], ticks, axis=0)
        moved, shown = values.take(moving, axis=1), present.take(moving, axis=1)
        restore_values(moved, shown, _axles_of(table, rows[moving]), bool(circular), residuals)
        values[:, moving] = moved
        ego = np.bitwise_xor.accumulate(take.planes((_EGO_WORDS, ticks)).T, axis=0).view("<f4")
        weather = np.bitwise_xor.accumulate(take.planes((_WEATHER_WORDS, ticks)).T, axis=0).view("<f4")
        lights = np.cumsum(take.array("u1", ticks * light_count).reshape(ticks, light_count), axis=0, dtype=np.uint8)
        contact_ends, hazard_ends = (np.cumsum(take.array("<u2", ticks), dtype=np.int64) for _ in range(2))
        status = take.array("u1", ticks)
        contacts = take.array(CONTACT_DTYPE, int(contact_ends[-1]))
        hazards = take.array(HAZARD_DTYPE, int(hazard_ends[-1]))
    except (struct.error, zstandard.ZstdError, ValueError, IndexError) as error:
        raise LogError(f"not one this version can read: {error}.") from None
    return Block(
        first, rows, present, values, ego, weather, lights, status, contacts, contact_ends, hazards, hazard_ends
    )


def _axles_of(table: ActorTable, rows: NDArray[np.int32]) -> NDArray[np.int64]:
    return axles(table.sizes[rows], table.classes[rows] <= ActorClass.BICYCLE)


class _Cursor:
    """Reads arrays one after another."""

    def __init__(self, body: bytes) -> None:
        self._body, self._at = body, 0

    def array(self, dtype: np.dtype | str, count: int) -> NDArray:
        values = np.frombuffer(self._body, dtype, count, self._at)
        self._at += values.nbytes
        return values

    def bits(self, count: int) -> NDArray[np.bool_]:
        return np.unpackbits(self.array("u1", -(-count // 8)), count=count).astype(bool)

    def planes(self, shape: tuple[int, ...]) -> NDArray[np.uint32]:
        count = int(np.prod(shape))
        planes = self.array("u1", 4 * count).reshape(4, count)
        return np.ascontiguousarray(planes.T).view("<u4").reshape(shape)


def _pack(residuals: NDArray[np.int32], channels: Sequence[int]) -> bytes:
    """A symbol per row and tick, and the residuals of those that it has no room for.

    The symbol counts in threes over the first five channels; others, which seldom change, have to be zero.
    """
    chosen = np.stack([residuals[..., channel] for channel in channels])
    digits = chosen[:_DIGITS]
    small = (digits >= -1) & (digits <= 1)  # not by np.abs, which leaves the smallest integer negative
    fits = np.all(small, axis=0) & np.all(chosen[_DIGITS:] == 0, axis=0)
    weights = 3 ** np.arange(len(digits), dtype=np.int32)
    symbols = np.where(fits, np.tensordot(weights, digits, 1) % 3**_DIGITS, _SURPRISE)
    return symbols.astype(np.uint8).tobytes() + _planes(_zigzag(chosen[:, ~fits]))


def _unpack(take: _Cursor, residuals: NDArray[np.int32], channels: tuple[int, ...]) -> None:
    """Inverse of `_pack`; fills the channels."""
    symbols = take.array("u1", residuals.shape[0] * residuals.shape[1]).reshape(residuals.shape[:2])
    surprises = _unzigzag(take.planes((len(channels), int(np.count_nonzero(symbols == _SURPRISE)))))
    _fill(symbols, surprises, channels, _DIGIT_OF, residuals)


@kernel
def _fill(
    symbols: NDArray[np.uint8], surprises: NDArray[np.int32], channels: tuple[int, ...], digits: NDArray[np.int32],
    residuals: NDArray[np.int32],
) -> None:  # fmt: skip
    """Sets `channels` of `residuals` by the digits of each symbol, or by the next of the surprises."""
    rows, ticks = symbols.shape
    told = 0
    for r in range(rows):
        for t in range(ticks):
            symbol = symbols[r, t]
            if symbol == _SURPRISE:
                for k in range(len(channels)):
                    residuals[r, t, channels[k]] = surprises[k, told]
                told += 1
            else:
                for k in range(min(len(channels), _DIGITS)):
                    residuals[r, t, channels[k]] = digits[k, symbol]


def _digit_table() -> NDArray[np.int32]:
    """(_DIGITS, 256) the digits -1, 0, 1 of each symbol, lowest first; zeros for the surprise."""
    table = np.zeros((_DIGITS, 256), dtype=np.int32)
    for digits in itertools.product((-1, 0, 1), repeat=_DIGITS):
        table[:, sum(digit * 3**place for place, digit in enumerate(digits)) % 3**_DIGITS] = digits
    return table


_DIGIT_OF = _digit_table()


def _difference(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """First differences along time, modulo the type's range; the first row stays."""
    result = values.copy()
    result[1:] -= values[:-1]
    return result


def _xor(values: NDArray[np.float32]) -> NDArray[np.uint32]:
    """(N, T) words of (T, N) numbers with the bits that changed since the last tick."""
    words = np.ascontiguousarray(values, "<f4").view("<u4")
    result = words.copy()
    result[1:] ^= words[:-1]
    return result.T


def _zigzag(values: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Small magnitudes as small words: 0, -1, 1, -2 … become 0, 1, 2, 3 …"""
    return ((values << 1) ^ (values >> 31)).astype("<u4")


def _unzigzag(words: NDArray[np.uint32]) -> NDArray[np.int32]:
    return (words >> np.uint32(1)).astype(np.int32) ^ -(words & np.uint32(1)).astype(np.int32)


def _planes(words: NDArray[np.uint32]) -> bytes:
    """Lowest bytes of all words, then the second, third and highest ones; words of one channel stay together."""
    flat = np.ascontiguousarray(words).reshape(-1, 1)
    return np.ascontiguousarray(flat.view("u1").T).tobytes()
