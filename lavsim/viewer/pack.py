"""Arrays of whole numbers as compressed text inside a page.

Each array is differenced along its groups (once for what moves, twice for what moves smoothly), its numbers are folded
to non-negative ones and split into planes of bytes, lowest first; planes of nothing but zeros are left out. All of it
is one deflate stream, `assets/decode.js` the other side.
"""

from __future__ import annotations

import base64
import json
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL = 6  # of deflate; 9 takes four times as long for a hundredth less


class Pack:
    """Collects arrays and what describes them."""

    def __init__(self) -> None:
        self._entries: dict[str, dict[str, Any]] = {}
        self._body: list[bytes] = []
        self._size = 0

    def add(self, name: str, values: ArrayLike, order: int = 0, groups: str | None = None) -> None:
        """Adds an array, flattened.

        Args:
            name: Its key in the page.
            values: Whole numbers that fit 32 bits, differences included.
            order: How often neighbours are subtracted from each other, 0 to 2.
            groups: Name of an array added before with the lengths of the pieces that are differenced each on its own.
        """
        flat = np.asarray(values).reshape(-1).astype(np.int64)
        starts = np.zeros(1, np.int64)
        if groups is not None:
            lengths = self._entries[groups]["_values"]
            starts = (np.cumsum(lengths) - lengths)[lengths > 0]
        differences = flat
        for _ in range(order):
            differences = _differences(differences, starts)
        planes = _planes(differences)
        entry = {"offset": self._size, "count": len(flat), "planes": len(planes), "order": order, "_values": flat}
        self._entries[name] = entry | ({"groups": groups} if groups is not None else {})
        for plane in planes:
            self._body.append(plane.tobytes())
            self._size += len(plane)

    def add_bytes(self, name: str, content: bytes) -> None:
        """Adds raw bytes."""
        self._entries[name] = {"offset": self._size, "count": len(content), "raw": True}
        self._body.append(content)
        self._size += len(content)

    def encode(self, meta: dict[str, Any]) -> str:
        """Everything as base64 text; `meta` (JSON) goes along."""
        arrays = {name: {k: v for k, v in e.items() if k != "_values"} for name, e in self._entries.items()}
        header = json.dumps({"meta": meta, "arrays": arrays}, separators=(",", ":"), allow_nan=False).encode()
        whole = len(header).to_bytes(4, "little") + header + b"".join(self._body)
        return base64.b64encode(zlib.compress(whole, LEVEL)).decode()


def unpack(text: str) -> tuple[dict[str, Any], dict[str, NDArray[np.int64] | bytes]]:
    """What `Pack.encode` made: the meta data and the arrays, for tests and tools."""
    whole = zlib.decompress(base64.b64decode(text))
    size = int.from_bytes(whole[:4], "little")
    header = json.loads(whole[4 : 4 + size])
    body = np.frombuffer(whole, np.uint8, offset=4 + size)
    found: dict[str, NDArray[np.int64] | bytes] = {}
    for name, entry in header["arrays"].items():
        at, count = entry["offset"], entry["count"]
        if entry.get("raw"):
            found[name] = body[at : at + count].tobytes()
            continue
        folded = np.zeros(count, np.int64)
        for plane in range(entry["planes"]):
            folded |= body[at + plane * count : at + (plane + 1) * count].astype(np.int64) << (8 * plane)
        values = (folded >> 1) ^ -(folded & 1)
        lengths = found[entry["groups"]] if "groups" in entry else np.array([count])
        assert not isinstance(lengths, bytes)
        for _ in range(entry["order"]):
            values = _sums(values, lengths)
        found[name] = values
    return header["meta"], found


def _differences(values: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    result = values.copy()
    result[1:] -= values[:-1]
    if len(values):
        result[starts] = values[starts]
    return result


def _sums(values: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    total = np.cumsum(values)
    starts = np.cumsum(lengths, dtype=np.int64) - lengths
    before = np.concatenate([[0], total])[starts]
    return total - np.repeat(before, lengths)


def _planes(values: NDArray[np.int64]) -> list[NDArray[np.uint8]]:
    folded = np.where(values < 0, -2 * values - 1, 2 * values)
    if len(folded) and int(folded.max()) >= 2**32:
        raise ValueError("a number does not fit 32 bits")
    planes = []
    while len(folded) and folded.any():
        planes.append((folded & 255).astype(np.uint8))
        folded = folded >> 8
    return planes
