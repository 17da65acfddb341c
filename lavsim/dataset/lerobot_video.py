"""Films of LeRobot's format: one camera's episodes one after another in MP4 files, and statistics of their colours."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import OutputError

CHUNK_FILES = 1000
VIDEO_MB = 200
PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}"
QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
_QUALITY = 23  # constant rate factor of H.264
_GOP = 2  # pictures from one that stands alone to the next: random access decodes two at most


@dataclass
class Place:
    """Which file is being written, and how it stands."""

    chunk: int = 0
    file: int = 0

    def next(self) -> None:
        self.file += 1
        if self.file == CHUNK_FILES:
            self.chunk, self.file = self.chunk + 1, 0

    def path(self, root: Path, suffix: str) -> Path:
        return root / (PATH.format(chunk_index=self.chunk, file_index=self.file) + suffix)


class Video:
    """The films of one camera."""

    def __init__(self, folder: Path, rate: int, height: int, width: int, limit: float) -> None:
        self._folder, self._rate, self._size, self._limit = folder, rate, (height, width), limit
        self._place = Place()
        self._film: _Film | None = None
        self._pictures = 0  # in the film being written
        self.levels = Levels()

    @property
    def info(self) -> dict[str, Any]:
        height, width = self._size
        return {
            "dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"],
            "info": {
                "video.height": height, "video.width": width, "video.codec": "h264", "video.pix_fmt": "yuv420p",
                "video.is_depth_map": False, "video.fps": self._rate, "video.channels": 3, "has_audio": False,
            },
        }  # fmt: skip

    def begin(self, count: int) -> tuple[int, int, int]:
        """Chunk, file and number of the first picture of an episode of `count` pictures."""
        if self._film is not None and self._film.size > self._limit * 2**20:
            self._film.close()
            self._film, self._pictures = None, 0
            self._place.next()
        begin, self._pictures = self._pictures, self._pictures + count
        return self._place.chunk, self._place.file, begin

    def add(self, picture: NDArray[np.uint8]) -> None:
        if self._film is None:
            path = self._place.path(self._folder, ".mp4")
            path.parent.mkdir(parents=True, exist_ok=True)
            self._film = _Film(path, self._rate, self._size)
        self._film.add(picture)

    def close(self) -> None:
        if self._film is not None:
            self._film.close()


class _Film:
    """One MP4 file."""

    def __init__(self, path: Path, rate: int, size: tuple[int, int]) -> None:
        try:
            import av
        except ImportError:
            raise OutputError("LeRobot's format needs the package av: pip install 'lavsim[video]'.") from None
        self._av = av
        self._container = av.open(str(path), "w")
        stream: Any = self._container.add_stream("libx264", rate=Fraction(rate))
        stream.height, stream.width, stream.pix_fmt = *size, "yuv420p"
        # Nothing may lean on a later picture: the first one's time stamp is then 0, as readers expect, and no picture
        # waits in the encoder.
        stream.options = {
            "crf": str(_QUALITY),
            "g": str(_GOP),
            "preset": "veryfast",
            "tune": "zerolatency",
            "threads": "1",
        }
        self._stream = stream
        self.size = 0  # [bytes] so far

    def add(self, picture: NDArray[np.uint8]) -> None:
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        packets = self._stream.encode(frame)
        self.size += sum(packet.size for packet in packets)
        self._container.mux(packets)

    def close(self) -> None:
        self._container.mux(self._stream.encode())
        self._container.close()


@dataclass
class Levels:
    """How often each level of red, green and blue occurs."""

    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros((3, 256), np.int64))
    pictures: int = 0

    def add(self, picture: NDArray[np.uint8]) -> None:
        self.counts += np.stack([np.bincount(picture[..., c].ravel(), minlength=256) for c in range(3)])
        self.pictures += 1

    def join(self, other: Levels) -> None:
        self.counts += other.counts
        self.pictures += other.pictures

    def statistics(self) -> dict[str, Any]:
        """As LeRobot has it: each (3, 1, 1) in 0 to 1; "count" of pictures."""
        level = np.arange(256) / 255.0
        share = self.counts / np.maximum(self.counts.sum(axis=1, keepdims=True), 1)
        mean = share @ level
        found = {
            "min": level[np.argmax(self.counts > 0, axis=1)],
            "max": level[255 - np.argmax(self.counts[:, ::-1] > 0, axis=1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(share @ level**2 - mean**2, 0.0)),
        }
        below = np.cumsum(share, axis=1)
        for q in QUANTILES:
            found[quantile_name(q)] = level[np.argmax(below >= q, axis=1)]
        return {name: value.reshape(3, 1, 1).tolist() for name, value in found.items()} | {"count": [self.pictures]}


def quantile_name(share: float) -> str:
    return f"q{round(share * 100):02d}"
