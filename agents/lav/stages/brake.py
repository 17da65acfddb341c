"""Whether to stop, told from images: red lights, stop signs, whoever stands in the way (paper, appendix)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from agents.lav.brake_measures import facts_of, measures_of, signal_measures
from agents.lav.config import LavConfig
from agents.lav.data.arrays import FRONT
from agents.lav.data.augment import augmented
from agents.lav.data.images import (
    FRONT_TAGS,
    TELEPHOTO,
    TELEPHOTO_TAGS,
    as_batch,
    far_view,
    frames_of,
    panorama,
    panorama_tags,
    require_fields,
)  # fmt: skip
from agents.lav.data.show import SHOWN, barred, column, fitted, sheet, unseen_frames
from agents.lav.data.signals import Signals, joined, recorded_signals, repeats_of, staged_signals
from agents.lav.data.staged import StagedFrames
from agents.lav.models.brake import DISTANCE_UNIT, BrakeNetwork, auxiliary_loss, causes_of, stop_of
from agents.lav.models.resnet import memory_format
from agents.lav.painted import painted_folder
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws

AUXILIARY_WEIGHT = 0.5  # of each image's segmentation
STANDING_STRIDE = 2  # of frames in which the ego stands every second
_CAUSE_WEIGHTS = {"stop": 1.0, "light": 2.0, "sign": 1.0, "others": 1.0, "distance": 0.5}
_IMAGES = (*FRONT, TELEPHOTO)
_TAGS = (*FRONT_TAGS, TELEPHOTO_TAGS)
_STAGED = -1  # in place of an episode: frame of an approach
_CHUNK = 16


class Truth(NamedTuple):
    """`Signals` as tensors (B,): int64, and float32 for the distance."""

    stop: Tensor
    light: Tensor
    sign: Tensor
    others: Tensor
    distance: Tensor


class BrakeBatch(NamedTuple):
    """Frames to learn from.

    Attributes:
        panorama, telephoto: (B, 3, H, W) uint8.
        panorama_tags, telephoto_tags: (B, H, W) uint8.
        truth: What is so in them.
    """

    panorama: Tensor
    telephoto: Tensor
    panorama_tags: Tensor
    telephoto_tags: Tensor
    truth: Truth


@STAGES.register("brake")
class BrakeStage(Stage):
    """Learns the expert's full stops and their causes, and beside them the classes of pixels that may be the cause."""

    parents: ClassVar[Sequence[str]] = ("approaches",)
    sizes: ClassVar[Sequence[str]] = ("cameras", "brake")
    defaults: ClassVar[TrainConfig] = TrainConfig(batch=16, epochs=1.5, learning_rate=2.5e-3, precision="auto")

    @classmethod
    def needs(cls, config: LavConfig) -> Sequence[str]:
        return cls.parents if config.training.approaches else ()

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        self._format = memory_format(given.config.brake)
        network = BrakeNetwork(given.config)
        self.network = network.to(memory_format=self._format)  # type: ignore[call-overload]
        self._config, self._threshold = given.config, given.config.drive.brake_score
        require_fields(given.data, (*_IMAGES, *_TAGS), "brake")
        self._seen = _Source(given.data, _staged(given, given.data))
        self._unseen = _Source(given.validation, _staged(given, given.validation)) if given.validation else None
        self._samples, self._truth = self._seen.samples(given.config.brake.causes)

    def __len__(self) -> int:
        return len(self._samples)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> BrakeBatch:
        wide, far, wide_tags, far_tags = [], [], [], []
        for number, place in enumerate(self._samples[samples].tolist()):
            read = self._seen.read(place, (*_IMAGES, *_TAGS))
            stream = draws.stream("image", number)
            wide.append(augmented(panorama(read, self._config.cameras), stream.stream("panorama")))
            far.append(augmented(far_view(read[TELEPHOTO], self._config), stream.stream("telephoto")))
            wide_tags.append(panorama_tags(read, self._config.cameras))
            far_tags.append(far_view(read[TELEPHOTO_TAGS], self._config))
        first, second = (torch.from_numpy(np.stack(images)) for images in (wide_tags, far_tags))
        return BrakeBatch(as_batch(wide), as_batch(far), first, second, _as_truth(self._truth.at(samples)))

    def loss(self, batch: BrakeBatch, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        outputs, wide, far = self.network(self._shares(batch.panorama), self._shares(batch.telephoto), with_tags=True)
        return brake_loss(outputs, wide, far, batch)

    def _shares(self, images: Tensor) -> Tensor:
        """Bytes (B, 3, H, W) as 0 to 1."""
        return (images.float() / 255.0).contiguous(memory_format=self._format)

    def measure(self) -> dict[str, float]:
        if self._unseen is None:
            return {}
        frames = frames_of(self._unseen.data)
        outputs = self._outputs(frames)
        facts = facts_of(self._unseen.data, frames)
        found = measures_of(stop_of(outputs).sigmoid().double().numpy(), facts, self._threshold)
        if not self._config.brake.causes:
            return found
        found |= signal_measures(causes_of(outputs), recorded_signals(self._unseen.data, frames), "recorded", facts)
        if self._unseen.staged is not None:
            places = _staged_places(self._unseen.staged)
            truth = staged_signals(self._unseen.staged.told)
            found |= signal_measures(causes_of(self._outputs(places)), truth, "approaches")
        return found

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        """Panorama above telephoto, and bars: what the expert did and what is told.

        A network that knows causes has three pairs of bars: light red or yellow, stop sign, others.
        """
        if self._unseen is None:
            return {}
        recorded = np.array(unseen_frames(self._unseen.data, SHOWN))
        found = {"brake": self._sheet(recorded, recorded_signals(self._unseen.data, recorded))}
        if self._unseen.staged is not None:
            chosen = np.linspace(0, len(self._unseen.staged) - 1, SHOWN).astype(np.int64)
            truth = staged_signals(self._unseen.staged.told)
            places = _staged_places(self._unseen.staged)[chosen]
            found["approaches"] = self._sheet(places, truth.at(chosen))
        return found

    def _sheet(self, places: NDArray[np.int64], truth: Signals) -> NDArray[np.uint8]:
        assert self._unseen is not None
        outputs, cells = self._outputs(places), []
        for number, place in enumerate(places.tolist()):
            read = self._unseen.read(place, _IMAGES)
            wide = panorama(read, self._config.cameras)
            far = fitted(far_view(read[TELEPHOTO], self._config), wide.shape[1])
            cells.append(column([wide, far, barred(wide.shape[1], _bars(outputs[number : number + 1], truth, number))]))
        return sheet(cells, columns=3)

    def _outputs(self, places: NDArray[np.int64]) -> Tensor:
        """(N,) or (N, 8) of the network, for places (N, 2) in the validation data."""
        assert self._unseen is not None
        require_fields(self._unseen.data, (*_IMAGES, *_TAGS), "brake")
        device = next(self.network.parameters()).device
        found = []
        for begin in range(0, len(places), _CHUNK):
            reads = [self._unseen.read(place, _IMAGES) for place in places[begin : begin + _CHUNK].tolist()]
            wide = as_batch([panorama(read, self._config.cameras) for read in reads])
            far = as_batch([far_view(read[TELEPHOTO], self._config) for read in reads])
            outputs = self.network(*(self._shares(image.to(device)) for image in (wide, far)))
            found.append(outputs.detach().cpu().float())
        return torch.cat(found)


class _Source:
    """Recorded frames, by episode and frame, and rendered approaches, by -1 and their number."""

    def __init__(self, data: Dataset, staged: StagedFrames | None) -> None:
        self.data, self.staged = data, staged

    def samples(self, causes: bool) -> tuple[NDArray[np.int64], Signals]:
        """Places (N, 2) to learn from, some of them several times, and what is so there."""
        places = frames_of(self.data, 1 if causes else STANDING_STRIDE)
        truth = recorded_signals(self.data, places)
        if causes:
            chosen = np.repeat(np.arange(len(places)), repeats_of(self.data, places, truth))
            places, truth = places[chosen], truth.at(chosen)
        if self.staged is None:
            return places, truth
        more = _staged_places(self.staged)
        return np.concatenate([places, more]), joined((truth, staged_signals(self.staged.told)))

    def read(self, place: Sequence[int], names: tuple[str, ...]) -> dict[str, Any]:
        """Readings there by name."""
        if place[0] == _STAGED:
            assert self.staged is not None
            return self.staged.read(place[1], names)
        return self.data.read(place[0], place[1], names)


def brake_loss(outputs: Tensor, wide: Tensor, far: Tensor, batch: BrakeBatch) -> tuple[Tensor, dict[str, float]]:
    """Cross entropy of stopping, of its causes where outputs are (B, 8), and of the classes of pixels."""
    parts = _cause_losses(outputs, batch.truth) if outputs.ndim == 2 else {"stop": _told(outputs, batch.truth.stop)}
    pixels = auxiliary_loss(wide, batch.panorama_tags) + auxiliary_loss(far, batch.telephoto_tags)
    loss = AUXILIARY_WEIGHT * pixels
    for name, part in parts.items():
        loss = loss + _CAUSE_WEIGHTS[name] * part
    return loss, {**{name: part.item() for name, part in parts.items()}, "pixels": pixels.item()}


def _cause_losses(outputs: Tensor, truth: Truth) -> dict[str, Tensor]:
    causes = causes_of(outputs)
    asked = truth.light >= 0
    light = functional.cross_entropy(causes.light, truth.light.clamp(min=0), reduction="none")
    known = torch.isfinite(truth.distance)
    off = (causes.distance - torch.nan_to_num(truth.distance)) / DISTANCE_UNIT
    far = functional.smooth_l1_loss(off, torch.zeros_like(off), beta=0.2, reduction="none")
    return {
        "stop": _told(causes.stop, truth.stop),
        "light": _mean(light, asked),
        "sign": _told(causes.sign, truth.sign),
        "others": _told(causes.others, truth.others),
        "distance": _mean(far, known),
    }


def _told(logits: Tensor, truth: Tensor) -> Tensor:
    """Cross entropy (B,) of truths 0 and 1; those below are not asked."""
    asked = truth >= 0
    target = truth.clamp(min=0).to(logits.dtype)
    return _mean(functional.binary_cross_entropy_with_logits(logits, target, reduction="none"), asked)


def _mean(values: Tensor, asked: Tensor) -> Tensor:
    return (values * asked).sum() / asked.sum().clamp(min=1)


def _as_truth(truth: Signals) -> Truth:
    stop, light, sign, others = map(torch.from_numpy, (truth.stop, truth.light, truth.sign, truth.others))
    return Truth(stop, light, sign, others, torch.from_numpy(truth.distance.astype(np.float32)))


def _staged(given: StageInput, data: Dataset | None) -> StagedFrames | None:
    folder = given.folders.get("approaches")
    return StagedFrames(painted_folder(folder, data), data) if folder is not None and data is not None else None


def _staged_places(staged: StagedFrames) -> NDArray[np.int64]:
    return np.stack([np.full(len(staged), _STAGED), np.arange(len(staged))], axis=1)


def _bars(outputs: Tensor, truth: Signals, number: int) -> list[float]:
    """Bars 0 to 1: what is so, what is told."""
    if outputs.ndim == 1:
        return [float(truth.stop[number]), float(outputs.sigmoid()[0])]
    causes = causes_of(outputs)
    lit = causes.light.softmax(dim=1)[0, 1:3].sum()
    told = float(lit), float(causes.sign.sigmoid()[0]), float(causes.others.sigmoid()[0])
    so = truth.light[number] in (1, 2), truth.sign[number] == 1, truth.others[number] == 1
    return [share for pair in zip(map(float, so), told, strict=True) for share in pair]
