"""The recorded bird's-eye labels on LAV's own grid, and motions as the networks take them.

Datasets keep vehicles' frames (x ahead, y right); networks the planner's (x right, y backward). `agents.lav.frames`
turns one into the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.lav.config import GridConfig, LavConfig
from agents.lav.frames import command_of, planner_from_vehicle
from lavsim.dataset.reader import Dataset
from lavsim.dataset.samples import SampleFilter, motions_of
from lavsim.dataset.windows import Windows
from lavsim.errors import ConfigError
from lavsim.sensors.bev import BevConfig, ego_column, ego_row

LAYERS = 5  # road, vehicle, pedestrian, solid, broken


def on_grid(layers: NDArray[np.uint8], recorded: BevConfig, grid: GridConfig) -> NDArray[np.uint8]:
    """Recorded layers (L, H, W) on a grid (L, rows, cols), 0 or 1: a cell is set where any of its pixels is.

    Raises:
        ConfigError: the grid's cells are no multiple of the recorded ones.
    """
    factor = round(grid.cell * recorded.pixels_per_metre)
    if abs(factor / recorded.pixels_per_metre - grid.cell) > 1e-9:
        raise ConfigError(
            f"the data's {recorded.pixels_per_metre:g} px/m make no whole number of pixels in cells of {grid.cell:g} m."
        )
    top = round(ego_row(recorded) - grid.ahead * recorded.pixels_per_metre)
    left = round(ego_column(recorded) - grid.aside * recorded.pixels_per_metre)
    canvas = np.zeros((len(layers), grid.rows * factor, grid.cols * factor), np.uint8)
    rows = slice(max(top, 0), min(top + canvas.shape[1], layers.shape[1]))
    cols = slice(max(left, 0), min(left + canvas.shape[2], layers.shape[2]))
    if rows.start < rows.stop and cols.start < cols.stop:
        canvas[:, rows.start - top : rows.stop - top, cols.start - left : cols.stop - left] = layers[:, rows, cols] > 0
    return canvas.reshape(len(layers), grid.rows, factor, grid.cols, factor).max(axis=(2, 4))


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
    recorded = _recorded_bev(data)
    windows = Windows(list(data.episodes.values()), config.motion.waypoints, stride)
    if not len(windows):
        raise ConfigError(f"{data.root.name} holds no {config.motion.waypoints + 1} frames in a row.")
    filters = SampleFilter(vehicle_radius=config.motion.radius, walker_radius=0.0, most=most, ahead_only=True)
    found = MotionSamples(
        bev=np.zeros((len(windows), LAYERS, config.grid.rows, config.grid.cols // 8), np.uint8),
        poses=np.zeros((len(windows), most, 3), np.float32),
        futures=np.zeros((len(windows), most, config.motion.waypoints, 2), np.float32),
        is_real=np.zeros((len(windows), most), bool),
        command=np.zeros(len(windows), np.int64),
        goal=np.zeros((len(windows), 2), np.float32),
        brake=np.zeros(len(windows), bool),
        speed=np.zeros(len(windows), np.float32),
    )
    for k in range(len(windows)):
        episode, frame = windows[k]
        row = data.read(episode, frame, ("bev", "command", "goal", "brake", "speed"))
        found.bev[k] = np.packbits(on_grid(row["bev"], recorded, config.grid), axis=-1)
        motions = motions_of(data.table(episode), frame, config.motion.waypoints, filters)
        count = len(motions.ids)
        found.poses[k, :count, :2] = planner_from_vehicle(motions.places)
        found.poses[k, :count, 2] = motions.headings
        found.futures[k, :count] = planner_from_vehicle(motions.futures)
        found.is_real[k, :count] = True
        found.command[k] = command_of(int(row["command"]))
        found.goal[k] = planner_from_vehicle(row["goal"])
        found.brake[k], found.speed[k] = bool(row["brake"]), float(row["speed"])
    return found


def _recorded_bev(data: Dataset) -> BevConfig:
    for sensor in data.info.record.suite:
        if sensor.get("type") == "sensor.lavsim.bev":
            config = BevConfig.parse(sensor)
            if config.names == BevConfig(type="", id="").names:
                return config
    raise ConfigError(f"{data.root.name} has no bird's-eye labels with LAV's layers.")
