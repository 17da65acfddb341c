"""The privileged teacher learns everybody's motion from true labels (paper, section 3.3; reference `lav.md` 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.batches import Batch, draw_batch, worth_learning
from agents.lav.labels import read_motions
from agents.lav.models.motion import chosen, command_loss, nearest_branch_loss, path_loss
from agents.lav.models.teacher import Motions, make_teacher
from agents.lav.motion_measures import measures_of
from agents.lav.motion_pictures import teacher_sheet
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from agents.lav.ways import way_loss
from lavsim.random import Draws

OTHERS_WEIGHT = 0.5  # of others' loss in the end
COMMAND_WEIGHT = 0.1
SMOOTHING = 0.2  # of the command's label
TURN_WEIGHT = (5.0, 5.0, 5.0, 1.0, 1.0, 1.0)  # turns are rare, and refinement would forget them
DRIVEN_SHARE = 0.5  # of the refinements' loss, of the commanded branch alone
WAY_WEIGHT = 1.0  # of the distance from the way
LAMBDA_SHARE = 0.04  # of the run after which others count by a fifth: earlier, branches collapse to one


@STAGES.register("bev")
class BevStage(Stage):
    """Plans of the ego by command and refined, forecasts of others by their nearest branch, and the likely command."""

    defaults: ClassVar[TrainConfig] = TrainConfig(batch=64, epochs=8.0, learning_rate=1.5e-3, precision="auto")
    sizes: ClassVar[Sequence[str]] = ("grid", "crop", "motion", "temporal", "training.others")

    def __init__(self, given: StageInput) -> None:
        self._others, self._grid = given.config.training.others, given.config.grid
        torch.manual_seed(given.train.seed)
        self.network = make_teacher(given.config)
        self._samples = read_motions(given.data, given.config)
        self._chosen = worth_learning(self._samples, Draws.of_seed(given.train.seed).stream("windows"))
        self._unseen = read_motions(given.validation, given.config) if given.validation is not None else None

    def __len__(self) -> int:
        return len(self._chosen)

    def load(self, samples: NDArray[np.int64], draws: Draws) -> Batch:
        return draw_batch(self._samples, self._chosen[samples], draws)

    def loss(self, batch: Batch, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        motions = self.network(batch.images, batch.poses, batch.goals, batch.speeds, batch.is_real)
        return teacher_loss(motions, batch, context.progress, self._others)

    def measure(self) -> dict[str, float]:
        return measures_of(self.network, self._unseen) if self._unseen is not None else {}

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        if self._unseen is None:
            return {}
        return {"unseen": teacher_sheet(self.network, self._unseen, self._grid)}


def teacher_loss(
    motions: Motions, batch: Batch, progress: float, with_others: bool = True
) -> tuple[Tensor, dict[str, float]]:
    """The teacher's loss at a share of the run, and its parts; others count little at first, or not at all."""
    ego, others = _ego_loss(motions, batch), _others_loss(motions, batch)
    command = command_loss(motions.commands[:, 0], batch.commands, SMOOTHING).mean()
    weight = OTHERS_WEIGHT * (1.0 - 0.8 ** (progress / LAMBDA_SHARE)) * with_others
    total = ego + weight * others + COMMAND_WEIGHT * command
    return total, {"ego": ego.item(), "others": others.item(), "command": command.item()}


def _ego_loss(motions: Motions, batch: Batch) -> Tensor:
    """The coarse branch of the command and all refinements; full stops have causes that labels don't show.

    All branches are refined towards the one future, as in the paper. The branch that is driven counts as much as all of
    them: most have never met the scene of another command, and a small refiner spends itself on them. Frames that brake
    teach the way.
    """
    future, turns = batch.futures[:, 0], torch.tensor(TURN_WEIGHT)[batch.commands]
    coarse = chosen(motions.coarse[:, 0], batch.commands)
    each, aside = path_loss(coarse, future), way_loss(coarse, batch.ways)
    if motions.refined.shape[1]:
        refined = path_loss(motions.refined, future[:, None, None])
        driven = chosen(motions.refined, batch.commands)
        each = each + (1.0 - DRIVEN_SHARE) * refined.mean(dim=(1, 2))
        each = each + DRIVEN_SHARE * path_loss(driven, future[:, None]).mean(dim=1)
        aside = aside + way_loss(driven, batch.ways).mean(dim=1)
    return _weighted(each, turns * batch.plans) + WAY_WEIGHT * _weighted(aside, turns * batch.leads)


def _weighted(values: Tensor, weight: Tensor) -> Tensor:
    return (values * weight).sum() / weight.sum().clamp(min=1.0)


def _others_loss(motions: Motions, batch: Batch) -> Tensor:
    real = batch.is_real[:, 1:]
    if not bool(real.any()):
        return motions.coarse.sum() * 0.0
    return nearest_branch_loss(motions.coarse[:, 1:][real], batch.futures[:, 1:][real]).mean()
