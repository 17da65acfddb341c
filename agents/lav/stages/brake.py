"""Whether to stop, told from images: red lights, stop signs, whoever stands in the way (paper, appendix)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from agents.lav.data.arrays import FRONT
from agents.lav.data.augment import augmented
from agents.lav.data.images import (
    FRONT_TAGS,
    TELEPHOTO,
    TELEPHOTO_TAGS,
    as_batch,
    frames_of,
    panorama,
    panorama_tags,
    require_fields,
    telephoto,
    telephoto_tags,
)  # fmt: skip
from agents.lav.data.show import SHOWN, barred, column, fitted, sheet, unseen_frames
from agents.lav.models.brake import BrakeNetwork, auxiliary_loss
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws
from lavsim.types import LightState

AUXILIARY_WEIGHT = 0.5  # of each image's segmentation
STANDING_STRIDE = 2  # of frames in which the ego stands every second
RED_FROM, RED_TO = 5.0, 30.0  # [m] to the stop line: where a red light has to be told
_IMAGES = (*FRONT, TELEPHOTO)
_TAGS = (*FRONT_TAGS, TELEPHOTO_TAGS)
_CHUNK = 16


class BrakeBatch(NamedTuple):
    """Frames to learn from.

    Attributes:
        panorama, telephoto: (B, 3, H, W) uint8.
        panorama_tags, telephoto_tags: (B, H, W) uint8.
        brake: (B,) float32, 1 where the expert made a full stop.
    """

    panorama: Tensor
    telephoto: Tensor
    panorama_tags: Tensor
    telephoto_tags: Tensor
    brake: Tensor


@STAGES.register("brake")
class BrakeStage(Stage):
    """Learns the expert's full stops, and beside them the classes of pixels that may be their cause."""

    sizes: ClassVar[Sequence[str]] = ("cameras", "brake")
    defaults: ClassVar[TrainConfig] = TrainConfig(batch=16, epochs=4.0, learning_rate=2e-3, precision="auto")

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        network = BrakeNetwork(given.config)
        self.network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._cameras, self._data, self._validation = given.config.cameras, given.data, given.validation
        self._threshold = given.config.drive.brake_score
        require_fields(given.data, (*_IMAGES, *_TAGS), "brake")
        self._frames = frames_of(given.data, STANDING_STRIDE)

    def __len__(self) -> int:
        return len(self._frames)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> BrakeBatch:
        wide, far, wide_tags, far_tags, brakes = [], [], [], [], []
        for number, (episode, frame) in enumerate(self._frames[samples].tolist()):
            read = self._data.read(episode, frame, (*_IMAGES, *_TAGS, "brake"))
            stream = draws.stream("image", number)
            wide.append(augmented(panorama(read, self._cameras), stream.stream("panorama")))
            far.append(augmented(telephoto(read, self._cameras), stream.stream("telephoto")))
            wide_tags.append(panorama_tags(read, self._cameras))
            far_tags.append(telephoto_tags(read, self._cameras))
            brakes.append(float(read["brake"]))
        first, second = (torch.from_numpy(np.stack(images)) for images in (wide_tags, far_tags))
        return BrakeBatch(as_batch(wide), as_batch(far), first, second, torch.tensor(brakes))

    def loss(self, batch: BrakeBatch, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        images = batch.panorama.float() / 255.0, batch.telephoto.float() / 255.0
        logits, wide, far = self.network(*images, with_tags=True)
        return brake_loss(logits, wide, far, batch)

    def measure(self) -> dict[str, float]:
        if self._validation is None:
            return {}
        frames = frames_of(self._validation)
        return measures_of(self._scores(frames), facts_of(self._validation, frames), self._threshold)

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        """Panorama above telephoto, and bars: what the expert did and what is told."""
        if self._validation is None:
            return {}
        frames = np.array(unseen_frames(self._validation, SHOWN))
        cells = []
        for (episode, frame), score in zip(frames.tolist(), self._scores(frames), strict=True):
            read = self._validation.read(episode, frame, (*_IMAGES, "brake"))
            wide = panorama(read, self._cameras)
            far = fitted(telephoto(read, self._cameras), wide.shape[1])
            cells.append(column([wide, far, barred(wide.shape[1], [float(read["brake"]), score])]))
        return {"brake": sheet(cells, columns=3)}

    def _scores(self, frames: NDArray[np.int64]) -> NDArray[np.float64]:
        """(N,) 0 to 1 for frames (N, 2) of the validation data."""
        assert self._validation is not None
        require_fields(self._validation, (*_IMAGES, *_TAGS), "brake")
        device = next(self.network.parameters()).device
        found = []
        for begin in range(0, len(frames), _CHUNK):
            places = frames[begin : begin + _CHUNK].tolist()
            reads = [self._validation.read(episode, frame, _IMAGES) for episode, frame in places]
            images = (as_batch([cut(read, self._cameras) for read in reads]) for cut in (panorama, telephoto))
            logits = self.network(*(image.to(device).float() / 255.0 for image in images))
            found.append(logits.sigmoid().cpu().double().numpy())
        return np.concatenate(found)


def brake_loss(logits: Tensor, wide: Tensor, far: Tensor, batch: BrakeBatch) -> tuple[Tensor, dict[str, float]]:
    """Cross entropy of stopping (B,) and of the classes of pixels in both images."""
    brake = functional.binary_cross_entropy_with_logits(logits, batch.brake)
    pixels = auxiliary_loss(wide, batch.panorama_tags) + auxiliary_loss(far, batch.telephoto_tags)
    return brake + AUXILIARY_WEIGHT * pixels, {"brake": brake.item(), "pixels": pixels.item()}


class Facts(NamedTuple):
    """What was so in frames; all (N,).

    Attributes:
        brake: Whether the expert made a full stop.
        cause: Why.
        red: Whether it did so before a red light 5 to 30 m ahead.
    """

    brake: NDArray[np.bool_]
    cause: NDArray[np.str_]
    red: NDArray[np.bool_]


def facts_of(data: Dataset, frames: NDArray[np.int64]) -> Facts:
    """The facts of frames (N, 2)."""
    names = ("brake", "brake_cause", "light_state", "light_distance")
    rows = [data.table(episode).row(frame, names) for episode, frame in frames.tolist()]
    brake = np.array([bool(row["brake"]) for row in rows])
    state, distance = (np.array([float(row[name]) for row in rows]) for name in names[2:])
    red = brake & (state == LightState.RED) & (distance >= RED_FROM) & (distance <= RED_TO)
    return Facts(brake, np.array([str(row["brake_cause"]) for row in rows]), red)


def measures_of(scores: NDArray[np.float64], facts: Facts, threshold: float) -> dict[str, float]:
    """Average precision, and at a threshold: recall by cause, of red lights, precision and false alarms."""
    told, brake = scores > threshold, facts.brake
    groups = {f"recall_{cause}": brake & (facts.cause == cause) for cause in np.unique(facts.cause[brake]).tolist()}
    groups |= {"recall_red": facts.red, "recall": brake, "false_alarms": ~brake}
    found = {name: float(told[group].mean()) for name, group in groups.items() if group.any()}
    found["precision"] = float(brake[told].mean()) if told.any() else 0.0
    counts = {"frames": float(len(scores)), "frames_braking": float(brake.sum()), "frames_red": float(facts.red.sum())}
    return {"average_precision": average_precision(scores, brake), **found, **counts}


def average_precision(scores: NDArray[np.float64], truth: NDArray[np.bool_]) -> float:
    """Mean precision at the ranks of the true ones; equal scores are one rank."""
    order = np.argsort(-scores, kind="stable")
    hits, ranked = np.cumsum(truth[order]), scores[order]
    last = np.flatnonzero(np.append(np.diff(ranked) != 0.0, True))
    recall = hits[last] / max(int(hits[-1]), 1)
    return float(np.sum(np.diff(recall, prepend=0.0) * hits[last] / (last + 1)))
