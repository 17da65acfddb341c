"""Measures of perception and of plans, on NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

FALSE, HIT, IGNORED = 0, 1, -1  # what a detection is


def match_centres(
    found: NDArray[np.floating], truth: NDArray[np.floating], counts: NDArray[np.bool_], radius: float = 2.0
) -> NDArray[np.int64]:
    """What each detection of a frame is, the best first: a hit takes the nearest true centre that is still free.

    Args:
        found: (N, 2) centres, best first [m].
        truth: (M, 2) true centres.
        counts: (M,) whether a true one is asked for; detections of the others are neither right nor wrong.
        radius: Centres farther apart do not match [m].

    Returns:
        (N,) `HIT`, `FALSE` or `IGNORED`.

    Source: the nuScenes detection task (Caesar et al. 2020), one distance.
    """
    verdicts = np.full(len(found), FALSE, np.int64)
    free = np.ones(len(truth), bool)
    distance = np.linalg.norm(found[:, None] - truth[None], axis=-1)
    for number, row in enumerate(distance):
        # Those that are asked for come first: a car behind another must not take its detection away.
        for wanted, verdict in ((counts, HIT), (~counts, IGNORED)):
            near = free & wanted & (row <= radius)
            if near.any():
                free[int(np.argmin(np.where(near, row, np.inf)))] = False
                verdicts[number] = verdict
                break
    return verdicts


class AveragePrecision:
    """The area under precision over recall, precision at a recall being the best at that recall or beyond."""

    def __init__(self) -> None:
        self._scores: list[NDArray[np.floating]] = []
        self._verdicts: list[NDArray[np.int64]] = []
        self.asked = 0

    def add(self, scores: NDArray[np.floating], verdicts: NDArray[np.int64], asked: int) -> None:
        """A frame: scores and verdicts (N,) of its detections, and how many true ones were asked for."""
        self._scores.append(np.asarray(scores))
        self._verdicts.append(verdicts)
        self.asked += asked

    def value(self) -> float:
        """0 to 1; NaN if nothing was asked for."""
        if not self.asked:
            return float("nan")
        scores, verdicts = np.concatenate(self._scores), np.concatenate(self._verdicts)
        order = np.argsort(-scores, kind="stable")
        verdicts = verdicts[order][verdicts[order] != IGNORED]
        if not len(verdicts):
            return 0.0
        hits = np.cumsum(verdicts == HIT)
        precision = hits / np.arange(1, len(hits) + 1)
        best = np.maximum.accumulate(precision[::-1])[::-1]
        return float((best * (verdicts == HIT)).sum() / self.asked)


class IntersectionOverUnion:
    """Of sets of cells, layer by layer, over all frames together."""

    def __init__(self, layers: Sequence[str]) -> None:
        self.layers = tuple(layers)
        self._both = np.zeros(len(self.layers))
        self._either = np.zeros(len(self.layers))

    def add(self, found: NDArray[np.bool_], truth: NDArray[np.bool_], known: NDArray[np.bool_] | None = None) -> None:
        """Frames: found and true cells (..., L, H, W); only those `known` (..., H, W) count."""
        valid = np.ones_like(truth) if known is None else np.broadcast_to(known[..., None, :, :], truth.shape)
        axes = tuple(axis for axis in range(truth.ndim) if axis != truth.ndim - 3)
        self._both += (found & truth & valid).sum(axis=axes)
        self._either += ((found | truth) & valid).sum(axis=axes)

    def values(self) -> dict[str, float]:
        """0 to 1 by layer; NaN where there was nothing."""
        with np.errstate(invalid="ignore"):
            return dict(zip(self.layers, (self._both / self._either).tolist(), strict=True))


def displacement(paths: ArrayLike, targets: ArrayLike) -> NDArray[np.float64]:
    """Mean distance (...) between paths and targets (..., T, 2) [m]."""
    found: NDArray[np.float64] = np.linalg.norm(np.asarray(paths) - np.asarray(targets), axis=-1).mean(axis=-1)
    return found
