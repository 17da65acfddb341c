"""How good plans are on frames of a dataset: how far off while it drives, and whether they stop and start."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.cloning.samples import CloningSamples
from agents.lav.config import DriveConfig
from agents.lav.controller import Controller
from agents.lav.models.motion import straight_on
from agents.lav.motion_measures import MOVES, displacement, lateral


def measures_of(plans: Tensor, samples: CloningSamples, drive: DriveConfig) -> dict[str, float]:
    """Mean errors [m] of plans (N, T, 2) by the rules of the teacher's and the student's, and shares of frames.

    Plans count on frames in which the ego drives and does not brake. A plan stops if whoever drives it brakes.
    """
    futures, speeds = torch.from_numpy(samples.futures), torch.from_numpy(samples.speeds)
    counts = torch.from_numpy(~samples.brakes & (samples.speeds > MOVES))
    plan, future = plans[counts], futures[counts]
    straight = straight_on(speeds[counts], future.shape[1])
    errors = {
        "plan": displacement(plan, future),
        "plan_last": torch.linalg.vector_norm(plan[:, -1] - future[:, -1], dim=-1),
        "plan_lateral": lateral(plan, future),
        "constant_velocity": displacement(straight, future),
        "constant_velocity_lateral": lateral(straight, future),
    }
    found = {name: float(values.mean()) for name, values in errors.items() if len(values)}
    return found | _stops(plans, samples, drive) | {"frames": float(counts.sum())}


def _stops(plans: Tensor, samples: CloningSamples, drive: DriveConfig) -> dict[str, float]:
    """Of full stops, those that are made; of other frames, those in which it brakes; and whether it starts."""
    stops, brakes = told_stops(plans, samples, drive), samples.brakes
    stands = samples.stands
    groups = {
        "recall": (brakes, stops),
        "recall_driving": (brakes & (samples.speeds > MOVES), stops),
        "false_stops": (~brakes, stops),
        "false_stops_driving": (~brakes & (samples.speeds > MOVES), stops),
        "waits": (stands & ~samples.goes, stops),
        "starts": (stands & samples.goes & ~brakes, ~stops),
    }
    found = {name: float(told[group].mean()) for name, (group, told) in groups.items() if group.any()}
    return found | {f"{name}_frames": float(group.sum()) for name, (group, _) in groups.items()}


def told_stops(plans: Tensor, samples: CloningSamples, drive: DriveConfig) -> NDArray[np.bool_]:
    """(N,) whether the controller brakes for plans (N, T, 2)."""
    given = zip(plans.double().numpy(), samples.speeds.tolist(), samples.commands.tolist(), strict=True)
    return np.array([Controller(drive).follow(plan, speed, command).brake > 0.0 for plan, speed, command in given])
