"""The stage `cloning`: the expert's own way, learnt from what the cameras saw. No part of LAV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.cloning.measures import measures_of
from agents.cloning.network import CloningNetwork
from agents.cloning.samples import CloningSamples, read_samples, worth_learning
from agents.lav.config import LavConfig
from agents.lav.data.arrays import FRONT, grid_layers
from agents.lav.data.augment import augmented
from agents.lav.data.images import as_batch, panorama, require_fields
from agents.lav.data.pictures import TRUTH, draw_path, map_picture
from agents.lav.data.show import SHOWN, column, fitted, sheet
from agents.lav.data.windows import bev_config
from agents.lav.models.motion import chosen, path_loss
from agents.lav.models.resnet import memory_format
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws

SPEED_NOISE = 0.15  # [m/s]
UNKNOWN = 0.4  # share of speeds that are not told
PLAN, VEHICLE, WALKER = (255, 140, 30), (70, 120, 220), (220, 60, 90)
_CHUNK = 32


class CloningBatch(NamedTuple):
    """Frames to learn from.

    Attributes:
        panorama: (B, 3, H, 3 W) uint8.
        speeds: (B,) [m/s], NaN where it is not told.
        goals: (B, 2, 2) [m].
        commands: (B,).
        futures: (B, T, 2) [m].
    """

    panorama: Tensor
    speeds: Tensor
    goals: Tensor
    commands: Tensor
    futures: Tensor


@STAGES.register("cloning")
class CloningStage(Stage):
    """Learns by each command's branch where the expert drove on, stops included."""

    is_lav: ClassVar[bool] = False
    defaults: ClassVar[TrainConfig] = TrainConfig(batch=16, epochs=2.5, learning_rate=2e-3, precision="auto")
    sizes: ClassVar[Sequence[str]] = (
        "cameras", "brake.depth", "brake.width", "motion.waypoints", "motion.coarse_hidden",
    )  # fmt: skip

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        network = CloningNetwork(given.config)
        self.network = network.to(memory_format=memory_format(given.config.brake))  # type: ignore[call-overload]
        self._config, self._data = given.config, given.data
        self._samples = _read(given.data, given.config)
        self._chosen = worth_learning(self._samples)
        self._unseen, self._unseen_data = None, given.validation
        if given.validation is not None:
            self._unseen = _read(given.validation, given.config)

    def __len__(self) -> int:
        return len(self._chosen)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> CloningBatch:
        index, images = self._chosen[samples], []
        for number, (episode, frame) in enumerate(self._samples.places[index].tolist()):
            read = self._data.read(episode, frame, FRONT)
            images.append(augmented(panorama(read, self._config.cameras), draws.stream("image", number)))
        noise = draws.stream("speed").normal(0, len(index), 0.0, SPEED_NOISE)
        noise[draws.stream("unknown").uniform(0, len(index)) < UNKNOWN] = np.nan
        return _batch(self._samples, index, images, noise)

    def loss(self, batch: CloningBatch, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        return cloning_loss(self.network(batch.panorama, batch.speeds, batch.goals), batch), {}

    def measure(self) -> dict[str, float]:
        if self._unseen is None:
            return {}
        return measures_of(self._plans(np.arange(len(self._unseen))), self._unseen, self._config.drive)

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        """What it sees above what is there: its plan in orange, the expert's way in green."""
        if self._unseen is None or self._unseen_data is None:
            return {}
        index = ((np.arange(SHOWN) + 0.5) * len(self._unseen) / SHOWN).astype(np.int64)
        cells, grid = [], self._config.grid
        plans = self._plans(index).numpy()
        for number, plan in zip(index.tolist(), plans, strict=True):
            episode, frame = self._unseen.places[number].tolist()
            read = self._unseen_data.read(episode, frame, (*FRONT, "bev"))
            labels = grid_layers(read["bev"], bev_config(self._unseen_data), grid).astype(bool)
            view = _labelled(labels, self._config)
            draw_path(view, self._unseen.futures[number], grid, TRUTH, 2)
            draw_path(view, plan, grid, PLAN, 2)
            cells.append(column([fitted(panorama(read, self._config.cameras), view.shape[1]), view]))
        return {"unseen": sheet(cells, columns=6)}

    def _plans(self, index: NDArray[np.int64]) -> Tensor:
        """(N, T, 2) of the commanded branch on unseen frames (N,)."""
        assert self._unseen is not None
        assert self._unseen_data is not None
        device, found = next(self.network.parameters()).device, []
        for begin in range(0, len(index), _CHUNK):
            part = index[begin : begin + _CHUNK]
            images = [panorama(self._unseen_data.read(episode, frame, FRONT), self._config.cameras)
                      for episode, frame in self._unseen.places[part].tolist()]  # fmt: skip
            batch = _batch(self._unseen, part, images, np.zeros(len(part)))
            plans = self.network(*(values.to(device) for values in batch[:3]))
            found.append(chosen(plans.detach().cpu().float(), batch.commands))
        return torch.cat(found)


def cloning_loss(plans: Tensor, batch: CloningBatch) -> Tensor:
    """Mean absolute error of the commanded branch of plans (B, 6, T, 2)."""
    return path_loss(chosen(plans, batch.commands), batch.futures).mean()


def _batch(
    samples: CloningSamples, index: NDArray[np.int64], images: list[NDArray[np.uint8]], noise: NDArray[np.float64]
) -> CloningBatch:
    speeds = np.maximum(samples.speeds[index] + noise, 0.0).astype(np.float32)
    parts = (speeds, samples.goals[index], samples.commands[index], samples.futures[index])
    return CloningBatch(as_batch(images), *map(torch.from_numpy, parts))


def _read(data: Dataset, config: LavConfig) -> CloningSamples:
    require_fields(data, FRONT, "cloning")
    return read_samples(data, config)


def _labelled(labels: NDArray[np.bool_], config: LavConfig) -> NDArray[np.uint8]:
    """Roads, marks, vehicles and walkers of labels (5, rows, cols) from above."""
    view = map_picture(labels[[0, 3, 4]], config.grid)
    for layer, colour in ((labels[1], VEHICLE), (labels[2], WALKER)):
        view[cv2.resize(layer.astype(np.uint8), view.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0] = colour
    return view
