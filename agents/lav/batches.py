"""Tensors of some windows for the motion networks: which of them are learnt from, jittered, and as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from agents.lav.config import GridConfig
from agents.lav.labels import MotionSamples
from agents.lav.models.crop import to_own, to_planner
from agents.lav.ways import led_back, pulled_away
from lavsim.random import Draws

OTHERS = 3  # vehicles beside the ego a sample, at most
TURN_JITTER, SHIFT_JITTER = np.radians(20.0), 1.5  # of the ego's window [rad], [m]; small ones are commoner
# Some windows lie a lane beside the way: the paper's 2.5 m do not teach which lane the goal lies on.
LOST, LOST_SHIFT = 0.5, 4.5  # share of them, [m]
OTHERS_TURN, OTHERS_SHIFT = np.radians(10.0), 0.8  # of others' windows
SPEED_NOISE = 0.4  # [m/s] of others' speeds: a tracker is that far off
EGO_SPEED_NOISE = 0.15  # [m/s]
UNKNOWN = 0.1  # share of speeds that are not told
STANDS = 0.3  # [m/s]
BENDS = 1.5  # [m] aside at the end of a window
VEHICLE_LAYER = 1  # of the labels
_PIXEL = 0.25  # [m] of recorded labels; they set whatever a box touches, about half a pixel more than its size
STANDING_KEPT, BRAKING_KEPT, BENDS_AGAIN = 0.3, 0.7, 1  # of windows; how often more


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
        ways: (B, P, 2) where the ego goes on, in its jittered frame [m].
        leads: (B,) bool, whether its way teaches.
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
    ways: Tensor
    leads: Tensor


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

    Half of a town's drive is waiting; those frames hold no plan but a way, and of others little but queues.
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
    ways = torch.from_numpy(samples.ways[index])
    starts = torch.from_numpy(samples.holds[index] & (samples.speed[index] < STANDS))
    # Who stands is taught to pull away: what holds it is told by others, and few frames show it start.
    futures[starts, 0] = pulled_away(ways[starts], futures.shape[2])
    futures[:, 0] = led_back(futures[:, 0], jitter[:, 0, :2])
    plans = torch.from_numpy(samples.plans[index])
    images = samples.images(index)
    _move_ego(images[:, VEHICLE_LAYER], poses[:, 0], samples.half, samples.grid)
    return Batch(
        images=images,
        poses=poses,
        futures=to_own(futures, poses),
        is_real=torch.from_numpy(samples.is_real[rows, keep]),
        speeds=torch.from_numpy(samples.speeds[rows, keep]),
        commands=torch.from_numpy(samples.command[index]),
        goals=to_own(torch.from_numpy(samples.goals[index]), poses[:, 0]),
        brakes=torch.from_numpy(samples.brake[index]),
        plans=plans | starts,
        ways=to_own(led_back(ways, jitter[:, 0, :2]), poses[:, 0]),
        leads=plans | torch.from_numpy(samples.holds[index]),
    )


def _move_ego(images: Tensor, poses: Tensor, half: tuple[float, float], grid: GridConfig) -> None:
    """Draws the ego in images (B, H, W) at poses (B, 3) and no more at the origin, whence a plan could tell its jitter.

    As in recorded labels, a cell is set if one of its pixels is.
    """
    reach = max(half) + _PIXEL / 2.0 + abs(poses[:, :2]).max().item() + grid.cell
    rows, cols = (_around(origin, reach, grid.cell, most) for origin, most in
                  ((grid.ahead, images.shape[1]), (grid.aside, images.shape[2])))  # fmt: skip
    own = _inside(torch.zeros(1, 3), half, rows, cols, grid)
    found = _inside(poses, half, rows, cols, grid)
    cut = images[:, rows, cols]
    images[:, rows, cols] = torch.where(own, torch.zeros_like(cut), cut).maximum(found.to(cut.dtype))


def _around(origin: float, reach: float, cell: float, most: int) -> slice:
    """Cells within `reach` of the ego's origin along an axis on which it lies at `origin` [m]."""
    return slice(max(int((origin - reach) / cell), 0), min(int((origin + reach) / cell) + 1, most))


def _inside(poses: Tensor, half: tuple[float, float], rows: slice, cols: slice, grid: GridConfig) -> Tensor:
    """(B, rows, cols) whether boxes at poses (B, 3) lie on cells."""
    parts = max(round(grid.cell / _PIXEL), 1)
    y, x = (
        (torch.arange(cells.start * parts, cells.stop * parts) + 0.5) * (grid.cell / parts) - origin
        for cells, origin in ((rows, grid.ahead), (cols, grid.aside))
    )
    places = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)
    own = to_own(places.reshape(1, -1, 2), poses)
    is_in = (own[..., 0].abs() < half[1] + _PIXEL / 2.0) & (own[..., 1].abs() < half[0] + _PIXEL / 2.0)
    return functional.max_pool2d(is_in.reshape(len(poses), *places.shape[:2]).float(), parts) > 0.0


def _jitter(draws: Draws, shape: tuple[int, int]) -> Tensor:
    """(B, R, 3) shifts aside [m] and turns [rad] of windows."""
    unit = draws.stream("jitter").uniform(0, 2 * shape[0] * shape[1], -1.0, 1.0).reshape(2, *shape)
    small = draws.stream("small jitter").uniform(0, shape[0])
    is_lost = draws.stream("lost").uniform(0, shape[0]) < LOST
    shift, turn = unit[0] * OTHERS_SHIFT, unit[1] * OTHERS_TURN
    shift[:, 0] = unit[0, :, 0] * np.where(is_lost, LOST_SHIFT, SHIFT_JITTER * small)
    turn[:, 0] = unit[1, :, 0] * TURN_JITTER * small
    jitter = np.stack([shift, np.zeros(shape), turn], axis=-1)
    return torch.from_numpy(jitter.astype(np.float32))
