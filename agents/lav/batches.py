"""Tensors of some windows for the motion networks: which of them are learnt from, jittered, and as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.labels import MotionSamples
from agents.lav.models.crop import to_own, to_planner
from lavsim.random import Draws

OTHERS = 3  # vehicles beside the ego a sample, at most
# Less than the paper's 30 degrees and 2.5 m, 20 degrees and 1.5 m: our drives have noise on their control.
TURN_JITTER, SHIFT_JITTER = np.radians(20.0), 1.5  # of the ego's window [rad], [m]; small ones are commoner
OTHERS_TURN, OTHERS_SHIFT = np.radians(10.0), 0.8  # of others' windows
SPEED_NOISE = 0.4  # [m/s] of others' speeds: a tracker is that far off
EGO_SPEED_NOISE = 0.15  # [m/s]
UNKNOWN = 0.1  # share of speeds that are not told
STANDS = 0.3  # [m/s]
BENDS = 1.5  # [m] aside at the end of a window
STANDING_KEPT, BRAKING_KEPT, BENDS_AGAIN = 0.1, 0.5, 1  # of windows; how often more


@dataclass(frozen=True)
class Batch:
    """Tensors of some samples under one draw of jitter.

    Attributes:
        images: (B, L, rows, cols).
        poses: (B, R, 3) the ego first.
        futures: (B, R, T, 2) in the frames of `poses`.
        is_real: (B, R).
        speeds: (B, R) [m/s], NaN where it is not told.
        commands: (B,).
        goals: (B, 2, 2) in the ego's jittered frame.
        brakes: (B,) bool, whether the expert made a full stop.
        plans: (B,) bool, whether the ego's future teaches to plan.
    """

    images: Tensor
    poses: Tensor
    futures: Tensor
    is_real: Tensor
    speeds: Tensor
    commands: Tensor
    goals: Tensor
    brakes: Tensor
    plans: Tensor


def draw_batch(samples: MotionSamples, index: NDArray[np.int64], draws: Draws) -> Batch:
    """Samples with jittered windows, uncertain speeds, and a drawn choice of others."""
    count, most = len(index), samples.is_real.shape[1]
    strength = draws.stream("others").uniform(0, count * most).reshape(count, most)
    strength[~samples.is_real[index]] += 2.0
    strength[:, 0] = -1.0
    some = min(int(samples.is_real[index].sum(axis=1).max()), OTHERS + 1)
    keep = np.argsort(strength, axis=1, kind="stable")[:, :some]
    shape = (count, keep.shape[1])
    batch = _batch(samples, index, keep, _jitter(draws, shape))
    noise = draws.stream("speed").normal(0, shape[0] * shape[1]).reshape(shape)
    noise *= np.where(np.arange(shape[1]) == 0, EGO_SPEED_NOISE, SPEED_NOISE)
    noise[draws.stream("unknown").uniform(0, noise.size).reshape(shape) < UNKNOWN] = np.nan
    return replace(batch, speeds=(batch.speeds + torch.from_numpy(noise.astype(np.float32))).clamp(min=0.0))


def plain_batch(samples: MotionSamples, index: NDArray[np.int64]) -> Batch:
    """Samples as they are, with all others."""
    most = samples.is_real.shape[1]
    keep = np.broadcast_to(np.arange(most), (len(index), most))
    return _batch(samples, index, keep, torch.zeros(len(index), most, 3))


def worth_learning(samples: MotionSamples, draws: Draws) -> NDArray[np.int64]:
    """Numbers of the windows to learn from: few that stand, fewer that brake, bends twice.

    Half of a town's drive is waiting; those frames hold no plan, and of others little but queues.
    """
    drawn = draws.uniform(0, len(samples))
    stands = samples.speed < STANDS
    share = np.where(samples.plans, 1.0, np.where(stands, STANDING_KEPT, BRAKING_KEPT))
    bends = samples.plans & (np.abs(samples.futures[:, 0, -1, 0]) > BENDS)
    times = np.where(drawn < share, 1 + BENDS_AGAIN * bends, 0)
    return np.repeat(np.arange(len(samples)), times)


def _batch(samples: MotionSamples, index: NDArray[np.int64], keep: NDArray[np.int64], jitter: Tensor) -> Batch:
    """The vehicles `keep` (B, R) of samples `index` (B,), their windows moved by `jitter` (B, R, 3)."""
    rows = index[:, None]
    still = torch.from_numpy(samples.poses[rows, keep])
    poses = still + jitter
    futures = to_planner(torch.from_numpy(samples.futures[rows, keep]), still)
    return Batch(
        images=samples.images(index),
        poses=poses,
        futures=to_own(futures, poses),
        is_real=torch.from_numpy(samples.is_real[rows, keep]),
        speeds=torch.from_numpy(samples.speeds[rows, keep]),
        commands=torch.from_numpy(samples.command[index]),
        goals=to_own(torch.from_numpy(samples.goals[index]), poses[:, 0]),
        brakes=torch.from_numpy(samples.brake[index]),
        plans=torch.from_numpy(samples.plans[index]),
    )


def _jitter(draws: Draws, shape: tuple[int, int]) -> Tensor:
    """(B, R, 3) shifts aside [m] and turns [rad] of windows."""
    unit = draws.stream("jitter").uniform(0, 2 * shape[0] * shape[1], -1.0, 1.0).reshape(2, *shape)
    small = draws.stream("small jitter").uniform(0, shape[0])
    shift, turn = unit[0] * OTHERS_SHIFT, unit[1] * OTHERS_TURN
    shift[:, 0], turn[:, 0] = unit[0, :, 0] * SHIFT_JITTER * small, unit[1, :, 0] * TURN_JITTER * small
    jitter = np.stack([shift, np.zeros(shape), turn], axis=-1)
    return torch.from_numpy(jitter.astype(np.float32))
