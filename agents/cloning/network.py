"""From three images, speed and goals to one plan a command.

Sources: branches by command (Codevilla et al. 2018, ICRA); a residual trunk and speed that is left out now and then
(Codevilla et al. 2019, ICCV); waypoints instead of controls (Chen et al. 2020, CoRL).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from agents.lav.config import LavConfig
from agents.lav.models.motion import CommandGrus, GoalInput, SpeedInput, exact, straight_on
from agents.lav.models.resnet import STRIDE, ResNet, memory_format

GOALS = 2
# Slower is not told: who is told that it stands goes on standing, and with a limit of 1 m/s it went on at just that.
LEAST_TOLD = 3.0  # [m/s]
_STEP = 2.0  # [m] of a recurrence's one: without a speed it has to make the whole way
_CELL_CHANNELS = 24


class CloningNetwork(nn.Module):
    """The trunk is of the brake network's size, which sees the same images; its cells are kept apart, not averaged:
    a plan depends on where things are.

    Args:
        config: Sizes: cameras, trunk, waypoints.
    """

    def __init__(self, config: LavConfig) -> None:
        super().__init__()
        features, cameras = config.brake.features, config.cameras
        cells = -(-cameras.height // STRIDE) * -(-3 * cameras.width // STRIDE)
        self._format = memory_format(config.brake)
        self.trunk = ResNet(config.brake, 3)
        self.narrow = nn.Conv2d(features, _CELL_CHANNELS, 1)
        self.seen = nn.Sequential(nn.Dropout(0.2), nn.Linear(_CELL_CHANNELS * cells, features))
        self.speed, self.goal = SpeedInput(features), GoalInput(features, GOALS)
        self.branches = CommandGrus(features, config.motion.coarse_hidden, config.motion.waypoints)

    def forward(self, panorama: Tensor, speeds: Tensor, goals: Tensor) -> Tensor:
        """Plans (B, 6, T, 2) by command in the planner frame [m].

        Args:
            panorama: (B, 3, H, 3 W) uint8, red first: left, centre, right beside each other.
            speeds: (B,) of the ego [m/s], NaN where it is not told.
            goals: (B, 2, 2) the next two goal points in the planner frame [m].
        """
        image = ((panorama.float() - 127.5) / 64.0).contiguous(memory_format=self._format)
        cells = functional.relu(self.narrow(self.trunk(image)))
        vectors = torch.relu(self.seen(cells.flatten(1)))
        told = torch.where(speeds >= LEAST_TOLD, speeds, torch.full_like(speeds, torch.nan))
        vectors = self.goal(self.speed(vectors, told), goals)
        with exact(vectors):
            steps: Tensor = self.branches(vectors.float())
            return _STEP * steps + straight_on(told.nan_to_num(0.0), steps.shape[2])[:, None]
