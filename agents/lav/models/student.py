"""Perception from points, and motions from its features: what drives (paper, sections 3.2 and 3.3)."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor, nn

from agents.lav.config import LavConfig
from agents.lav.models.backbone import Backbone, Seen
from agents.lav.models.pillars import PillarEncoder
from agents.lav.models.teacher import MotionNetwork, Motions


class Perception(nn.Module):
    """Points to features, detections and map."""

    def __init__(self, config: LavConfig) -> None:
        super().__init__()
        self.pillars = PillarEncoder(config.grid, config.point_features, config.pillars.widths)
        self.backbone = Backbone(config.backbone, self.pillars.channels)

    def forward(self, points: Tensor, frame: Tensor, frames: int) -> Seen:
        """What is seen in points (P, F) that belong to `frame` (P,) of `frames`."""
        seen: Seen = self.backbone(self.pillars(points, frame, frames))
        return seen


def make_student(config: LavConfig, perception: Perception) -> MotionNetwork:
    """The motion network that reads perception's features."""
    return MotionNetwork(config, perception.backbone.channels, config.crop.cell)


class Driven(NamedTuple):
    """What the student makes of frames.

    Attributes:
        seen: What there is.
        motions: How it moves.
    """

    seen: Seen
    motions: Motions


class Student(nn.Module):
    """Points to detections, map, plans and forecasts: all that the agent asks of its LiDAR."""

    def __init__(self, config: LavConfig) -> None:
        super().__init__()
        self.perception = Perception(config)
        self.motion = make_student(config, self.perception)

    def forward(
        self,
        points: Tensor,
        frame: Tensor,
        poses: Tensor,
        goals: Tensor,
        speeds: Tensor | None = None,
        is_real: Tensor | None = None,
    ) -> Driven:
        """What is seen in points (P, F) of frames `frame` (P,), and the motions of vehicles at poses (B, R, 3).

        Other arguments as `MotionNetwork`'s.
        """
        seen: Seen = self.perception(points, frame, len(poses))
        return Driven(seen, self.motion(seen.features, poses, goals, speeds, is_real))
