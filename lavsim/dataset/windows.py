"""Windows of frames that follow each other without a jump in time, and their order in training."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.record import EpisodeRecord
from lavsim.random import Draws


class Windows:
    """All windows of some episodes: every frame that has enough frames behind it.

    Args:
        episodes: Records; those without frames are passed over.
        steps: T, frames behind the first one of a window; a window has T + 1, a quarter of a second apart.
        stride: Only every so many frames begin a window.
    """

    def __init__(self, episodes: Sequence[EpisodeRecord], steps: int, stride: int = 1) -> None:
        self.steps = steps
        parts = [_starts(record, steps, stride) for record in episodes]
        self._starts = np.concatenate(parts) if parts else np.zeros((0, 2), np.int64)

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, index: int) -> tuple[int, int]:
        """Episode and first frame of a window."""
        episode, frame = self._starts[index].tolist()
        return episode, frame


def _starts(record: EpisodeRecord, steps: int, stride: int) -> NDArray[np.int64]:
    """(W, 2) episode and first frame."""
    bounds = [0, *record.breaks, record.frames]
    frames = [np.arange(a, b - steps, stride, dtype=np.int64) for a, b in pairwise(bounds)]
    first = np.concatenate(frames)
    return np.stack([np.full(len(first), record.episode, np.int64), first], axis=1)


@dataclass(frozen=True)
class SamplerState:
    """Where a sampler stands: `position` numbers of epoch `epoch` have been given."""

    epoch: int = 0
    position: int = 0


class Sampler:
    """The numbers 0 … count-1 in an order drawn anew each epoch, without end.

    The order is a function of seed and epoch, so a training that goes on from a saved state sees what it would have
    seen.

    Args:
        count: Of numbers.
        seed: Of the order.
        state: Where to go on.
        share, shares: Gives only every `shares`-th number, from the `share`-th on: one of several processes that train
            together. Each gets equally many; what does not divide is left out of the epoch.

    Attributes:
        state: Where it stands, in numbers that it gave itself.
    """

    def __init__(self, count: int, seed: int, state: SamplerState | None = None, share: int = 0, shares: int = 1):
        if count < shares:
            raise ValueError(f"{count} samples are too few for {shares} shares")
        self._draws = Draws.of_seed(seed).stream("windows")
        self._count, self._share, self._shares = count, share, shares
        self.state = state or SamplerState()

    def __iter__(self) -> Iterator[int]:
        while True:
            order = self.order(self.state.epoch)
            while self.state.position < len(order):
                number = int(order[self.state.position])
                self.state = SamplerState(self.state.epoch, self.state.position + 1)
                yield number
            self.state = SamplerState(self.state.epoch + 1, 0)

    def order(self, epoch: int) -> NDArray[np.int64]:
        """The numbers of an epoch."""
        whole = self._draws.permutation(epoch, self._count)
        return whole[: self._count - self._count % self._shares][self._share :: self._shares]

    def __len__(self) -> int:
        """Numbers in an epoch."""
        return self._count // self._shares
