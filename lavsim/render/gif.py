"""Writes animated GIFs: one table of colours for all pictures, and of each picture only what changed.

OpenCV's own encoder makes files twenty times as large of such pictures.

Source: CompuServe, "Graphics Interchange Format, Version 89a", 1990.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

_COLOURS = 255  # of the table; the last entry stands for "as before"
_SAME = 255
_BITS = 5  # of each channel by which colours are counted
_MOST_SAMPLES = 24  # pictures that are counted
_CODES = 4096  # LZW's table


def encode_gif(images: Sequence[NDArray[np.uint8]], rate: float) -> bytes:
    """The file, playing for ever.

    Args:
        images: (H, W, 3) blue, green, red, all of one size.
        rate: Pictures a second, to a hundredth of a second each.
    """
    height, width = images[0].shape[:2]
    palette, index_of = _palette(images)
    delay = max(2, round(100.0 / rate))
    parts = [b"GIF89a", struct.pack("<HHBBB", width, height, 0xF7, 0, 0), palette.tobytes()]
    parts.append(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")
    before: NDArray[np.uint8] | None = None
    for image in images:
        numbers = index_of[_bins(image)]
        parts += _frame(numbers, before, delay)
        before = numbers
    parts.append(b"\x3b")
    return b"".join(parts)


def _bins(image: NDArray[np.uint8]) -> NDArray[np.int64]:
    high = image.astype(np.int64) >> (8 - _BITS)
    return (high[..., 2] << (2 * _BITS)) | (high[..., 1] << _BITS) | high[..., 0]


def _palette(images: Sequence[NDArray[np.uint8]]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The table (256, 3) red, green, blue of the commonest colours, and each bin's nearest entry."""
    step = -(-len(images) // _MOST_SAMPLES)
    pixels = np.concatenate([image.reshape(-1, 3) for image in images[::step]])
    bins = _bins(pixels)
    size = 1 << (3 * _BITS)
    count = np.bincount(bins, minlength=size)
    sums = np.stack([np.bincount(bins, pixels[:, channel], size) for channel in (2, 1, 0)], axis=1)
    common = np.argsort(-count, kind="stable")[:_COLOURS]
    common = common[count[common] > 0]
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(common)] = np.rint(sums[common] / count[common, None])
    axis = (np.arange(1 << _BITS) << (8 - _BITS)) + (1 << (7 - _BITS))
    centres = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    table = palette[: len(common)].astype(np.float32)
    distance = (table**2).sum(axis=1) - 2.0 * centres @ table.T
    nearest = np.argmin(distance, axis=1).astype(np.uint8)
    nearest[common] = np.arange(len(common))
    return palette, nearest


def _frame(numbers: NDArray[np.uint8], before: NDArray[np.uint8] | None, delay: int) -> list[bytes]:
    """The blocks of one picture: the box that changed, and in it what stayed as transparent."""
    height, width = numbers.shape
    top, bottom, left, right = 0, height, 0, width
    shown = numbers
    if before is not None:
        changed = numbers != before
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        top, bottom = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 1)
        left, right = (int(columns[0]), int(columns[-1]) + 1) if len(columns) else (0, 1)
        shown = np.where(changed, numbers, np.uint8(_SAME))[top:bottom, left:right]
    control = b"\x21\xf9\x04" + struct.pack("<BHB", 0x05, delay, _SAME) + b"\x00"
    place = b"\x2c" + struct.pack("<HHHHB", left, top, right - left, bottom - top, 0)
    data = _compress(np.ascontiguousarray(shown).reshape(-1)).tobytes()
    pieces = [data[k : k + 255] for k in range(0, len(data), 255)]
    return [control, place, b"\x08", *(bytes([len(piece)]) + piece for piece in pieces), b"\x00"]


@kernel
def _compress(pixels):  # type: ignore[no-untyped-def]
    """LZW with codes of 9 to 12 bits, lowest bit first."""
    out = np.empty(len(pixels) * 2 + 16, np.uint8)
    child = np.zeros((_CODES, 256), np.uint16)
    clear, size, next_code = 256, 9, 258
    at, bits = 0, 9
    held = np.int64(clear)  # the first code clears the table
    prefix = np.int64(pixels[0])
    for k in range(1, len(pixels) + 1):
        is_end = k == len(pixels)
        value = 0 if is_end else pixels[k]
        if not is_end and child[prefix, value] > 0:
            prefix = np.int64(child[prefix, value])
            continue
        held |= prefix << bits
        bits += size
        while bits >= 8:
            out[at] = held & 255
            at, held, bits = at + 1, held >> 8, bits - 8
        if is_end:
            break
        if next_code < _CODES:
            child[prefix, value] = next_code
            if next_code == (1 << size):
                size += 1
            next_code += 1
        else:
            held |= clear << bits
            bits += size
            child[:] = 0
            size, next_code = 9, 258
        prefix = np.int64(value)
    held |= 257 << bits
    bits += size
    while bits > 0:
        out[at] = held & 255
        at, held, bits = at + 1, held >> 8, bits - 8
    return out[:at]
