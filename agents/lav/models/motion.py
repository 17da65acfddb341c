"""From a window's embedding to motion: six coarse branches, their refinement towards the goal, the likely commands.

The same layers serve teacher and student, the ego and every other vehicle (paper, section 3.3; reference `lav.md` 4.8).
Paths are in the vehicle's own frame (x right, y backward [m]), `TIME_STEP` apart, the vehicle at the origin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from agents.lav.config import COMMANDS, TIME_STEP, MotionConfig
from agents.lav.models.resnet import STRIDE, ResNet

GOAL_SCALE = 24.0  # [m] of the paper's goal encoding g / 24 - 1
LANE_SCALE, MOST_LANES = 3.0, 5.0  # [m] of a goal's place aside where it tells lanes apart; clipped beyond so many
SPEED_SCALE = 10.0  # [m/s]


class Embedding(nn.Module):
    """A window and, where the configuration says so, its vehicle's speed as a vector (N, D).

    Args:
        config: Sizes.
        channels: Of a window.
        size: Cells of its side.
    """

    def __init__(self, config: MotionConfig, channels: int, size: int) -> None:
        super().__init__()
        features = config.embedding.features
        self.network = ResNet(config.embedding, channels)
        # A mean over the window forgets where things are; a layer over its last cells keeps it.
        cells = math.ceil(size / STRIDE) ** 2
        self.pool = nn.Linear(features * cells, features) if config.pooling == "grid" else None
        self.speed = SpeedInput(features) if config.speeds else None
        self.goal = GoalInput(features, config.goals) if config.goals_embedded else None

    def forward(self, windows: Tensor, speeds: Tensor | None = None, goals: Tensor | None = None) -> Tensor:
        """Vectors of windows (N, C, S, S), speeds (N,) and goals (N, G, 2) [m]; NaN or None where nobody knows."""
        # Convolutions on CPUs are half again as fast with the channels last in memory.
        cells: Tensor = self.network(windows.contiguous(memory_format=torch.channels_last))
        vectors: Tensor = cells.mean(dim=(2, 3)) if self.pool is None else self.pool(cells.flatten(1))
        if self.speed is not None:
            vectors = self.speed(vectors, vectors.new_full((len(vectors),), torch.nan) if speeds is None else speeds)
        if self.goal is not None and goals is not None:
            vectors = self.goal(vectors, goals)
        return vectors


class SpeedInput(nn.Module):
    """Adds what a speed says to a vector (N, D)."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.first = nn.Linear(features + 2, features)
        self.second = nn.Linear(features, features)

    def forward(self, vectors: Tensor, speeds: Tensor) -> Tensor:
        """Vectors that know speeds (N,) [m/s], NaN where they are unknown."""
        known = torch.isfinite(speeds)
        value = torch.where(known, speeds, torch.zeros_like(speeds)) / SPEED_SCALE
        inputs = torch.cat([vectors, value[:, None], known[:, None].to(vectors.dtype)], dim=1)
        added: Tensor = self.second(torch.relu(self.first(inputs)))
        return vectors + added


class GoalInput(nn.Module):
    """Adds what goals say to a vector (N, D): which of several lanes is meant.

    The refiner's encoding, in which a lane's width is an eighth, goes unused: plans moved by 0.2 m for goals 3 m aside.
    It begins as nothing, so that weights without it go on.
    """

    def __init__(self, features: int, goals: int) -> None:
        super().__init__()
        self.first = nn.Linear(features + 3 * goals + 1, features)
        self.second = nn.Linear(features, features)
        nn.init.zeros_(self.second.weight)
        nn.init.zeros_(self.second.bias)

    def forward(self, vectors: Tensor, goals: Tensor) -> Tensor:
        """Vectors that know goals (N, G, 2) in their vehicles' own frames [m], NaN where there are none."""
        known = torch.isfinite(goals[:, 0, :1])
        place = goals.nan_to_num(0.0)
        lanes = (place[..., :1] / LANE_SCALE).clamp(-MOST_LANES, MOST_LANES)
        said = torch.cat([place / GOAL_SCALE, lanes], dim=-1).flatten(1)
        inputs = torch.cat([vectors, said.to(vectors.dtype), known.to(vectors.dtype)], dim=1)
        added: Tensor = self.second(torch.relu(self.first(inputs)))
        return vectors + added


class CommandGrus(nn.Module):
    """Six recurrent branches whose input, the embedding, is the same at every step, run as one.

    Since the input is constant its share of the gates is computed once, and the six recurrences are one batched matrix
    product a step.
    """

    def __init__(self, features: int, hidden: int, steps: int) -> None:
        super().__init__()
        self.steps, self.hidden = steps, hidden
        self.input_weight = nn.Parameter(torch.empty(COMMANDS, 3 * hidden, features))
        self.hidden_weight = nn.Parameter(torch.empty(COMMANDS, 3 * hidden, hidden))
        self.input_bias = nn.Parameter(torch.empty(COMMANDS, 3 * hidden))
        self.hidden_bias = nn.Parameter(torch.empty(COMMANDS, 3 * hidden))
        self.out_weight = nn.Parameter(torch.empty(COMMANDS, 2, hidden))
        self.out_bias = nn.Parameter(torch.empty(COMMANDS, 2))
        for parameter in self.parameters():  # as torch's own GRU and linear layers begin
            nn.init.uniform_(parameter, -(hidden**-0.5), hidden**-0.5)

    def forward(self, vectors: Tensor) -> Tensor:
        """Paths (N, 6, T, 2) [m] of vectors (N, D)."""
        fixed = torch.einsum("nd,cgd->cng", vectors, self.input_weight) + self.input_bias[:, None]
        state = vectors.new_zeros(COMMANDS, len(vectors), self.hidden)
        weight, bias = self.hidden_weight.transpose(1, 2), self.hidden_bias[:, None]
        steps = []
        for _ in range(self.steps):
            own = torch.baddbmm(bias, state, weight)
            reset, update = torch.sigmoid(fixed[..., : 2 * self.hidden] + own[..., : 2 * self.hidden]).chunk(2, dim=-1)
            new = torch.tanh(fixed[..., 2 * self.hidden :] + reset * own[..., 2 * self.hidden :])
            state = new + update * (state - new)
            steps.append(torch.baddbmm(self.out_bias[:, None], state, self.out_weight.transpose(1, 2)))
        return torch.cumsum(torch.stack(steps, dim=2), dim=2).transpose(0, 1)


class Refiner(nn.Module):
    """Moves a plan towards the goals, again and again; its recurrence begins with the embedding."""

    def __init__(self, features: int, hidden: int | None, goals: int = 1) -> None:
        super().__init__()
        width = hidden or features
        self.begin: nn.Module = nn.Identity() if width == features else nn.Linear(features, width)
        self.gru = nn.GRU(2 * goals + 2, width, batch_first=True)
        self.out = nn.Linear(width, 2)

    def forward(self, vectors: Tensor, goals: Tensor, plans: Tensor, iterations: int) -> Tensor:
        """Plans of all iterations.

        Args:
            vectors: (N, D) embeddings.
            goals: (N, G, 2) target points [m].
            plans: (N, 6, T, 2) to begin with; no gradient flows into them.
            iterations: K.

        Returns:
            (N, K, 6, T, 2).
        """
        count, branches, steps = plans.shape[:3]
        start = self.begin(vectors).repeat_interleave(branches, dim=0)[None].contiguous()
        goal = (goals / GOAL_SCALE - 1.0).flatten(1)[:, None, None].expand(-1, branches, steps, -1)
        plan, found = plans.detach(), []
        for _ in range(iterations):
            inputs = torch.cat([goal, plan], dim=-1).flatten(0, 1)
            states, _ = self.gru(inputs, start)
            plan = plan + torch.cumsum(self.out(states), dim=1).reshape(plan.shape)
            found.append(plan)
        return torch.stack(found, dim=1) if found else plans.new_zeros(count, 0, branches, steps, 2)


class MotionPlan(NamedTuple):
    """What is read from embeddings.

    Attributes:
        coarse: (N, 6, T, 2) [m] by command.
        commands: (N, 6) logits of the commands a vehicle may follow.
    """

    coarse: Tensor
    commands: Tensor


class MotionHead(nn.Module):
    """Coarse branches, refiner and command classifier on one embedding.

    Where speeds are known a branch is what a vehicle does beside going straight on as it goes: steps of three metres
    are much for a recurrence whose states end at one.
    """

    def __init__(self, config: MotionConfig) -> None:
        super().__init__()
        features = config.embedding.features
        self.refinements, self.has_speeds = config.refinements, config.speeds
        self.coarse = CommandGrus(features, config.coarse_hidden, config.waypoints)
        self.refiner = Refiner(features, config.refine_hidden, config.goals) if config.refinements else None
        self.commands = nn.Linear(features, COMMANDS)

    def forward(self, vectors: Tensor, speeds: Tensor | None = None) -> MotionPlan:
        """Coarse plans and command logits of vectors (N, D); speeds (N,) [m/s] are what the plans begin with."""
        with exact(vectors):  # sums over time would lose centimetres in half precision
            coarse = self.coarse(vectors.float())
            if self.has_speeds and speeds is not None:
                coarse = coarse + straight_on(speeds.nan_to_num(0.0), coarse.shape[2])[:, None]
            return MotionPlan(coarse, self.commands(vectors.float()))

    def refine(self, vectors: Tensor, goals: Tensor, coarse: Tensor) -> Tensor:
        """Plans (N, K, 6, T, 2) [m] after each of the K refinements towards goals (N, G, 2); with K = 0 none."""
        if self.refiner is None:
            return coarse[:, None][:, :0]
        with exact(vectors):
            refined: Tensor = self.refiner(vectors.float(), goals, coarse, self.refinements)
        return refined


def straight_on(speeds: Tensor, steps: int) -> Tensor:
    """(N, T, 2) where vehicles are that keep their course and speeds (N,) [m/s]."""
    way = speeds[:, None] * (TIME_STEP * torch.arange(1, steps + 1, device=speeds.device))
    return torch.stack([torch.zeros_like(way), -way], dim=-1)


def exact(values: Tensor) -> torch.autocast:
    """A context in which nothing on the device of `values` is computed in half precision."""
    return torch.autocast(values.device.type, enabled=False)


def chosen(paths: Tensor, commands: Tensor) -> Tensor:
    """The branches (..., T, 2) of paths (N, ..., 6, T, 2) that commands (N,) name."""
    index = commands.reshape(-1, *([1] * (paths.dim() - 1))).expand(*paths.shape[:-3], 1, *paths.shape[-2:])
    return torch.gather(paths, paths.dim() - 3, index).squeeze(-3)


def path_loss(paths: Tensor, targets: Tensor) -> Tensor:
    """Mean absolute error (...) over the points and axes of paths (..., T, 2) [m]."""
    return (paths - targets).abs().mean(dim=(-2, -1))


def nearest_branch_loss(paths: Tensor, targets: Tensor) -> Tensor:
    """Error (N,) of that branch of (N, 6, T, 2) which is nearest to targets (N, T, 2): others' commands are unknown."""
    return path_loss(paths, targets[:, None]).amin(dim=1)


def command_loss(logits: Tensor, commands: Tensor, smoothing: float) -> Tensor:
    """Binary cross entropy (N,) of each command's likelihood; a label keeps 1 - smoothing, all share the rest."""
    labels = functional.one_hot(commands, COMMANDS).to(logits.dtype) * (1.0 - smoothing) + smoothing / COMMANDS
    return functional.binary_cross_entropy_with_logits(logits, labels, reduction="none").mean(dim=1)
