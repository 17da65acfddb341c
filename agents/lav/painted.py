"""Scores that painting wrote, a file an episode, beside the data they belong to by its digest.

A file is a line of JSON (what it was made from), the places of the frames in it, and for each frame Zstandard over four
planes of N bytes: pedestrian, lane mark, road, vehicle of each point of the scan, in its order, 255 for one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from lavsim.dataset.files import write_file
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import file_of
from lavsim.errors import DatasetError

PAINTED_SCHEMA = 1
SCORES = 4
_KEPT = 64  # episodes whose places stay in memory

Floats = NDArray[np.float32]


def painted_folder(folder: Path, data: Dataset) -> Path:
    """Where the scores of a dataset lie below the folder of the stage."""
    digest = hashlib.blake2b((data.root / "meta" / "info.json").read_bytes(), digest_size=4).hexdigest()
    return folder / f"{data.root.name}-{digest}"


def origin_of(data: Dataset, episode: int) -> str:
    """A digest of an episode's readings: its shard's, or its log's where readings are rendered."""
    files = data.episodes[episode].files
    facts = files.get(file_of("shard", episode)) or files[file_of("log", episode)]
    return facts.sha256


def write_scores(path: Path, frames: Iterable[Floats], made_from: dict[str, Any]) -> None:
    """Writes the scores (N, 4) of an episode's frames, whole or not at all."""
    packer = zstandard.ZstdCompressor(level=1)
    blobs = [packer.compress(np.rint(scores.T * 255.0).astype(np.uint8).tobytes()) for scores in frames]
    places = np.cumsum([0, *map(len, blobs)], dtype="<u8")
    head = json.dumps({"schema": PAINTED_SCHEMA, "frames": len(blobs), **made_from}, sort_keys=True) + "\n"
    write_file(path, head.encode() + places.tobytes() + b"".join(blobs))


def is_painted(path: Path, made_from: dict[str, Any]) -> bool:
    """Whether an episode's file is there and was made from just this."""
    try:
        with path.open("rb") as file:
            head = json.loads(file.readline())
    except (OSError, ValueError):
        return False
    head.pop("frames", None)
    return bool(head == {"schema": PAINTED_SCHEMA, **made_from})


class PaintedScores:
    """Reads what painting wrote. May be handed to other processes.

    Args:
        folder: Of the stage `painting`.
        data: Whose scans were painted.

    Raises:
        DatasetError: this data was not painted there.
    """

    def __init__(self, folder: Path, data: Dataset) -> None:
        self._folder = painted_folder(folder, data)
        self._data = data
        self._places: dict[int, tuple[int, NDArray[np.uint64]]] = {}
        if not self._folder.is_dir():
            raise DatasetError(f"{data.root.name} was not painted in {folder}: `lavsim train painting` does it.")

    def scores(self, episode: int, frame: int) -> Floats:
        """(N, 4) pedestrian, lane mark, road and vehicle of the points of a frame's scan, 0 to 1.

        Raises:
            DatasetError: the episode was not painted, or from other readings.
        """
        begin, places = self._index(episode)
        with self._path(episode).open("rb") as file:
            file.seek(begin + int(places[frame]))
            blob = file.read(int(places[frame + 1] - places[frame]))
        try:
            raw = np.frombuffer(zstandard.ZstdDecompressor().decompress(blob), np.uint8)
        except zstandard.ZstdError as error:
            raise DatasetError(f"{self._path(episode).name} is damaged: {error}.") from None
        return raw.reshape(SCORES, -1).T.astype(np.float32) / np.float32(255.0)

    def _index(self, episode: int) -> tuple[int, NDArray[np.uint64]]:
        if episode not in self._places:
            if len(self._places) >= _KEPT:
                self._places.pop(next(iter(self._places)))
            self._places[episode] = self._read_index(episode)
        return self._places[episode]

    def _read_index(self, episode: int) -> tuple[int, NDArray[np.uint64]]:
        path = self._path(episode)
        try:
            with path.open("rb") as file:
                head = json.loads(file.readline())
                places = np.frombuffer(file.read(8 * (head["frames"] + 1)), "<u8")
                begin = file.tell()
        except (OSError, ValueError, KeyError):
            raise DatasetError(f"{path.name} of the painted scores is missing or damaged.") from None
        if head.get("readings") != origin_of(self._data, episode):
            raise DatasetError(f"{path.name} was painted from other readings than {self._data.root.name} holds.")
        return begin, places

    def _path(self, episode: int) -> Path:
        return self._folder / f"ep_{episode:06d}.scores"
