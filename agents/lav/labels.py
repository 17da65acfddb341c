"""The recorded bird's-eye labels on LAV's own grid, and motions as the networks take them.

Datasets keep vehicles' frames (x ahead, y right); networks the planner's (x right, y backward). `agents.lav.frames`
turns one into the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import LavConfig
from agents.lav.data.arrays import grid_layers, motion_arrays
from agents.lav.data.windows import bev_config
from lavsim.dataset.reader import Dataset
from lavsim.dataset.samples import SampleFilter
from lavsim.dataset.windows import Windows
from lavsim.errors import ConfigError

LAYERS = 5  # road, vehicle, pedestrian, solid, broken


@dataclass(frozen=True)
class MotionSamples:
    """All windows of a dataset as arrays, in the planner's frame; R vehicles each, the ego first.

    Attributes:
        bev: (N, L, rows, cols / 8) uint8, labels with eight cells a byte.
        poses: (N, R, 3) float32 x, y [m], heading [rad] in the ego's planner frame.
        futures: (N, R, T, 2) float32 in each vehicle's own frame [m].
        is_real: (N, R) whether there is such a vehicle.
        command: (N,) int64, 0 to 5.
        goal: (N, 2) float32 [m].
        brake: (N,) bool, whether the expert made a full stop.
        speed: (N,) float32 of the ego [m/s].
    """

    bev: NDArray[np.uint8]
    poses: NDArray[np.float32]
    futures: NDArray[np.float32]
    is_real: NDArray[np.bool_]
    command: NDArray[np.int64]
    goal: NDArray[np.float32]
    brake: NDArray[np.bool_]
    speed: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.command)

    def images(self, samples: NDArray[np.int64]) -> Tensor:
        """(B, L, rows, cols) float32 labels."""
        return torch.from_numpy(np.unpackbits(self.bev[samples], axis=-1)).float()


def read_motions(data: Dataset, config: LavConfig, most: int = 12, stride: int = 1) -> MotionSamples:
    """Every window of a dataset that is long enough.

    Args:
        data: With bird's-eye labels as LAV's.
        config: Sizes; vehicles beyond `motion.radius` and behind the ego are left out, as in the paper's code.
        most: Vehicles kept, the ego included.
        stride: Only every so many frames begin a window.

    Raises:
        ConfigError: the dataset has no such labels, or no window that is long enough.
    """
    windows = Windows(list(data.episodes.values()), config.motion.waypoints, stride)
    if not len(windows):
        raise ConfigError(f"{data.root.name} holds no {config.motion.waypoints + 1} frames in a row.")
    return motions_at(data, [windows[k] for k in range(len(windows))], config, most)


def motions_at(data: Dataset, places: Sequence[tuple[int, int]], config: LavConfig, most: int = 12) -> MotionSamples:
    """The windows that begin at places (episode, frame).

    Raises:
        ConfigError: the dataset has no picture from above that fits the grid.
    """
    recorded, count = bev_config(data), len(places)
    filters = SampleFilter(vehicle_radius=config.motion.radius, walker_radius=0.0, most=most, ahead_only=True)
    found = MotionSamples(
        bev=np.zeros((count, LAYERS, config.grid.rows, config.grid.cols // 8), np.uint8),
        poses=np.zeros((count, most, 3), np.float32),
        futures=np.zeros((count, most, config.motion.waypoints, 2), np.float32),
        is_real=np.zeros((count, most), bool),
        command=np.zeros(count, np.int64),
        goal=np.zeros((count, 2), np.float32),
        brake=np.zeros(count, bool),
        speed=np.zeros(count, np.float32),
    )
    for k, (episode, frame) in enumerate(places):
        layers = data.read(episode, frame, ("bev",))["bev"]
        found.bev[k] = np.packbits(grid_layers(layers, recorded, config.grid), axis=-1)
        arrays = motion_arrays(data.table(episode), frame, config.motion.waypoints, filters)
        for name in ("poses", "futures", "is_real", "command", "goal", "brake", "speed"):
            getattr(found, name)[k] = arrays[name]
    return found
