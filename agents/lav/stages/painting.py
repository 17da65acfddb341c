"""Painted scores of all points of a dataset, written once, so that the stages after it read them."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from agents.lav.data.images import WIDE, require_fields
from agents.lav.painted import is_painted, origin_of, painted_folder, write_scores
from agents.lav.painting import Floats, Painter
from agents.lav.stages.base import STAGES, Stage, StageInput
from agents.lav.weights import Weights
from lavsim.dataset.reader import Dataset

_CHUNK = 4  # frames that go through the network together


@STAGES.register("painting")
class PaintingStage(Stage):
    """No training: the segmentation runs over all five cameras. Painted episodes are skipped, so it can be killed."""

    parents: ClassVar[Sequence[str]] = ("segmentation",)
    sizes: ClassVar[Sequence[str]] = ("cameras", "segmentation")
    is_trained: ClassVar[bool] = False

    def __init__(self, given: StageInput) -> None:
        self._weights = given.parents["segmentation"]
        self._sets = [data for data in (given.data, given.validation) if data is not None]
        for data in self._sets:
            require_fields(data, (*WIDE, "lidar"), "painting")

    def __len__(self) -> int:
        return sum(map(len, self._sets))

    def run(self, folder: Path, on_share: Callable[[float], None]) -> dict[str, float]:
        done, fresh, seconds = 0, 0, time.monotonic()
        digest = digest_of(self._weights)
        for data in self._sets:
            painter = Painter(self._weights, data.info.record.suite, WIDE)
            for episode, record in data.episodes.items():
                path = painted_folder(folder, data) / f"ep_{episode:06d}.scores"
                made_from: dict[str, Any] = {"weights": digest, "readings": origin_of(data, episode)}
                if not is_painted(path, made_from):
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_scores(path, painted_frames(data, episode, painter), made_from)
                    fresh += record.frames
                done += record.frames
                on_share(done / len(self))
        seconds = time.monotonic() - seconds
        return {"frames": float(done), "frames_per_s": fresh / max(seconds, 1e-9)}


def painted_frames(data: Dataset, episode: int, painter: Painter) -> Iterator[Floats]:
    """(N, 4) scores of each frame of an episode; the next frames are read while the network works."""
    frames = data.episodes[episode].frames
    chunks = [range(begin, min(begin + _CHUNK, frames)) for begin in range(0, frames, _CHUNK)]

    def read(chunk: range) -> list[dict[str, Any]]:
        return [data.read(episode, frame, (*WIDE, "lidar")) for frame in chunk]

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(read, chunks[0]) if chunks else None
        for number in range(len(chunks)):
            assert coming is not None
            found = coming.result()
            if number + 1 < len(chunks):
                coming = pool.submit(read, chunks[number + 1])
            logits = painter.classes([frame[name] for frame in found for name in WIDE])
            for frame, shown in zip(found, np.split(logits, len(found)), strict=True):
                yield painter.paint(frame["lidar"], shown)


def digest_of(weights: Weights) -> str:
    """A digest of what a network's weights are."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(weights.tensors):
        digest.update(name.encode() + weights.tensors[name].contiguous().numpy().tobytes())
    return digest.hexdigest()
