"""How good plans and forecasts are on frames of a dataset, beside baselines without a network."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.lav.batches import Batch, plain_batch
from agents.lav.labels import MotionSamples
from agents.lav.models.motion import chosen, straight_on
from agents.lav.models.teacher import Motions

MOVES = 1.0  # [m/s] slower egos and others are left out
_CHUNK = 256


Foresee = Callable[[NDArray[np.int64], Batch], Motions]  # of samples' numbers and tensors


def measures_of(network: nn.Module, samples: MotionSamples) -> dict[str, float]:
    """`measures_with` of a network on labels."""
    return measures_with(
        lambda _, batch: network(batch.images, batch.poses, batch.goals, batch.speeds, batch.is_real), samples
    )


def measures_with(foresee: Foresee, samples: MotionSamples, chunk: int = _CHUNK) -> dict[str, float]:
    """Mean errors [m] of plans, of forecasts and of their baselines, and the shares of commands told right.

    Plans count on frames in which the ego drives and does not brake, forecasts of the vehicles that drive on all
    frames, commands on both. An error is the mean distance over all points of a path; the lateral one is its part
    across the true path.
    """
    sums: dict[str, list[Tensor]] = {}
    for begin in range(0, len(samples), chunk):
        index = np.arange(begin, min(begin + chunk, len(samples)))
        batch = plain_batch(samples, index)
        motions = foresee(index, batch)
        centre = torch.from_numpy(samples.centre[index])
        for name, values in {**_plan_errors(motions, batch, centre), **_others_errors(motions, batch)}.items():
            sums.setdefault(name, []).append(values.detach())
    means = {name: float(torch.cat(values).mean()) for name, values in sums.items() if sum(map(len, values))}
    return means | {
        "frames": float(sum(map(len, sums["plan"]))),
        "others": float(sum(map(len, sums["others_nearest"]))),
    }


def _plan_errors(motions: Motions, batch: Batch, centre: Tensor) -> dict[str, Tensor]:
    counts = ~batch.brakes & (batch.speeds[:, 0] > MOVES)
    future, commands = batch.futures[counts, 0], batch.commands[counts]
    refined, coarse = motions.refined[counts], motions.coarse[counts, 0]
    plan = chosen(refined[:, -1] if refined.shape[1] else coarse, commands)
    straight = straight_on(batch.speeds[counts, 0], future.shape[1])
    return {
        "plan": displacement(plan, future),
        "plan_last": torch.linalg.vector_norm(plan[:, -1] - future[:, -1], dim=-1),
        "plan_lateral": lateral(plan, future),
        "coarse": displacement(chosen(coarse, commands), future),
        "constant_velocity": displacement(straight, future),
        "constant_velocity_lateral": lateral(straight, future),
        "route_centre": displacement(centre[counts], future),
        "route_centre_lateral": lateral(centre[counts], future),
        "command_accuracy": (motions.commands[counts, 0].argmax(dim=1) == commands).float(),
        "command_follow": (commands == 3).float(),
    }


def _others_errors(motions: Motions, batch: Batch) -> dict[str, Tensor]:
    counts = batch.is_real & (batch.speeds > MOVES)
    counts[:, 0] = False
    paths, futures = motions.coarse[counts], batch.futures[counts]
    likeliest = motions.commands[counts].argmax(dim=1)
    return {
        "others_nearest": displacement(paths, futures[:, None]).amin(dim=1),
        "others_likeliest": displacement(chosen(paths, likeliest), futures),
        "others_constant_velocity": displacement(straight_on(batch.speeds[counts], futures.shape[1]), futures),
    }


def displacement(paths: Tensor, targets: Tensor) -> Tensor:
    """Mean distance (...) between paths (..., T, 2)."""
    return torch.linalg.vector_norm(paths - targets, dim=-1).mean(dim=-1)


def lateral(paths: Tensor, targets: Tensor) -> Tensor:
    """Mean distance (...) of paths (..., T, 2) across the directions that targets run in; ahead where they stand."""
    before = torch.cat([torch.zeros_like(targets[..., :1, :]), targets[..., :-1, :]], dim=-2)
    step = targets - before
    length = torch.linalg.vector_norm(step, dim=-1, keepdim=True)
    ahead = torch.where(length > 0.05, step / length.clamp(min=1e-6), torch.tensor([0.0, -1.0]))
    offset = paths - targets
    return (offset[..., 0] * ahead[..., 1] - offset[..., 1] * ahead[..., 0]).abs().mean(dim=-1)
