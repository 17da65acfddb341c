"""When a stream of vehicles meets the ego."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Stage
from lavsim.scenarios.moves.pursuit import line_of

_MEET = 1.2  # [m] of a line from the route where the two meet
_STEP = 0.5  # [m] between the points of a `Line`
_SLOWEST = 7.0  # [m/s] that the ego is taken to drive at least


def phase_to_meet(stage: Stage, line: NDArray[np.float64], speed: float) -> float | None:
    """Where on `line` (N, 2) a vehicle at `speed` is now if it meets an ego that keeps its own [m].

    Negative: it has not come to the line yet. None: line and route don't meet after the ego's place.
    """
    first = int(np.searchsorted(stage.route.distance, stage.progress()))
    apart = np.hypot(*(stage.route.xy[first:, None] - line[None]).transpose(2, 0, 1))
    near = np.flatnonzero(apart.min(axis=1) < _MEET)
    if not len(near):
        return None
    point = int(near[0])
    left = float(stage.route.distance[first + point]) - stage.progress()
    seconds = left / max(stage.world.ego.speed, _SLOWEST)
    return phase_at(line, speed, stage.route.xy[first + point], seconds)


def phase_at(line: NDArray[np.float64], speed: float, place: NDArray[np.float64], seconds: float) -> float:
    """Where on `line` (N, 2) a vehicle at `speed` is now if it is at `place` (2,) after `seconds` [m]."""
    way = line_of(line)
    time = np.append(0.0, np.cumsum(_STEP / np.minimum(speed, way.pace[1:])))  # [s]; bends slow it down
    start = time[int(np.argmin(np.hypot(*(way.xy - place).T)))] - seconds
    return float(np.interp(start, time, _STEP * np.arange(len(time)))) if start > 0.0 else float(start * speed)
