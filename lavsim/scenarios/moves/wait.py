"""Waiting, and running several scripts side by side. All are generators for `yield from`; conditions are functions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Script, Stage
from lavsim.types import DT
from lavsim.world.actor import Actor


def until(condition: Callable[[], bool]) -> Script:
    """Until `condition()` holds."""
    while not condition():
        yield


def seconds(duration: float) -> Script:
    """For `duration` [s], in whole ticks."""
    for _ in range(round(duration / DT)):
        yield


def driven(actor: Actor, metres: float) -> Script:
    """Until `actor` has covered `metres` of way."""
    last, done = actor.xy, 0.0
    while done < metres:
        yield
        here = actor.xy
        done += float(np.hypot(*(here - last)))
        last = here


def together(*scripts: Script) -> Script:
    """Runs all until the last has ended."""
    running = list(scripts)
    while running := [script for script in running if _goes_on(script)]:
        yield


def beside(main: Script, *others: Script) -> Script:
    """Runs all until `main` has ended."""
    running = list(others)
    while _goes_on(main):
        running = [script for script in running if _goes_on(script)]
        yield


def first_of(*scripts: Script) -> Script:
    """Runs all until one has ended."""
    running = list(scripts)
    while len(running := [script for script in running if _goes_on(script)]) == len(scripts):
        yield


def in_turn(*scripts: Script) -> Script:
    """Runs one after the other."""
    for script in scripts:
        yield from script


def _goes_on(script: Script) -> bool:
    try:
        next(script)
    except StopIteration:
        return False
    return True


def gap_to(actor: Actor, xy: NDArray[np.float64]) -> float:
    """Straight distance from the middle of `actor` to `xy` [m]."""
    return float(np.hypot(*(np.asarray(xy)[:2] - actor.xy)))


def arrives(actor: Actor, xy: NDArray[np.float64], within: float, near: float) -> bool:
    """Whether `actor` would be at `xy` in less than `within` [s] at its speed, or is nearer than `near` [m].

    Straight distance over speed, as the leaderboard 2.x measures it.
    """
    gap = gap_to(actor, xy)
    return gap < near or gap < within * actor.speed


def until_arrival(actor: Actor, xy: NDArray[np.float64], within: float, near: float) -> Script:
    """Until `arrives`."""
    return until(lambda: arrives(actor, xy, within, near))


def ego_past(stage: Stage, at: float) -> Callable[[], bool]:
    """Condition: the ego is `at` metres of route beyond the trigger."""
    return lambda: stage.progress() - stage.site.at >= at


def left_junction(stage: Stage, further: float = 0.0) -> Callable[[], bool]:
    """Condition: the ego is `further` metres beyond the next junction of its route; never without one."""
    junction = stage.site.junction
    if junction is None:
        return lambda: False
    end = float(stage.route.distance[min(junction[1] + 1, len(stage.route) - 1)])
    return lambda: stage.progress() >= end + further
