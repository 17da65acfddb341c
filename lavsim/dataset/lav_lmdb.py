"""LAV's own storage: one lmdb environment a trajectory, read and written key by key, in LAV's units.

Everything here is as `reference lav.md` 3.1 states it; `lavsim.dataset.lav_frames` turns the values into ours. The
package `lmdb` (extra `data`) is loaded on use. A copy cut short would kill the process that maps it (SIGBUS), so the
size of the file is compared with what its own head says before it is opened.
"""

from __future__ import annotations

import os
import shutil
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import DatasetError, OutputError

CAMERAS = 5  # yaw -120, -60, 0, 60, 120 degrees
MAPS = 11
MAP_SIZE = int(1e10)  # [bytes] of address space, as LAV's recorder asks for; the file grows as it is filled

# LMDB's file: a page's head, then the meta block, twice. Source: lmdb's mdb.c, `MDB_meta` (format 1).
_META = struct.Struct("<16xII16xI92xQQ")  # magic, version, page size, last page, transaction
_MAGIC, _VERSION = 0xBEEFC0DE, 1


@dataclass(frozen=True)
class LavFrame:
    """One frame as LAV stores it: A actors with the ego first, n ticks since the frame before.

    Attributes:
        rgb: JPEG files of the five cameras, left to right, 288 x 256.
        sem: PNG files of their class tags.
        tel_rgb, tel_sem: The same of the telephoto camera, 288 x 480.
        maps: PNG files of the BEV layers, 320 x 320.
        lidar: (P, 4) float32 x forward, y right, z up [m] from 2.4 m above the ego, and intensity.
        id: (A,) int32.
        loc: (A, 2) float32 world [m].
        ori: (A,) float32 yaw [deg].
        bbox: (A, 2) float32 half length and half width [m].
        type: (A,) uint8, 0 walker, 1 vehicle.
        spd: (A,) float32 [m/s].
        cmd: 0 left, 1 right, 2 straight, 3 follow, 4 change left, 5 change right.
        nxp: (2,) float32 target (left, forward) [m].
        bra: 1 for a full stop.
        gnss: (n, 5) float32 latitude, longitude [deg], compass [rad], speed [m/s], steer.
        lin_acc: (n, 3) float32 [m/s²].
        ang_vel: (n, 3) float32 [rad/s].
    """

    rgb: tuple[bytes, ...]
    sem: tuple[bytes, ...]
    tel_rgb: bytes
    tel_sem: bytes
    maps: tuple[bytes, ...]
    lidar: NDArray[np.float32]
    id: NDArray[np.int32]
    loc: NDArray[np.float32]
    ori: NDArray[np.float32]
    bbox: NDArray[np.float32]
    type: NDArray[np.uint8]
    spd: NDArray[np.float32]
    cmd: int
    nxp: NDArray[np.float32]
    bra: int
    gnss: NDArray[np.float32]
    lin_acc: NDArray[np.float32]
    ang_vel: NDArray[np.float32]


# Type and columns (0: a plain list) of each array key.
_ARRAYS: dict[str, tuple[type[np.generic], int]] = {
    "lidar": (np.float32, 4), "id": (np.int32, 0), "loc": (np.float32, 2), "ori": (np.float32, 0),
    "bbox": (np.float32, 2), "type": (np.uint8, 0), "spd": (np.float32, 0), "gnss": (np.float32, 5),
    "lin_acc": (np.float32, 3), "ang_vel": (np.float32, 3),
}  # fmt: skip
_PER_ACTOR = ("loc", "ori", "bbox", "type", "spd")


class LavTrajectory:
    """A trajectory of LAV's dataset.

    Args:
        folder: Of the environment; it holds `data.mdb`.

    Attributes:
        town: Name of the town.

    Raises:
        DatasetError: no such environment, cut short, or without the keys of a trajectory.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        _check_whole(folder)
        lmdb = load_lmdb()
        try:
            self._env = lmdb.open(str(folder), max_readers=1, readonly=True, lock=False, readahead=False, meminit=False)
        except lmdb.Error as error:
            raise DatasetError(f"{folder.name}: {error}") from None
        self._txn = self._env.begin(buffers=False)
        try:
            self._length = int(self._get("len"))
        except ValueError:
            raise DatasetError(f"{folder.name}: 'len' is no number.") from None
        self.town = self._get("town").decode()

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[LavFrame]:
        return (self.frame(t) for t in range(len(self)))

    def __enter__(self) -> LavTrajectory:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._txn.abort()
        self._env.close()

    def frame(self, t: int) -> LavFrame:
        """Frame number `t`.

        Raises:
            DatasetError: a key is missing or has the wrong number of bytes.
        """
        arrays: dict[str, Any] = {name: self._array(name, t) for name in _ARRAYS}
        for name in _PER_ACTOR:
            got, actors = len(arrays[name]), len(arrays["id"])
            if got != actors:
                raise DatasetError(f"{self.folder.name}: {name}_{t:05d} holds {got} actors, id_{t:05d} {actors}.")
        goal = np.frombuffer(self._get(f"nxp_{t:05d}"), np.float32)
        if goal.shape != (2,):
            raise DatasetError(f"{self.folder.name}: nxp_{t:05d} holds {len(goal)} numbers instead of 2.")
        return LavFrame(
            rgb=tuple(self._get(f"rgb_{i}_{t:05d}") for i in range(CAMERAS)),
            sem=tuple(self._get(f"sem_{i}_{t:05d}") for i in range(CAMERAS)),
            tel_rgb=self._get(f"tel_rgb_{t:05d}"),
            tel_sem=self._get(f"tel_sem_{t:05d}"),
            maps=tuple(self._get(f"map_{i}_{t:05d}") for i in range(MAPS)),
            cmd=self._get(f"cmd_{t:05d}")[0],
            bra=self._get(f"bra_{t:05d}")[0],
            nxp=goal,
            **arrays,
        )

    def _get(self, key: str) -> bytes:
        value = self._txn.get(key.encode())
        if not value:
            raise DatasetError(f"{self.folder.name} has no {key!r}: it is no trajectory of LAV's dataset.")
        return bytes(value)

    def _array(self, name: str, t: int) -> NDArray[Any]:
        dtype, columns = _ARRAYS[name]
        value = self._txn.get(f"{name}_{t:05d}".encode())
        if value is None:
            raise DatasetError(f"{self.folder.name} has no '{name}_{t:05d}'.")
        row = np.dtype(dtype).itemsize * max(columns, 1)
        if len(value) % row:
            raise DatasetError(
                f"{self.folder.name}: {name}_{t:05d} has {len(value)} bytes, which is no multiple of {row}."
            )
        array = np.frombuffer(value, dtype)
        return array.reshape(-1, columns) if columns else array


def trajectories(folder: Path) -> list[Path]:
    """Folders of the environments in `folder`, by name; `folder` itself if it is one.

    Raises:
        DatasetError: there is none.
    """
    if (folder / "data.mdb").is_file():
        return [folder]
    found = sorted(path.parent for path in folder.glob("*/data.mdb")) if folder.is_dir() else []
    if not found:
        raise DatasetError(f"{folder} holds no trajectory of LAV's dataset (folders with a data.mdb).")
    return found


def write_trajectory(folder: Path, town: str, frames: Iterable[LavFrame]) -> int:
    """Writes an environment whole or not at all; the number of its frames.

    Raises:
        OutputError: the folder exists, or the disk is full.
    """
    if folder.exists():
        raise OutputError(f"{folder} exists already.")
    lmdb = load_lmdb()
    partial = folder.with_name(f"{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    length = 0
    try:
        # One writer needs no lock file, and what LAV wrote has none either once it is copied.
        env = lmdb.open(str(partial), map_size=MAP_SIZE, lock=False)
        for frame in frames:  # a transaction a frame keeps the memory small
            with env.begin(write=True) as txn:
                for key, value in _entries(frame, length):
                    txn.put(key.encode(), value)
            length += 1
        with env.begin(write=True) as txn:
            txn.put(b"len", str(length).encode())
            txn.put(b"town", town.encode())
        env.sync(True)
        env.close()
    except (lmdb.Error, OSError) as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise OutputError(f"can't write the trajectory {folder.name}: {error}; the disk may be full.") from None
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    os.replace(partial, folder)
    return length


def _entries(frame: LavFrame, t: int) -> Iterator[tuple[str, bytes]]:
    end = f"_{t:05d}"
    for item in fields(frame):
        name, value = item.name, getattr(frame, item.name)
        if name in _ARRAYS:
            yield name + end, np.ascontiguousarray(value, _ARRAYS[name][0]).tobytes()
        elif name in ("cmd", "bra"):
            yield name + end, np.uint8(value).tobytes()
        elif name == "nxp":
            yield name + end, np.ascontiguousarray(value, np.float32).tobytes()
        elif name in ("rgb", "sem", "maps"):
            for i, data in enumerate(value):
                yield f"{'map' if name == 'maps' else name}_{i}{end}", data
        else:
            yield name + end, value


def load_lmdb() -> Any:
    """The package.

    Raises:
        DatasetError: it is not installed.
    """
    try:
        import lmdb
    except ImportError:
        raise DatasetError("LAV's datasets need the package lmdb: pip install 'lavsim[data]'.") from None
    return lmdb


def _check_whole(folder: Path) -> None:
    """Refuses a file that is shorter than the pages in use: reading them would end the process."""
    path = folder / "data.mdb"
    try:
        with path.open("rb") as file:
            head = file.read(_META.size)
            if len(head) < _META.size:
                raise DatasetError(f"{path} is cut short: {len(head)} bytes.")
            magic, version, page, last, txn = _META.unpack(head)
            file.seek(page)
            other = file.read(_META.size)
        size = path.stat().st_size
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}.") from None
    if magic != _MAGIC:
        raise DatasetError(f"{path} is no lmdb file: its first bytes are not one's.")
    if version & 0xFFFF != _VERSION:
        raise DatasetError(f"{path} has lmdb format {version & 0xFFFF}; lavsim reads {_VERSION}.")
    if len(other) == _META.size and _META.unpack(other)[4] > txn:
        last = _META.unpack(other)[3]
    if size < (last + 1) * page:
        raise DatasetError(f"{path} is cut short: {size} of {(last + 1) * page} bytes.")
