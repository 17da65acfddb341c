"""What a pixel shows: the scores that painting writes onto the points (paper, section 3.2; reference `lav.md` 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from agents.lav.config import CameraConfig
from agents.lav.data.augment import augmented
from agents.lav.data.images import WIDE, WIDE_TAGS, as_batch, frames_of, require_fields, shrunk, shrunk_tags
from agents.lav.data.show import PALETTE, SHOWN, column, sheet, unseen_frames
from agents.lav.models.segmentation import (
    CLASS_WEIGHTS,
    CLASSES,
    calibrated,
    classes_of_tags,
    in_unit_range,
    make_segmentation,
)
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws
from lavsim.types import ActorClass

STANDING_STRIDE = 4  # of frames in which the ego stands every fourth: one a second
WALKER_ODDS = 3.0  # of a camera that sees a walker, against one that does not
_SEEN = 12  # pixels of walkers from which on a camera sees them
_CHUNK = 32

Batch = tuple[Tensor, Tensor]


@STAGES.register("segmentation")
class SegmentationStage(Stage):
    """One of the five cameras a frame, drawn anew each time, as it is or mirrored."""

    sizes: ClassVar = ("cameras", "segmentation")
    defaults: ClassVar[TrainConfig] = TrainConfig(batch=16, epochs=2.2, learning_rate=1e-2, precision="auto")

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        self.network = make_segmentation(given.config.segmentation).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._cameras, self._data, self._validation = given.config.cameras, given.data, given.validation
        require_fields(given.data, (*WIDE, *WIDE_TAGS), "segmentation")
        self._frames = frames_of(given.data, STANDING_STRIDE)
        self._bounds = camera_bounds(given.data, self._frames)

    def __len__(self) -> int:
        return len(self._frames)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> Batch:
        pairs = [self._sample(sample, draws.stream("image", n)) for n, sample in enumerate(samples)]
        images, tags = zip(*pairs, strict=True)
        return as_batch(images), torch.from_numpy(np.stack(tags))

    def loss(self, batch: Batch, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        images, tags = batch
        crossed, missed = segmentation_losses(self.network(in_unit_range(images)), tags)
        return crossed + missed, {"cross_entropy": crossed.item(), "dice": missed.item()}

    def measure(self) -> dict[str, float]:
        if self._validation is None:
            return {}
        require_fields(self._validation, (*WIDE, *WIDE_TAGS), "segmentation")
        counts = torch.zeros(len(CLASSES), len(CLASSES), dtype=torch.long)
        frames = frames_of(self._validation)
        for number in range(len(WIDE)):
            for begin in range(0, len(frames), _CHUNK):
                pairs = [
                    read_pair(self._validation, frame, number, self._cameras)
                    for frame in frames[begin : begin + _CHUNK]
                ]
                images, tags = as_batch([image for image, _ in pairs]), np.stack([tag for _, tag in pairs])
                counts += confusion(self._classes(images), classes_of_tags(torch.from_numpy(tags)))
        return intersections_over_unions(counts) | {"images": float(len(frames) * len(WIDE))}

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        if self._validation is None:
            return {}
        cells = []
        for place in unseen_frames(self._validation, SHOWN):
            image, tags = read_pair(self._validation, place, len(WIDE) // 2, self._cameras)
            told = self._classes(as_batch([image]))[0]
            truth = classes_of_tags(torch.from_numpy(tags))
            cells.append(column([image, PALETTE[told.numpy()], PALETTE[truth.numpy()]]))
        return {"segmentation": sheet(cells)}

    def _sample(self, sample: int, draws: Draws) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        camera = int(np.searchsorted(self._bounds[sample], draws.uniform(0, 1)[0], side="right"))
        image, tags = read_pair(self._data, self._frames[sample], camera, self._cameras)
        if draws.integer(0, 2, 1):
            image, tags = image[:, ::-1], tags[:, ::-1]
        return augmented(np.ascontiguousarray(image), draws), np.ascontiguousarray(tags)

    def _classes(self, images: Tensor) -> Tensor:
        device = next(self.network.parameters()).device
        found: Tensor = calibrated(self.network(in_unit_range(images.to(device)))).argmax(dim=1).cpu()
        return found


def read_pair(
    data: Dataset, place: Sequence[int] | NDArray[np.int64], camera: int, cameras: CameraConfig
) -> tuple[Any, Any]:
    """An image (H, W, 3) of one of the five cameras and its tags (H, W), as large as the network takes them."""
    colour, tags = WIDE[camera], WIDE_TAGS[camera]
    read = data.read(int(place[0]), int(place[1]), (colour, tags))
    size = cameras.width, cameras.height
    return shrunk(read[colour], *size), shrunk_tags(read[tags], *size)


def camera_bounds(data: Dataset, frames: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N, 4) where, between 0 and 1, one camera's share of the draws ends and the next one's begins."""
    odds = np.ones((len(frames), len(WIDE)))
    for place, (episode, frame) in enumerate(frames):
        row = data.table(int(episode)).row(int(frame), ("actor_class", "actor_pixels"))
        seen = row["actor_pixels"][row["actor_class"] == ActorClass.WALKER, : len(WIDE)].sum(axis=0) >= _SEEN
        odds[place] += (WALKER_ODDS - 1.0) * seen
    shares = np.cumsum(odds, axis=1)
    return shares[:, :-1] / shares[:, -1:]


def segmentation_losses(logits: Tensor, tags: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted cross entropy, and one minus the mean dice coefficient of the classes, over a batch.

    The second counts every class alike, as the measure does; without it walkers come late (Milletari et al. 2016).

    Args:
        logits: (B, classes, H, W).
        tags: (B, H, W).
    """
    truth = classes_of_tags(tags)
    crossed = functional.cross_entropy(logits, truth, torch.tensor(CLASS_WEIGHTS, device=logits.device))
    told = logits.softmax(dim=1)
    is_class = functional.one_hot(truth, len(CLASSES)).permute(0, 3, 1, 2).to(told.dtype)
    both, either = (pixels.sum(dim=(0, 2, 3)) for pixels in (told * is_class, told + is_class))
    return crossed, 1.0 - ((2.0 * both + 1.0) / (either + 1.0)).mean()


def confusion(told: Tensor, truth: Tensor) -> Tensor:
    """(classes, classes) pixels by true class and by the class told."""
    size = len(CLASSES)
    return torch.bincount((truth * size + told).flatten(), minlength=size * size).reshape(size, size)


def intersections_over_unions(counts: Tensor) -> dict[str, float]:
    """Of a confusion matrix: a number for each class that occurs, and their mean."""
    hits = counts.diagonal()
    unions = counts.sum(dim=0) + counts.sum(dim=1) - hits
    found = {
        f"iou_{name.replace(' ', '_')}": float(hit / union)
        for name, hit, union in zip(CLASSES, hits, unions, strict=True)
        if union > 0
    }
    return found | {"iou_mean": float(np.mean(list(found.values()))) if found else 0.0}
