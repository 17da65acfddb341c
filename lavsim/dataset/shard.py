"""The encoded sensor readings of an episode: a plain tar file, and beside it where each member lies.

Members are named as WebDataset names them, "000123.lidar.bin": number of the frame, field, suffix of the codec. The
index is an array in NumPy's NPY format, a row a frame and a column a field, of `INDEX_DTYPE`.
"""

from __future__ import annotations

import os
import tarfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.files import FileFacts, PartialFile
from lavsim.errors import DatasetError

INDEX_DTYPE = np.dtype([("offset", "<u8"), ("size", "<u4"), ("crc", "<u4")])  # [bytes]; CRC-32 of the member
_BLOCK = 512  # [bytes] of a tar file
_NAME, _SIZE, _SUM = slice(0, 6), slice(124, 135), slice(148, 154)  # where a tar header has what differs
_DIGITS = 6  # of a frame's number


class ShardWriter:
    """Appends frames to a shard.

    Args:
        tar: The shard.
        index: Its index.
        members: Names of the members of each frame, without the frame's number: "lidar.bin".
    """

    def __init__(self, tar: Path, index: Path, members: Sequence[str]) -> None:
        self._file = PartialFile(tar)
        self._index_path = index
        self._headers = [_header(member) for member in members]
        self._rows: list[list[tuple[int, int, int]]] = []

    def add(self, blobs: Sequence[bytes]) -> None:
        """Appends a frame, its blobs in the order of the members."""
        number = b"%0*d" % (_DIGITS, len(self._rows))
        row = []
        for (header, base), blob in zip(self._headers, blobs, strict=True):
            self._file.write(_filled(header, base, number, len(blob)))
            row.append((self._file.size, len(blob), zlib.crc32(blob)))
            self._file.write(blob + bytes(-len(blob) % _BLOCK))
        self._rows.append(row)

    def finish(self) -> tuple[FileFacts, FileFacts]:
        """Puts shard and index on disk; says what they are."""
        self._file.write(bytes(2 * _BLOCK))
        shard = self._file.finish()
        index = PartialFile(self._index_path)
        try:
            index.write(_npy(np.array(self._rows, dtype=INDEX_DTYPE).reshape(len(self._rows), len(self._headers))))
            return shard, index.finish()
        except BaseException:
            index.abandon()
            raise

    def abandon(self) -> None:
        """Removes what was written."""
        self._file.abandon()


class ShardReader:
    """Members of a finished shard, in any order.

    Args:
        tar: The shard.
        index: Its index.
        members: As for `ShardWriter`.

    Raises:
        DatasetError: a file is missing, or the index is damaged or has other members.
    """

    def __init__(self, tar: Path, index: Path, members: Sequence[str]) -> None:
        self.path = tar
        self._column = {member: number for number, member in enumerate(members)}
        self.index = _read_index(index, len(members))
        try:
            self._handle = os.open(tar, os.O_RDONLY)
        except OSError as error:
            raise DatasetError(f"{tar.name}: {error.strerror or error}.") from None

    def __len__(self) -> int:
        return len(self.index)

    def read(self, frame: int, member: str) -> bytes:
        """The bytes of a member.

        Raises:
            DatasetError: it is cut short or damaged.
        """
        place = self.index[frame, self._column[member]]
        size = int(place["size"])
        data = os.pread(self._handle, size, int(place["offset"]))
        if len(data) != size or zlib.crc32(data) != place["crc"]:
            what = "cut short" if len(data) != size else "damaged (checksum differs)"
            raise DatasetError(f"{self.path.name}: {frame:0{_DIGITS}d}.{member} is {what}.")
        return data

    def close(self) -> None:
        """Closes the file; may be called twice."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def __del__(self) -> None:
        if hasattr(self, "_handle"):
            self.close()


def _read_index(path: Path, members: int) -> NDArray[np.void]:
    try:
        with path.open("rb") as file:
            index: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    except OSError as error:
        raise DatasetError(f"{path.name}: {error.strerror or error}.") from None
    except (ValueError, EOFError):
        raise DatasetError(f"{path.name} is damaged or cut short: it is no NPY file.") from None
    if index.dtype != INDEX_DTYPE or index.ndim != 2 or index.shape[1] != members:
        raise DatasetError(f"{path.name} holds {index.dtype} {index.shape}, not {members} members a frame.")
    return index


def _npy(array: NDArray[np.void]) -> bytes:
    from io import BytesIO

    file = BytesIO()
    np.lib.format.write_array(file, array, version=(1, 0), allow_pickle=False)
    return file.getvalue()


def _header(member: str) -> tuple[bytearray, int]:
    """A tar header of frame 0 and size 0 with an empty checksum, and the sum of its bytes."""
    info = tarfile.TarInfo("0" * _DIGITS + "." + member)
    header = bytearray(info.tobuf(tarfile.USTAR_FORMAT)[:_BLOCK])
    header[148:156] = b"        "  # the checksum counts itself as spaces
    return header, sum(header) - 48 * (_DIGITS + 11)


def _filled(template: bytearray, base: int, number: bytes, size: int) -> bytes:
    """The header of one member; written by hand, since `tarfile` takes 20 µs for it."""
    header = bytearray(template)
    digits = b"%011o" % size
    header[_NAME], header[_SIZE] = number, digits
    header[_SUM] = b"%06o" % (base + sum(number) + sum(digits))
    header[154:156] = b"\0 "
    return bytes(header)
