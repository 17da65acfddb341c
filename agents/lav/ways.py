"""Ways: where the ego drove on from a frame, however long it stood; and what is learnt of them where no plan is.

Braking frames hold no plan: what stops the ego is told by the collision check and by the brake network. They do hold
where it goes on. Windows that are moved aside lead back to the way gently, as a driver would, and not in one step.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import TIME_STEP
from agents.lav.frames import planner_from_vehicle, planner_from_world, world_from_planner
from lavsim.dataset.tables import Table

METRES = 32  # points of a way after its first, a metre apart
PULL_AWAY = 2.0  # [m/s²] the expert's median from standing, over its first two and a half seconds
_BACK, _BACK_MORE = 4.0, 3.0  # [m] in which a plan is back on its way, and more for each metre aside
_LEAST = 1e-3  # [m]


def driven_way(table: Table, first: int) -> NDArray[np.float64]:
    """(METRES + 1, 2) the way from frame `first` on in its planner frame [m]; behind the last frame, its route."""
    pose, yaw = table["position"][first, :2], float(table["yaw"][first])
    driven = table["position"][first:, :2]
    route = world_from_planner(
        planner_from_vehicle(table["route"][-1].astype(np.float64)), driven[-1], float(table["yaw"][-1])
    )
    ahead = table["route"][-1][:, 0] > 0.0
    points = np.concatenate([driven, route[ahead]])
    step = np.hypot(*np.diff(points, axis=0).T)
    moves = np.concatenate([[True], step > _LEAST])
    points, length = points[moves], np.concatenate([[0.0], np.cumsum(step[moves[1:]])])
    if len(points) < 2:
        points, length = pose + np.array([[0.0, 0.0], [np.cos(yaw), np.sin(yaw)]]), np.array([0.0, 1.0])
    along = np.stack([_extended(np.arange(METRES + 1.0), length, points[:, k]) for k in range(2)], axis=1)
    return planner_from_world(along, pose, yaw)


def _extended(at: NDArray[np.float64], length: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at lengths; beyond the last they go on as they went."""
    slope = (values[-1] - values[-2]) / (length[-1] - length[-2])
    return np.interp(at, length, values) + slope * np.maximum(at - length[-1], 0.0)


def led_back(paths: Tensor, shift: Tensor) -> Tensor:
    """Paths (B, T, 2) that begin `shift` (B, 2) [m] beside where they did, and come back."""
    zero = torch.zeros_like(paths[:, :1])
    length = torch.diff(paths, dim=1, prepend=zero).norm(dim=-1).cumsum(dim=1)
    reach = _BACK + _BACK_MORE * shift.norm(dim=-1)
    share = (length / reach[:, None]).clamp(max=1.0)
    left = 1.0 - share * share * (3.0 - 2.0 * share)
    return paths + left[..., None] * shift[:, None]


def pulled_away(ways: Tensor, steps: int) -> Tensor:
    """(B, T, 2) where an ego is that starts now from standing along ways (B, METRES + 1, 2)."""
    time = TIME_STEP * torch.arange(1, steps + 1, dtype=ways.dtype)
    at = (0.5 * PULL_AWAY * time * time).clamp(max=METRES - _LEAST)
    before = at.long()
    part = (at - before)[None, :, None]
    return ways[:, before] * (1.0 - part) + ways[:, before + 1] * part


def way_loss(paths: Tensor, ways: Tensor) -> Tensor:
    """Mean distance (...) of paths (B, ..., T, 2) from ways (B, P, 2), across them: how fast says nothing."""
    flat = paths.reshape(len(paths), -1, 2)
    nearest = torch.cdist(flat.detach(), ways).argmin(dim=-1)
    along = torch.gradient(ways, dim=1)[0]
    across = torch.stack([-along[..., 1], along[..., 0]], dim=-1)
    across = across / across.norm(dim=-1, keepdim=True).clamp(min=_LEAST)
    index = nearest[..., None].expand(-1, -1, 2)
    offset = ((flat - ways.gather(1, index)) * across.gather(1, index)).sum(dim=-1)
    return offset.abs().reshape(paths.shape[:-1]).mean(dim=-1)
