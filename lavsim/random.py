"""Hashed draws: a number is a function of (seed, stream, id, tick, index), never of what was drawn before.

So seeking in a log, rendering two ticks in five, or adding a sensor or a hazard leaves everybody else's draws as they
were (DESIGN section 4, "Random").
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_TO_UNIT = 2.0**-53
_WORD = 2**64 - 1
_FEW = 16  # words that plain numbers give faster than arrays do
_GRID = 2.0**30  # normal draws are rounded to its inverse: libraries disagree about the last bits of logarithms


def mix(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Finaliser of splitmix64, a bijection of 64-bit words that flips half the bits for one bit changed.

    Source: Steele, Lea & Flood 2014, "Fast splittable pseudorandom number generators".
    """
    with np.errstate(over="ignore"):
        value = (value ^ (value >> np.uint64(30))) * _MIX_1
        value = (value ^ (value >> np.uint64(27))) * _MIX_2
        return value ^ (value >> np.uint64(31))


@dataclass(frozen=True)
class Draws:
    """One stream of draws; `stream` derives others.

    Attributes:
        key: 64-bit state that names the stream.
    """

    key: int

    @staticmethod
    def of_seed(seed: int) -> Draws:
        """The root of all streams of a drive."""
        return Draws(_digest(f"seed:{seed}".encode()))

    def stream(self, name: str, *ids: int) -> Draws:
        """The stream of `name` (and of an actor, sensor or hazard id) below this one."""
        return Draws(_digest(f"{self.key:016x}/{name}/{','.join(map(str, ids))}".encode()))

    def bits(self, tick: int | NDArray[np.int64], count: int | NDArray[np.int64]) -> NDArray[np.uint64]:
        """Raw words for indices 0 … count-1 (or the given indices) at `tick` (uint64)."""
        if isinstance(tick, int) and isinstance(count, int) and count <= _FEW:
            return np.array(self._words(tick, range(count)), dtype=np.uint64)
        index = (
            np.arange(count, dtype=np.uint64) if isinstance(count, int | np.integer) else np.asarray(count, np.uint64)
        )
        with np.errstate(over="ignore"):
            base = mix(np.asarray(tick, dtype=np.int64).astype(np.uint64) * _GOLDEN + np.uint64(self.key))
            return mix(base + (index + np.uint64(1)) * _GOLDEN)

    def uniform(self, tick: int, count: int, low: float = 0.0, high: float = 1.0) -> NDArray[np.float64]:
        """`(count,)` numbers in [low, high)."""
        return low + (high - low) * ((self.bits(tick, count) >> np.uint64(11)).astype(np.float64) * _TO_UNIT)

    def normal(self, tick: int, count: int, mean: float = 0.0, std: float = 1.0) -> NDArray[np.float64]:
        """`(count,)` Gaussian numbers (Box-Muller on two words each)."""
        unit = self.uniform(tick, 2 * count)
        radius = np.sqrt(-2.0 * np.log1p(-unit[:count]))
        return mean + std * (np.rint(radius * np.cos(2.0 * np.pi * unit[count:]) * _GRID) / _GRID)

    def integer(self, tick: int, high: int, index: int = 0) -> int:
        """One number in 0 … high-1."""
        return self._words(tick, (index,))[0] % high

    def permutation(self, tick: int, count: int) -> NDArray[np.int64]:
        """The numbers 0 … count-1 in a drawn order."""
        return np.argsort(self.bits(tick, count), kind="stable")

    def _words(self, tick: int, indices: Iterable[int]) -> list[int]:
        """Words with these indices at `tick`."""
        base = _mix_word(int(tick) * _GOLDEN_WORD + self.key)
        return [_mix_word(base + (index + 1) * _GOLDEN_WORD) for index in indices]


_GOLDEN_WORD, _MIX_1_WORD, _MIX_2_WORD = int(_GOLDEN), int(_MIX_1), int(_MIX_2)


def _mix_word(value: int) -> int:
    """`mix` of one word."""
    value &= _WORD
    value = ((value ^ (value >> 30)) * _MIX_1_WORD) & _WORD
    value = ((value ^ (value >> 27)) * _MIX_2_WORD) & _WORD
    return value ^ (value >> 31)


def _digest(text: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little")
