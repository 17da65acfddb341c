"""Numbers that belong to places: grain and patches that stand still in the world, the same in every picture.

Smooth patches are read from one table, made once: eight bits a sample, 16 samples along a cell, again after 32 cells.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.render.inlined import inlined

_SAMPLES, _CELLS = 16, 32
_SIZE = _SAMPLES * _CELLS
_UNIT = 127.0  # entries of the table for 1
_SCALE, _SHARE = np.float32(_SAMPLES), np.float32(1.0 / _UNIT)


@inlined
def cell_noise(a, b):  # type: ignore[no-untyped-def]
    """A number in [-1, 1) that belongs to a pair of whole numbers."""
    word = np.uint32(np.uint32(a) * np.uint32(0x9E3779B1)) ^ np.uint32(np.uint32(b) * np.uint32(0x85EBCA77))
    word = np.uint32((word ^ (word >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    word ^= word >> np.uint32(13)
    return np.float32(np.int32(word & np.uint32(0xFFFF))) * np.float32(2.0 / 65536.0) - np.float32(1.0)


@kernel
def _smooth_table():  # type: ignore[no-untyped-def]
    table = np.empty((_SIZE, _SIZE), np.int8)
    for row in range(_SIZE):
        for column in range(_SIZE):
            i, j = column // _SAMPLES, row // _SAMPLES
            right, below = (i + 1) % _CELLS, (j + 1) % _CELLS
            u, v = (column % _SAMPLES) / _SAMPLES, (row % _SAMPLES) / _SAMPLES
            u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
            above = cell_noise(i, j) * (1.0 - u) + cell_noise(right, j) * u
            beneath = cell_noise(i, below) * (1.0 - u) + cell_noise(right, below) * u
            table[row, column] = np.int8(np.rint((above * (1.0 - v) + beneath * v) * _UNIT))
    return table


def _hollow_table(smooth: NDArray[np.int8]) -> NDArray[np.int8]:
    finer = (3 * np.arange(_SIZE) + 40) % _SIZE
    return np.rint(0.7 * smooth + 0.3 * smooth[np.ix_(finer, finer)]).astype(np.int8)


SMOOTH: NDArray[np.int8] = _smooth_table()
HOLLOWS: NDArray[np.int8] = _hollow_table(SMOOTH)  # two sizes of patches, where puddles lie


@inlined
def patch_noise(table, x, y):  # type: ignore[no-untyped-def]
    """A number in [-1, 1] at a place of `SMOOTH`, whose cells have side 1; in steps of a sixteenth of a cell."""
    column, row = int(np.floor(x * _SCALE)) & (_SIZE - 1), int(np.floor(y * _SCALE)) & (_SIZE - 1)
    return np.float32(table[row, column]) * _SHARE


@inlined
def smooth_noise(table, x, y):  # type: ignore[no-untyped-def]
    """As `patch_noise`, without steps."""
    x, y = x * _SCALE, y * _SCALE
    fx, fy = np.floor(x), np.floor(y)
    j, i = int(fx) & (_SIZE - 1), int(fy) & (_SIZE - 1)
    right, below = (j + 1) & (_SIZE - 1), (i + 1) & (_SIZE - 1)
    u, v = np.float32(x - fx), np.float32(y - fy)
    a, b = np.float32(table[i, j]), np.float32(table[i, right])
    c, d = np.float32(table[below, j]), np.float32(table[below, right])
    return (a + (b - a) * u + (c - a) * v + (a - b - c + d) * u * v) * _SHARE
