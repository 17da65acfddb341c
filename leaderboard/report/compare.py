"""Runs set side by side, pair by pair: the same route with the same seed under each of two agents."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.random import Draws
from leaderboard.run import Run

Floats = NDArray[np.float64]

RESAMPLES = 10_000
CONFIDENCE = 0.95
POWER = 0.8  # chance with which the smallest difference told would be found
METRICS = (("score_composed", "driving score"), ("score_route", "route completion"), ("score_penalty", "penalty"))


@dataclass(frozen=True)
class Difference:
    """How one metric of a run differs from that of the first run, over their pairs.

    Attributes:
        metric: Its key in the records' scores.
        base, other: Means over the pairs.
        mean: Mean difference, other less base.
        low, high: Interval of it by the bootstrap over routes.
        smallest: The smallest true difference that so many pairs would show with the power above; inf below 2 routes.
        wins, losses: Pairs in which the run did better, worse.
    """

    metric: str
    base: float
    other: float
    mean: float
    low: float
    high: float
    smallest: float
    wins: int
    losses: int


@dataclass(frozen=True)
class Comparison:
    """A run against the first one.

    Attributes:
        pairs: Drives of the same route, repetition and seed in both.
        routes: Routes among them: what is resampled.
        unpaired: Drives of either that have no partner.
        differences: One for each of `METRICS`.
        scores: (N, 2) driving scores of the pairs.
        names: Of the pairs.
    """

    pairs: int
    routes: int
    unpaired: int
    differences: tuple[Difference, ...]
    scores: Floats
    names: tuple[str, ...]


Key = tuple[str, str, int, int]  # town, route, repetition, seed


def compare(base: Run, other: Run) -> Comparison:
    """`other` against `base`."""
    first, second = _drives(base), _drives(other)
    keys = [key for key in first if key in second]
    routes = np.unique([f"{town}/{route}" for town, route, _, _ in keys], return_inverse=True)[1].astype(np.int64)
    count = int(routes.max(initial=-1)) + 1
    values = np.array([[[run[key][metric] for metric, _ in METRICS] for run in (first, second)] for key in keys])
    values = values.reshape(len(keys), 2, len(METRICS))
    return Comparison(
        pairs=len(keys),
        routes=count,
        unpaired=len(first) + len(second) - 2 * len(keys),
        differences=tuple(_difference(metric, values[:, :, k], routes, count) for k, (metric, _) in enumerate(METRICS)),
        scores=values[:, :, 0],
        names=tuple(
            f"{town} {route}" + (f" #{repetition}" if repetition else "") for town, route, repetition, _ in keys
        ),
    )


def _drives(run: Run) -> dict[Key, dict[str, float]]:
    found: dict[Key, dict[str, float]] = {}
    for record in run.records:
        drive = run.drive(record["index"])
        key = (str(drive.get("town", "")), str(drive.get("route", record["route_id"])), int(drive.get("repetition", 0)),
               int(drive.get("seed", 0)))  # fmt: skip
        found[key] = {metric: float(record["scores"][metric]) for metric, _ in METRICS}
    return found


def _difference(metric: str, values: Floats, routes: NDArray[np.int64], count: int) -> Difference:
    """Routes are the units: repetitions of one are averaged, as they share its difficulty."""
    delta = values[:, 1] - values[:, 0]
    if not len(delta):
        nan = math.nan
        return Difference(metric, nan, nan, nan, nan, nan, math.inf, 0, 0)
    of_route = np.bincount(routes, delta, count) / np.bincount(routes, minlength=count)
    low, high = bootstrap(of_route, Draws.of_seed(0).stream("bootstrap"))
    return Difference(
        metric=metric,
        base=float(values[:, 0].mean()),
        other=float(values[:, 1].mean()),
        mean=float(of_route.mean()),
        low=low,
        high=high,
        smallest=smallest_difference(of_route),
        wins=int((delta > 1e-9).sum()),
        losses=int((delta < -1e-9).sum()),
    )


def bootstrap(values: Floats, draws: Draws) -> tuple[float, float]:
    """Interval of the mean of `values` (N,) by resampling them: percentiles of `RESAMPLES` means, the same every time.

    Source: Efron & Tibshirani 1993, "An Introduction to the Bootstrap", chapter 13.
    """
    count = len(values)
    picks = (draws.uniform(0, RESAMPLES * count) * count).astype(np.int64).reshape(RESAMPLES, count)
    means = values[picks].mean(axis=1)
    low, high = np.quantile(means, [(1.0 - CONFIDENCE) / 2.0, (1.0 + CONFIDENCE) / 2.0])
    return float(low), float(high)


def smallest_difference(values: Floats) -> float:
    """The smallest mean difference that a paired t-test on as many pairs that scatter like `values` would show."""
    from scipy.stats import t

    count = len(values)
    if count < 2:
        return math.inf
    quantiles = t.ppf(0.5 + CONFIDENCE / 2.0, count - 1) + t.ppf(POWER, count - 1)
    return float(quantiles * np.std(values, ddof=1) / math.sqrt(count))
