"""Writes samples as WebDataset's tar shards: files of one sample share the part of their name before the first dot.

`000012_000123.json` and `000012_000123.rgb_0.jpg` belong to the sample `000012_000123`. Plain `tarfile` reads them, and
so does the package `webdataset`, which this module does not need.
"""

from __future__ import annotations

import tarfile
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import DatasetError

NAME = "shard-{:06d}.tar"
SHARD_BYTES = 512 * 2**20
SHARD_SAMPLES = 2000


class SampleWriter:
    """Shards in a folder, one after another.

    Args:
        folder: It must exist.
        limit: Size at which a shard is followed by the next [bytes].
        samples: Samples at which it is.
    """

    def __init__(self, folder: Path, limit: int = SHARD_BYTES, samples: int = SHARD_SAMPLES) -> None:
        self._folder, self._limit, self._samples = folder, limit, samples
        self._tar: tarfile.TarFile | None = None
        self._inside = 0
        self.shards = 0

    def add(self, key: str, files: Mapping[str, bytes]) -> None:
        """Appends a sample: its files by the part of their name behind the first dot.

        Raises:
            ValueError: the key has a dot, which would end it.
        """
        if "." in key:
            raise ValueError(f"a sample's key must have no dot, got {key!r}")
        if self._tar is None or self._inside >= self._samples or self._tar.offset >= self._limit:
            self.close()
            path = self._folder / NAME.format(self.shards)
            self._tar = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115 - open over many calls
            self._inside, self.shards = 0, self.shards + 1
        for name, data in files.items():
            info = tarfile.TarInfo(f"{key}.{name}")  # no owner, no clock: the same samples are the same bytes
            info.size = len(data)
            self._tar.addfile(info, BytesIO(data))
        self._inside += 1

    def close(self) -> None:
        """Completes the shard being written."""
        if self._tar is not None:
            self._tar.close()
            self._tar = None


def read_samples(folder: Path) -> Iterator[tuple[str, dict[str, bytes]]]:
    """Samples of a folder of shards: key, and files by what follows the key.

    Raises:
        DatasetError: a shard is no tar file, or cut short.
    """
    for path in sorted(folder.glob("*.tar")):
        key, files = "", dict[str, bytes]()
        try:
            with tarfile.open(path) as tar:
                for member in tar:
                    begin, _, name = member.name.partition(".")
                    if begin != key and files:
                        yield key, files
                        files = {}
                    source = tar.extractfile(member)
                    assert source is not None
                    key, files[name] = begin, source.read()
                    if len(files[name]) != member.size:
                        raise DatasetError(f"{path.name} is cut short in {member.name}.")
        except tarfile.TarError as error:
            raise DatasetError(f"{path.name} can't be read as tar: {error}.") from None
        if files:
            yield key, files


def npy_bytes(array: NDArray[np.generic]) -> bytes:
    """The array as a file in NumPy's NPY format."""
    file = BytesIO()
    np.lib.format.write_array(file, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return file.getvalue()


def npz_bytes(**arrays: NDArray[np.generic]) -> bytes:
    """The arrays as a compressed file in NumPy's NPZ format."""
    file = BytesIO()
    np.savez_compressed(file, allow_pickle=False, **arrays)
    return file.getvalue()
