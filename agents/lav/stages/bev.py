"""The privileged teacher learns everybody's motion from true labels (paper, section 3.3; reference `lav.md` 5)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import TIME_STEP
from agents.lav.labels import MotionSamples, read_motions
from agents.lav.models.crop import to_own, to_planner
from agents.lav.models.motion import chosen, command_loss, nearest_branch_loss, path_loss
from agents.lav.models.teacher import Motions, make_teacher
from agents.lav.stages.base import STAGES, Stage, StageInput, StepContext, TrainConfig
from lavsim.random import Draws

OTHERS = 5  # vehicles beside the ego a sample, at most
OTHERS_WEIGHT = 0.5  # of others' loss in the end
COMMAND_WEIGHT = 0.1
SMOOTHING = 0.2  # of the command's label
TURN_WEIGHT = (5.0, 5.0, 5.0, 1.0, 1.0, 1.0)  # turns are rare, and refinement would forget them
LAMBDA_SHARE = 0.04  # of the run after which others count by a fifth: earlier, branches collapse to one
TURN_JITTER, SHIFT_JITTER = np.radians(30.0), 2.5  # of the ego's window [rad], [m]
OTHERS_TURN, OTHERS_SHIFT = np.radians(20.0), 1.5  # of others' windows
_MOVES = 1.0  # [m/s] slower frames are left out of the measures
_CHUNK = 256


@STAGES.register("bev")
class BevStage(Stage):
    """Plans of the ego by command and refined, forecasts of others by their nearest branch, and the likely command."""

    defaults: ClassVar[TrainConfig] = TrainConfig(batch=64, epochs=10.0, schedule="halving", learning_rate=1e-3)

    def __init__(self, given: StageInput) -> None:
        torch.manual_seed(given.train.seed)
        self.network = make_teacher(given.config)
        self._samples = read_motions(given.data, given.config)
        self._unseen = read_motions(given.validation, given.config) if given.validation is not None else None

    def __len__(self) -> int:
        return len(self._samples)

    def loss(self, samples: NDArray[np.int64], context: StepContext) -> tuple[Tensor, dict[str, float]]:
        batch = draw_batch(self._samples, samples, context.draws)
        return teacher_loss(self.network(batch.images, batch.poses, batch.goals), batch, context.progress)

    def measure(self) -> dict[str, float]:
        return measures_of(self.network, self._unseen) if self._unseen is not None else {}


class Batch:
    """Tensors of some samples under one draw of jitter.

    Attributes:
        images: (B, L, rows, cols).
        poses: (B, R, 3) the ego first.
        futures: (B, R, T, 2) in the frames of `poses`.
        is_real: (B, R).
        commands: (B,).
        goals: (B, 2) in the ego's jittered frame.
        brakes: (B,) bool.
    """

    def __init__(self, samples: MotionSamples, index: NDArray[np.int64], keep: NDArray[np.int64], jitter: Tensor):
        rows = index[:, None]
        still = torch.from_numpy(samples.poses[rows, keep])
        futures = torch.from_numpy(samples.futures[rows, keep])
        self.poses = still + jitter
        self.futures = to_own(to_planner(futures, still), self.poses)
        goals = torch.from_numpy(samples.goal[index])
        self.goals = to_own(goals[:, None], self.poses[:, 0])[:, 0]
        self.images = samples.images(index)
        self.is_real = torch.from_numpy(samples.is_real[rows, keep])
        self.commands = torch.from_numpy(samples.command[index])
        self.brakes = torch.from_numpy(samples.brake[index])


def draw_batch(samples: MotionSamples, index: NDArray[np.int64], draws: Draws) -> Batch:
    """Samples with jittered windows and a drawn choice of others."""
    count, most = len(index), samples.is_real.shape[1]
    strength = draws.stream("others").uniform(0, count * most).reshape(count, most)
    strength[~samples.is_real[index]] += 2.0
    strength[:, 0] = -1.0
    keep = np.argsort(strength, axis=1, kind="stable")[:, : OTHERS + 1]
    shape = (count, keep.shape[1])
    unit = draws.stream("jitter").uniform(0, 2 * shape[0] * shape[1], -1.0, 1.0).reshape(2, *shape)
    shift, turn = unit[0] * OTHERS_SHIFT, unit[1] * OTHERS_TURN
    shift[:, 0], turn[:, 0] = unit[0, :, 0] * SHIFT_JITTER, unit[1, :, 0] * TURN_JITTER
    jitter = np.stack([shift, np.zeros(shape), turn], axis=-1)
    return Batch(samples, index, keep, torch.from_numpy(jitter.astype(np.float32)))


def plain_batch(samples: MotionSamples, index: NDArray[np.int64]) -> Batch:
    """Samples as they are, with all others."""
    most = samples.is_real.shape[1]
    keep = np.broadcast_to(np.arange(most), (len(index), most))
    return Batch(samples, index, keep, torch.zeros(len(index), most, 3))


def teacher_loss(motions: Motions, batch: Batch, progress: float) -> tuple[Tensor, dict[str, float]]:
    """The teacher's loss at a share of the run, and its parts; others count little at first."""
    ego, others = _ego_loss(motions, batch), _others_loss(motions, batch)
    command = command_loss(motions.commands[:, 0], batch.commands, SMOOTHING).mean()
    weight = OTHERS_WEIGHT * (1.0 - 0.8 ** (progress / LAMBDA_SHARE))
    total = ego + weight * others + COMMAND_WEIGHT * command
    return total, {"ego": ego.item(), "others": others.item(), "command": command.item()}


def _ego_loss(motions: Motions, batch: Batch) -> Tensor:
    """The coarse branch of the command and all refinements of it; full stops have causes that labels don't show."""
    future = batch.futures[:, 0]
    weight = torch.tensor(TURN_WEIGHT)[batch.commands] * ~batch.brakes
    coarse = path_loss(chosen(motions.coarse[:, 0], batch.commands), future)
    refined = path_loss(motions.refined, future[:, None, None])
    each = coarse + (refined.mean(dim=(1, 2)) if refined.shape[1] else 0.0)
    return (each * weight).sum() / weight.sum().clamp(min=1.0)


def _others_loss(motions: Motions, batch: Batch) -> Tensor:
    real = batch.is_real[:, 1:]
    if not bool(real.any()):
        return motions.coarse.sum() * 0.0
    return nearest_branch_loss(motions.coarse[:, 1:][real], batch.futures[:, 1:][real]).mean()


def measures_of(network: torch.nn.Module, samples: MotionSamples) -> dict[str, float]:
    """Errors on frames in which the ego drives and is not braking [m], beside constant velocity."""
    moves = np.flatnonzero(~samples.brake & (samples.speed > _MOVES))
    sums: dict[str, list[Tensor]] = {}
    for begin in range(0, len(moves), _CHUNK):
        index = moves[begin : begin + _CHUNK]
        batch = plain_batch(samples, index)
        motions: Motions = network(batch.images, batch.poses, batch.goals)
        for name, values in _errors(motions, batch, torch.from_numpy(samples.speed[index])).items():
            sums.setdefault(name, []).append(values)
    return {name: float(torch.cat(values).mean().detach()) for name, values in sums.items()} | {"frames": float(len(moves))}


def _errors(motions: Motions, batch: Batch, speed: Tensor) -> dict[str, Tensor]:
    future = batch.futures[:, 0]
    plans = motions.refined[:, -1] if motions.refined.shape[1] else motions.coarse[:, 0]
    plan, coarse = chosen(plans, batch.commands), chosen(motions.coarse[:, 0], batch.commands)
    steps = torch.arange(1, future.shape[1] + 1) * TIME_STEP
    constant = torch.stack([torch.zeros(len(speed), len(steps)), -speed[:, None] * steps], dim=-1)
    real = batch.is_real.clone()
    real[:, 0] = False
    real &= torch.linalg.vector_norm(batch.futures[:, :, -1], dim=-1) > _MOVES * float(steps[-1])
    others = _displacement(motions.coarse[real], batch.futures[real][:, None]).amin(dim=1)
    likeliest = motions.commands[:, 0].argmax(dim=1)
    return {
        "plan": _displacement(plan, future),
        "plan_lateral": (plan - future)[..., 0].abs().mean(dim=1),
        "coarse": _displacement(coarse, future),
        "constant_velocity": _displacement(constant, future),
        "others_nearest_branch": others,
        "command_accuracy": (likeliest == batch.commands).float(),
    }


def _displacement(paths: Tensor, targets: Tensor) -> Tensor:
    """Mean distance (...) between paths (..., T, 2)."""
    return torch.linalg.vector_norm(paths - targets, dim=-1).mean(dim=-1)
