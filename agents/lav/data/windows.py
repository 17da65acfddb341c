"""PyTorch's view of a dataset: windows as samples, in a seeded order that can be taken up again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils import data as torch_data

from agents.lav.config import LavConfig
from agents.lav.data.arrays import FRONT, front_images, grid_layers, motion_arrays, some_points
from lavsim.dataset.reader import Dataset
from lavsim.dataset.samples import SampleFilter
from lavsim.dataset.windows import Sampler, SamplerState, Windows
from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.sensors.base import make_sensor
from lavsim.sensors.bev import Bev, BevConfig

Arrays = dict[str, NDArray[Any]]
MakeSample = Callable[[Dataset, int, int], Arrays]  # of (dataset, episode, first frame)

PARTS = ("bev", "lidar", "images")


@dataclass(frozen=True)
class LavSample:
    """Makes the arrays of a window: motions always, and the parts that a stage asks for.

    Attributes:
        config: Sizes of the networks.
        parts: Of `PARTS`.
        filters: Which vehicles count.
        seed: Of the points that are left out of a scan.
    """

    config: LavConfig
    parts: Sequence[str] = ("bev",)
    filters: SampleFilter = SampleFilter()  # noqa: RUF009 - frozen
    seed: int = 0

    def __call__(self, data: Dataset, episode: int, first: int) -> Arrays:
        config = self.config
        arrays = motion_arrays(data.table(episode), first, config.motion.waypoints, self.filters)
        names = {"bev": ("bev",), "lidar": ("lidar",), "images": (*FRONT, "tel_rgb")}
        frame = data.read(episode, first, [name for part in self.parts for name in names[part]])
        if "bev" in self.parts:
            arrays["bev"] = grid_layers(frame["bev"], bev_config(data), config.grid)
        if "lidar" in self.parts:
            draws = Draws.of_seed(self.seed).stream("points", episode)
            points, count = some_points(frame["lidar"], config.pillars.points, draws, first)
            arrays |= {"points": points, "point_count": np.array(count, np.int64)}
        if "images" in self.parts:
            arrays |= front_images(frame, config.cameras)
        return arrays


def bev_config(data: Dataset) -> BevConfig:
    """How a dataset's picture from above was drawn.

    Raises:
        ConfigError: it has none.
    """
    for values in data.info.record.suite:
        if values.get("type") == "sensor.lavsim.bev":
            sensor = make_sensor(values)
            assert isinstance(sensor, Bev)
            return sensor.config
    raise ConfigError(f"{data.root.name} has no picture from above (sensor.lavsim.bev).")


class WindowDataset(torch_data.Dataset[dict[str, torch.Tensor]]):
    """Windows of a dataset as tensors. Workers open their own files; a sample depends on its number alone.

    Args:
        data: The dataset.
        windows: Those of its episodes that are learnt from.
        make: What a sample holds.
    """

    def __init__(self, data: Dataset, windows: Windows, make: MakeSample) -> None:
        self._data, self._windows, self._make = data, windows, make

    def __len__(self) -> int:
        return len(self._windows)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        arrays = self._make(self._data, *self._windows[index])
        return {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}


class EpochSampler(torch_data.Sampler[int]):
    """One epoch of a `Sampler`: from where it stands to the end of the epoch. For a `DataLoader`.

    A loader runs ahead of the training, so the state to save is counted by the training: `state_after(n)`.

    Args:
        sampler: The endless one; it is not moved.
    """

    def __init__(self, sampler: Sampler) -> None:
        self._sampler, self._state = sampler, sampler.state

    def __iter__(self) -> Iterator[int]:
        order = self._sampler.order(self._state.epoch)
        yield from (int(number) for number in islice(order, self._state.position, None))

    def __len__(self) -> int:
        return len(self._sampler) - self._state.position

    def state_after(self, samples: int) -> SamplerState:
        """The state once `samples` of this epoch have been learnt from; the next epoch's at its end."""
        position = self._state.position + samples
        if position >= len(self._sampler):
            return SamplerState(self._state.epoch + 1, 0)
        return SamplerState(self._state.epoch, position)
