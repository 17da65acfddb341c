"""A walker or a bicycle crosses in a straight line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Script
from lavsim.types import DT, ActorClass, Role
from lavsim.world.actor import Actor
from lavsim.world.world import World

_HALF_WIDTH = 0.5  # [m] of a walker, with room to its sides
GIVES_UP = 10.0  # [s] held up for so long, an actor stays where it is


class _Crossing:
    """How far an actor has come, and whether it gets on."""

    def __init__(self, actor: Actor, length: float) -> None:
        self._actor, self._start, self._length = actor, actor.xy, length
        self._far, self._waits = 0.0, 0

    def goes_on(self) -> bool:
        """Whether there is a way left: not once the actor is gone, or stands before a queue that doesn't move."""
        gone = float(np.hypot(*(self._actor.xy - self._start)))
        self._waits = 0 if gone > self._far + 0.1 else self._waits + 1
        self._far = gone if self._waits == 0 else self._far
        return gone < self._length and self._actor.is_present and self._waits * DT < GIVES_UP


def walk(actor: Actor, way: NDArray[np.float64], speed: float, length: float) -> Script:
    """Walks `length` metres in direction `way` (2,) and stops; ends early when it is knocked down or held up."""
    unit = np.asarray(way, dtype=np.float64) / np.hypot(*way)
    crossing = _Crossing(actor, length)
    while crossing.goes_on():
        actor.walk(speed * unit)
        yield
    actor.walk(np.zeros(2))


def ride(actor: Actor, speed: float, length: float, acceleration: float = 12.0) -> Script:
    """Drives `length` metres straight ahead, as it stands, up to `speed` [m/s], and stops; also when held up."""
    crossing = _Crossing(actor, length)
    while crossing.goes_on():
        actor.drive(min(speed, actor.speed + acceleration * DT))
        yield
    actor.drive(0.0)


def cross(actor: Actor, way: NDArray[np.float64], speed: float, length: float) -> Script:
    """`walk` for walkers, `ride` for what has wheels (which must look in the direction `way`)."""
    is_walker = actor.world.table.classes[actor.row] == ActorClass.WALKER
    return walk(actor, way, speed, length) if is_walker else ride(actor, speed, length)


def meets_parked(world: World, start: NDArray[np.float64], way: NDArray[np.float64], length: float) -> bool:
    """Whether a parked car stands within `length` metres from `start` (2,) in direction `way` (2,)."""
    rows = np.flatnonzero(world.present[: world.count] & (world.table.roles == Role.PARKED))
    unit = np.asarray(way, dtype=np.float64) / np.hypot(*way)
    gap = world.pose[rows, :2] - start
    along, across = gap @ unit, gap @ np.array([-unit[1], unit[0]])
    turn = world.pose[rows, 2] - np.arctan2(unit[1], unit[0])
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    half_length, half_width = world.half_sizes[rows].T
    reach_along, reach_across = half_length * c + half_width * s, half_length * s + half_width * c
    inside = (along > -reach_along) & (along < length + reach_along) & (np.abs(across) < reach_across + _HALF_WIDTH)
    return bool(inside.any())
