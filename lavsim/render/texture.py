"""Numbers that belong to places: grain and patches that stand still in the world, the same in every picture."""

from __future__ import annotations

import numpy as np

from lavsim.kernel import kernel


@kernel
def cell_noise(a, b):  # type: ignore[no-untyped-def]
    """A number in [-1, 1) that belongs to a pair of whole numbers."""
    word = np.uint32(np.uint32(a) * np.uint32(0x9E3779B1)) ^ np.uint32(np.uint32(b) * np.uint32(0x85EBCA77))
    word = np.uint32((word ^ (word >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    word ^= word >> np.uint32(13)
    return np.float32(np.int32(word & np.uint32(0xFFFF))) * np.float32(2.0 / 65536.0) - np.float32(1.0)


@kernel
def smooth_noise(x, y):  # type: ignore[no-untyped-def]
    """A smooth number in [-1, 1) at a place; its cells have side 1."""
    fx, fy = np.floor(x), np.floor(y)
    i, j = int(fx), int(fy)
    u, v = np.float32(x - fx), np.float32(y - fy)
    three, two = np.float32(3.0), np.float32(2.0)
    u, v = u * u * (three - two * u), v * v * (three - two * v)
    a, b = cell_noise(i, j), cell_noise(i + 1, j)
    c, d = cell_noise(i, j + 1), cell_noise(i + 1, j + 1)
    return a + (b - a) * u + (c - a) * v + (a - b - c + d) * u * v
