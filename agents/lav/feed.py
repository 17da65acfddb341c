"""What a training step is fed with: which samples, and their loading beside the step before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import DataLoader, Dataset

from agents.lav.stages.base import TrainConfig
from lavsim.errors import ConfigError
from lavsim.random import Draws

LoadStep = Callable[[int], Any]  # of a step's number


class Order:
    """Which samples a step takes: a new permutation each epoch, drawn by hash."""

    def __init__(self, count: int, train: TrainConfig) -> None:
        if count < 1:
            raise ConfigError("there is nothing to learn from: the data holds no sample for this stage.")
        self._count, self._batch = count, train.batch
        self._draws = Draws.of_seed(train.seed).stream("order")
        self._epoch, self._permutation = -1, np.zeros(0, np.int64)

    def samples(self, step: int) -> NDArray[np.int64]:
        """(batch,) numbers of the samples of a step; a batch may span two epochs."""
        places = np.arange(step * self._batch, (step + 1) * self._batch)
        return np.array([self._at(int(place)) for place in places], np.int64)

    def _at(self, place: int) -> int:
        epoch, index = divmod(place, self._count)
        if epoch != self._epoch:
            self._epoch, self._permutation = epoch, self._draws.permutation(epoch, self._count)
        return int(self._permutation[index])


def fed(load: LoadStep, steps: range, workers: int) -> Iterator[Any]:
    """What `load` gives for each of `steps`, loaded ahead: in one thread, or in `workers` processes."""
    return _by_processes(load, steps, workers) if workers else _by_thread(load, steps)


def _by_thread(load: LoadStep, steps: range) -> Iterator[Any]:
    # Decoding and decompression let go of the interpreter's lock, so one thread fills what the training leaves idle.
    with ThreadPoolExecutor(1, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        ahead = pool.submit(load, steps[0]) if len(steps) else None
        for step in steps:
            assert ahead is not None
            loaded = ahead.result()
            ahead = pool.submit(load, step + 1) if step + 1 < steps.stop else None
            yield loaded


def _by_processes(load: LoadStep, steps: range, workers: int) -> Iterator[Any]:
    yield from DataLoader(_Steps(load, steps), batch_size=None, num_workers=workers, pin_memory=False)


class _Steps(Dataset[Any]):
    """The loads of steps, by their place among them."""

    def __init__(self, load: LoadStep, steps: range) -> None:
        self._load, self._steps = load, steps

    def __len__(self) -> int:
        return len(self._steps)

    def __getitem__(self, place: int) -> Any:
        return self._load(self._steps[place])
