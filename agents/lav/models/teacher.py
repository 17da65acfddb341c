"""The privileged teacher: plans and forecasts from true bird's-eye labels (paper, section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from agents.lav.config import LavConfig
from agents.lav.models.crop import crop_rois
from agents.lav.models.motion import Embedding, MotionHead

LABEL_LAYERS = ("road", "vehicle", "pedestrian", "solid", "broken")


class Motions(NamedTuple):
    """Motions of the vehicles of frames, the ego first.

    Attributes:
        vectors: (B, R, D) embeddings.
        coarse: (B, R, 6, T, 2) [m], each in its vehicle's own frame.
        commands: (B, R, 6) logits.
        refined: (B, K, 6, T, 2) [m], the ego's plans in its own frame.
    """

    vectors: Tensor
    coarse: Tensor
    commands: Tensor
    refined: Tensor


class MotionNetwork(nn.Module):
    """Windows to motions; the teacher's on labels, the student's on features.

    Args:
        config: Sizes.
        channels: Of the bird's-eye image.
        cell: Side of a window's cells [m].
    """

    def __init__(self, config: LavConfig, channels: int, cell: float) -> None:
        super().__init__()
        self._grid, self._crop, self._cell = config.grid, config.crop, cell
        self._goals = config.motion.goals
        self.embedding = Embedding(config.motion, channels, round(config.crop.side / cell))
        self.motion = MotionHead(config.motion)

    def forward(
        self,
        image: Tensor,
        poses: Tensor,
        goals: Tensor,
        speeds: Tensor | None = None,
        is_real: Tensor | None = None,
    ) -> Motions:
        """Motions of the vehicles at `poses`.

        Args:
            image: (B, C, H, W) over the grid.
            poses: (B, R, 3) in the planner frame, the ego first.
            goals: (B, G, 2) the ego's next target points in its own frame [m]; `motion.goals` are used.
            speeds: (B, R) [m/s], NaN where a speed is not known; None: no one's is.
            is_real: (B, R) false for padding, whose motions are zeros; None: there is none.
        """
        windows = crop_rois(image, poses, self._grid, self._crop, self._cell)
        real = torch.ones(poses.shape[:2], dtype=torch.bool, device=poses.device) if is_real is None else is_real
        known = speeds[real] if speeds is not None else None
        own = goals.new_full((*real.shape, self._goals, 2), torch.nan)
        own[:, 0] = goals[:, : self._goals]  # nobody knows where others go
        vectors = self.embedding(windows[real], known, own[real])
        plan = self.motion(vectors, known)
        vectors, coarse, commands = (_placed(values, real) for values in (vectors, plan.coarse, plan.commands))
        refined = self.motion.refine(vectors[:, 0], goals[:, : self._goals], coarse[:, 0])
        return Motions(vectors, coarse, commands, refined)


def _placed(values: Tensor, real: Tensor) -> Tensor:
    """(B, R, …) of values (N, …) of the N real vehicles, zeros elsewhere."""
    placed = values.new_zeros(*real.shape, *values.shape[1:])
    placed[real] = values
    return placed


def make_teacher(config: LavConfig) -> MotionNetwork:
    """The teacher of a configuration."""
    return MotionNetwork(config, len(LABEL_LAYERS) * config.temporal.scans, config.crop.teacher_cell)
