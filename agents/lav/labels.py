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

from agents.lav.config import TIME_STEP, GridConfig, LavConfig
from agents.lav.data.arrays import grid_layers, motion_arrays
from agents.lav.data.windows import bev_config
from agents.lav.frames import planner_from_vehicle, planner_from_world, vehicle_from_planner, world_from_planner
from agents.lav.ways import METRES, driven_way
from lavsim.dataset.reader import Dataset
from lavsim.dataset.samples import SampleFilter
from lavsim.dataset.tables import Table
from lavsim.dataset.windows import Windows
from lavsim.errors import ConfigError
from lavsim.world.dynamics import steer_curvature

LAYERS = 5  # road, vehicle, pedestrian, solid, broken
_PUSHED = 1.0  # [m/s²] noise that pushes harder makes a future that no driver chose
_PUSH_HORIZON = 1.5  # [s] later pushes hardly move a path of two and a half seconds
_SLOW = 3.0  # [m/s] below, noise does not push harder than at this speed
_ARRAYS = ("poses", "futures", "is_real", "speeds", "command", "goals", "brake")


@dataclass(frozen=True)
class MotionSamples:
    """All windows of a dataset as arrays, in the planner's frame; R vehicles each, the ego first.

    Attributes:
        bev: (N, L, rows, cols / 8) uint8, labels with eight cells a byte.
        poses: (N, R, 3) float32 x, y [m], heading [rad] in the ego's planner frame.
        futures: (N, R, T, 2) float32 in each vehicle's own frame [m].
        is_real: (N, R) whether there is such a vehicle.
        speeds: (N, R) float32 of each [m/s].
        command: (N,) int64, 0 to 5.
        goals: (N, 2, 2) float32, the next two goal points [m].
        brake: (N,) bool, whether the expert made a full stop.
        pushed: (N,) bool, whether noise on its control pushed the ego aside.
        centre: (N, T, 2) float32, where the ego would be on the middle of its route with the speed it has [m].
        ways: (N, P, 2) float32, where it drove on, a metre from point to point.
        half: Half length and half width of the ego [m].
        grid: Of the labels.
    """

    bev: NDArray[np.uint8]
    poses: NDArray[np.float32]
    futures: NDArray[np.float32]
    is_real: NDArray[np.bool_]
    speeds: NDArray[np.float32]
    command: NDArray[np.int64]
    goals: NDArray[np.float32]
    brake: NDArray[np.bool_]
    pushed: NDArray[np.bool_]
    centre: NDArray[np.float32]
    ways: NDArray[np.float32]
    half: tuple[float, float]
    grid: GridConfig

    def __len__(self) -> int:
        return len(self.command)

    @property
    def speed(self) -> NDArray[np.float32]:
        """(N,) of the ego [m/s]."""
        return self.speeds[:, 0]

    @property
    def plans(self) -> NDArray[np.bool_]:
        """(N,) whether the ego's future is one that the expert chose, and not a stop."""
        return ~self.brake & ~self.pushed

    @property
    def holds(self) -> NDArray[np.bool_]:
        """(N,) whether the ego stops, and its way says where it will go on."""
        return self.brake & ~self.pushed

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
    recorded, count, steps = bev_config(data), len(places), config.motion.waypoints
    filters = SampleFilter(vehicle_radius=config.motion.radius, walker_radius=0.0, most=most, ahead_only=True)
    found = MotionSamples(
        bev=np.zeros((count, LAYERS, config.grid.rows, config.grid.cols // 8), np.uint8),
        poses=np.zeros((count, most, 3), np.float32),
        futures=np.zeros((count, most, steps, 2), np.float32),
        is_real=np.zeros((count, most), bool),
        speeds=np.zeros((count, most), np.float32),
        command=np.zeros(count, np.int64),
        goals=np.zeros((count, 2, 2), np.float32),
        brake=np.zeros(count, bool),
        pushed=np.zeros(count, bool),
        centre=np.zeros((count, steps, 2), np.float32),
        ways=np.zeros((count, METRES + 1, 2), np.float32),
        half=_half_size(data.table(places[0][0])),
        grid=config.grid,
    )
    for k, (episode, frame) in enumerate(places):
        layers = data.read(episode, frame, ("bev",))["bev"]
        found.bev[k] = np.packbits(grid_layers(layers, recorded, config.grid), axis=-1)
        table = data.table(episode)
        arrays = motion_arrays(table, frame, steps, filters)
        for name in _ARRAYS:
            getattr(found, name)[k] = arrays[name]
        found.pushed[k] = is_pushed(table, frame, steps)
        found.centre[k] = centre_path(table, frame, steps)
        found.ways[k] = driven_way(table, frame)
    return found


def _half_size(table: Table) -> tuple[float, float]:
    """Of the ego, who is the first actor of a frame."""
    length, width = table.columns["actor_size"].values[0, :2].tolist()
    return length / 2.0, width / 2.0


def is_pushed(table: Table, first: int, steps: int) -> bool:
    """Whether noise on the control pushes the ego aside soon after frame `first` of a window of `steps`."""
    frames = slice(first, first + min(round(_PUSH_HORIZON / TIME_STEP), steps))
    controls = table.columns["tick_control"]
    assert controls.ends is not None
    # The first tick behind a frame has the control that was wished at the frame, and the noise.
    noise = controls.values[controls.ends[frames.start + 1 : frames.stop + 1], 1] - table["wish"][frames, 1]
    push = np.abs(noise) * steer_curvature(1.0) * np.maximum(table["speed"][frames], _SLOW) ** 2
    return bool(np.any(push > _PUSHED))  # not a number, where nothing is known, is no push


def centre_path(table: Table, first: int, steps: int) -> NDArray[np.float64]:
    """(T, 2) the middle of the route in the planner's frame [m], passed at the speed of frame `first`."""
    last = first + steps
    route = table["route"][first].astype(np.float64)
    # The recorded stretch of the route is short; where the ego gets in the window is known too.
    behind = table["route_index"][last] - table["route_index"][first]
    pose, then = (table["position"][k, :2] for k in (first, last))
    yaw, yaw_then = float(table["yaw"][first]), float(table["yaw"][last])
    beyond = world_from_planner(planner_from_vehicle(table["route"][last]), then, yaw_then)
    points = vehicle_from_planner(planner_from_world(beyond, pose, yaw))
    route = np.concatenate([route[: min(behind, len(route))], points])
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    begin = -route[0] @ (route[1] - route[0]) / max(length[1], 1e-3)  # the nearest point is up to half a metre off
    way = begin + float(table["speed"][first]) * TIME_STEP * np.arange(1, steps + 1)
    along = np.stack([np.interp(way, length, route[:, k]) for k in range(2)], axis=1)
    return planner_from_vehicle(along)
