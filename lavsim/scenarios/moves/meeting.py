"""When the ego is where, and where a stream of vehicles has to be to meet it there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.map.route import Route
from lavsim.scenarios.base import Stage
from lavsim.scenarios.moves.pursuit import STEP, line_of, pace_of

_MEET = 1.2  # [m] of a line from the route where the two meet
_SLOWEST = 7.0  # [m/s] that the ego is taken to wish at least
_LATERAL, _SLOWING, _GAINING = 2.2, 2.0, 2.0  # [m/s²] of an ego in bends, before them and behind them
_STOPPING, _BEFORE = 1.5, 3.0  # [m/s²] before a red light, and how far from the junction it would stand [m]
_REACTION = 0.6  # [s] from green until it speeds up
_PAST = 3.0  # [m] of route behind a place whose bends still count
_CREEP = 0.5  # [m/s] below which it is taken to stand before a red light


def phase_to_meet(stage: Stage, line: NDArray[np.float64], speed: float, red: float = 0.0) -> float | None:
    """Where on `line` (N, 2) a vehicle at `speed` is now if it meets an ego that drives on [m].

    Negative: it has not come to the line yet. None: line and route don't meet after the ego's place.

    Args:
        stage: Where.
        line: The vehicle's way [m].
        speed: [m/s].
        red: How long the ego's light stays red [s].
    """
    first = int(np.searchsorted(stage.route.distance, stage.progress()))
    apart = np.hypot(*(stage.route.xy[first:, None] - line[None]).transpose(2, 0, 1))
    near = np.flatnonzero(apart.min(axis=1) < _MEET)
    if not len(near):
        return None
    point = first + int(near[0])
    return phase_at(line, speed, stage.route.xy[point], ego_time(stage, point, red))


def phase_at(line: NDArray[np.float64], speed: float, place: NDArray[np.float64], seconds: float) -> float:
    """Where on `line` (N, 2) a vehicle at `speed` is now if it is at `place` (2,) after `seconds` [m]."""
    way = line_of(line)
    time = np.append(0.0, np.cumsum(STEP / np.minimum(speed, way.pace[1:])))  # [s]; bends slow it down
    start = time[int(np.argmin(np.hypot(*(way.xy - place).T)))] - seconds
    return float(np.interp(start, time, STEP * np.arange(len(time)))) if start > 0.0 else float(start * speed)


def ego_time(stage: Stage, point: int, red: float = 0.0) -> float:
    """Seconds until the ego is at point `point` of its route if it keeps its speed where bends and its light let it.

    It slows for bends and before a red light as a calm driver does, and comes back to the speed it has now.
    """
    route, gone = stage.route, stage.progress()
    pace = calm_pace(route, gone, float(route.distance[point]) + _PAST)
    way, stop = float(route.distance[point]) - gone, stage.site.to_junction - (gone - stage.site.at)
    green = red + _REACTION if red else 0.0
    wish = max(stage.world.ego.speed, _SLOWEST)
    speed, at, time = wish, 0.0, 0.0
    while at < way:
        allowed = min(wish, speed + _GAINING * STEP / max(speed, 1.0), pace[min(int(at / STEP), len(pace) - 1)])
        if at < stop and time < green:
            allowed = min(allowed, math.sqrt(2.0 * _STOPPING * max(stop - _BEFORE - at, 0.0)))
            if allowed < _CREEP:
                time, allowed = green, _CREEP
        speed = max(allowed, _CREEP)
        at, time = at + STEP, time + STEP / speed
    return time


def calm_pace(route: Route, begin: float, end: float) -> NDArray[np.float64]:
    """Speed that a calm driver has in the bends of a route, at points `STEP` apart from `begin` to `end` metres [m/s].

    By the lanes' directions: the line of a route that changes lanes leaps aside.
    """
    at = np.arange(begin, max(end, begin + 2.0 * STEP), STEP)
    yaw = np.interp(at, route.distance, np.unwrap(route.yaw))
    return pace_of(np.gradient(yaw, STEP), _LATERAL, _SLOWING)
