"""Writes pictures as a film: MP4 or WebM, or an animated GIF.

MP4 holds H.264 where PyAV is installed (the extra `video`), else VP9: both play in browsers. The MPEG-4 part 2 that
OpenCV writes by default would not.
"""

from __future__ import annotations

import os
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lavsim.errors import OutputError
from lavsim.render.gif import encode_gif

cv2.setNumThreads(1)  # the same bytes on any machine

SUFFIXES = (".mp4", ".webm", ".gif")
_CODECS = {".mp4": "vp09", ".webm": "VP80"}
_QUALITY = 24  # constant rate factor of H.264
_MOST_GIF_FRAMES = 600  # a GIF is held in memory until it is written
_QUIET = 0  # log level of OpenCV


class VideoWriter:
    """A film, picture by picture.

    Args:
        path: `*.mp4`, `*.webm` or `*.gif`; written beside and renamed when it is closed.
        rate: Pictures a second.

    Raises:
        OutputError: the name ends in something else, or the file can't be written.
    """

    def __init__(self, path: Path, rate: float) -> None:
        if path.suffix.lower() not in SUFFIXES:
            raise OutputError(f"a film's name must end in one of {', '.join(SUFFIXES)}, got {path.name!r}.")
        self._path, self._rate = path, rate
        self._partial = path.with_name(f"{path.stem}.{os.getpid()}.partial{path.suffix.lower()}")
        self._film: _Film | None = None

    def add(self, image: NDArray[np.uint8]) -> None:
        """Adds a picture (H, W, 3) blue, green, red; all must have one size, which is cut to even numbers."""
        height, width = image.shape[0] & ~1, image.shape[1] & ~1
        if self._film is None:
            self._film = _open(self._partial, self._rate, (width, height))
        self._film.add(np.ascontiguousarray(image[:height, :width]))

    def close(self) -> None:
        """Completes the file.

        Raises:
            OutputError: it has no picture, or can't be written.
        """
        if self._film is None:
            raise OutputError(f"{self._path.name} has no picture.")
        self._film.close()
        if not self._partial.is_file():
            raise OutputError(f"can't write {self._path}.")
        self._partial.replace(self._path)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self._partial.unlink(missing_ok=True)


class _Film(Protocol):
    def add(self, image: NDArray[np.uint8]) -> None: ...

    def close(self) -> None: ...


def _open(path: Path, rate: float, size: tuple[int, int]) -> _Film:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        return _GifFilm(path, rate)
    if path.suffix == ".mp4":
        try:
            import av  # type: ignore[import-not-found, unused-ignore]
        except ImportError:
            pass
        else:
            return _H264Film(av, path, rate, size)
    return _OpenCvFilm(path, rate, size)


class _OpenCvFilm:
    """VP8 or VP9 by OpenCV."""

    def __init__(self, path: Path, rate: float, size: tuple[int, int]) -> None:
        level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(_QUIET)  # it warns of codecs that it then writes well
        try:
            with _quiet_stderr():
                self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*_CODECS[path.suffix]), rate, size)
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not self._writer.isOpened():
            raise OutputError(f"can't write {path.name}: this OpenCV has no encoder for it.")

    def add(self, image: NDArray[np.uint8]) -> None:
        self._writer.write(image)

    def close(self) -> None:
        self._writer.release()


class _H264Film:
    """H.264 by PyAV."""

    def __init__(self, av: Any, path: Path, rate: float, size: tuple[int, int]) -> None:
        self._av = av
        self._container = av.open(str(path), "w", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=Fraction(rate).limit_denominator(1000))
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"crf": str(_QUALITY), "threads": "1"}

    def add(self, image: NDArray[np.uint8]) -> None:
        frame = self._av.VideoFrame.from_ndarray(image, format="bgr24")
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        self._container.mux(self._stream.encode())
        self._container.close()


class _GifFilm:
    """An animated GIF, whose table of colours needs all pictures at once."""

    def __init__(self, path: Path, rate: float) -> None:
        self._path, self._rate = path, rate
        self._images: list[NDArray[np.uint8]] = []

    def add(self, image: NDArray[np.uint8]) -> None:
        if len(self._images) == _MOST_GIF_FRAMES:
            raise OutputError(f"a GIF takes at most {_MOST_GIF_FRAMES} pictures; take a shorter piece, or an MP4.")
        self._images.append(image)

    def close(self) -> None:
        self._path.write_bytes(encode_gif(self._images, self._rate))


class _quiet_stderr:  # noqa: N801 - reads as what it does
    """FFmpeg writes its warnings past OpenCV's log, straight to the process's stderr."""

    def __enter__(self) -> None:
        self._kept = os.dup(2)
        self._null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(self._null, 2)

    def __exit__(self, *_: object) -> None:
        os.dup2(self._kept, 2)
        os.close(self._kept)
        os.close(self._null)
