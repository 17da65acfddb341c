"""Perception from points, and motions from its features: what drives (paper, sections 3.2 and 3.3)."""

from __future__ import annotations

from torch import Tensor, nn

from agents.lav.config import LavConfig
from agents.lav.models.backbone import Backbone, Seen
from agents.lav.models.pillars import PillarEncoder
from agents.lav.models.teacher import MotionNetwork


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
