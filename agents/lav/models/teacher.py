"""The privileged teacher: plans and forecasts from true bird's-eye labels (paper, section 3.3)."""

from __future__ import annotations

from typing import NamedTuple

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
        self.embedding = Embedding(config.motion, channels)
        self.motion = MotionHead(config.motion)

    def forward(self, image: Tensor, poses: Tensor, goals: Tensor) -> Motions:
        """Motions of the vehicles at `poses`.

        Args:
            image: (B, C, H, W) over the grid.
            poses: (B, R, 3) in the planner frame, the ego first.
            goals: (B, 2) the ego's target point in its own frame [m].
        """
        frames, rois = poses.shape[:2]
        windows = crop_rois(image, poses, self._grid, self._crop, self._cell)
        vectors = self.embedding(windows.flatten(0, 1))
        plan = self.motion(vectors)
        vectors = vectors.unflatten(0, (frames, rois))
        coarse = plan.coarse.unflatten(0, (frames, rois))
        refined = self.motion.refine(vectors[:, 0], goals, coarse[:, 0])
        return Motions(vectors, coarse, plan.commands.unflatten(0, (frames, rois)), refined)


def make_teacher(config: LavConfig) -> MotionNetwork:
    """The teacher of a configuration."""
    return MotionNetwork(config, len(LABEL_LAYERS) * config.temporal.scans, config.crop.teacher_cell)
