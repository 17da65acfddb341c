"""A walker or a bicycle crosses in a straight line."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Script
from lavsim.types import DT, ActorClass, Role
from lavsim.world.actor import Actor
from lavsim.world.world import World

_HALF_WIDTH = 0.5  # [m] of a walker, with room to its sides
_SHORT_OF, _BRAKING = 0.6, 3.0  # [m], [m/s²] before a queue
_STANDS, _LOOK = 0.5, 12.0  # [m/s], [m]
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
    """Drives `length` metres straight ahead, as it stands, up to `speed` [m/s], and stops; also when held up.

    It brakes before a queue on its way, for who crosses in front of an ego must not stop dead there.
    """
    crossing = _Crossing(actor, length)
    while crossing.goes_on():
        room = max(room_to_queue(actor) - _SHORT_OF, 0.0)
        actor.drive(min(speed, actor.speed + acceleration * DT, math.sqrt(2.0 * _BRAKING * room)))
        yield
    actor.drive(0.0)


def room_to_queue(actor: Actor) -> float:
    """Way [m] straight ahead to a standing vehicle of the traffic; infinite without one within 12 m."""
    world, row = actor.world, actor.row
    stands = np.hypot(*world.velocity[: world.count, :2].T) < _STANDS
    rows = np.flatnonzero(world.present[: world.count] & (world.table.roles == Role.TRAFFIC) & stands)
    x, y, yaw = (float(value) for value in (*actor.xy, world.pose[row, 2]))
    along, across, reach_along, reach_across = _seen_from(world, rows, np.array([x, y]), yaw)
    half_length, half_width = world.half_sizes[row]
    is_ahead = (along > 0.0) & (along < _LOOK) & (np.abs(across) < reach_across + half_width)
    return float((along - reach_along - half_length)[is_ahead].min(initial=math.inf))


def cross(actor: Actor, way: NDArray[np.float64], speed: float, length: float) -> Script:
    """`walk` for walkers, `ride` for what has wheels (which must look in the direction `way`)."""
    is_walker = actor.world.table.classes[actor.row] == ActorClass.WALKER
    return walk(actor, way, speed, length) if is_walker else ride(actor, speed, length)


def meets_parked(world: World, start: NDArray[np.float64], way: NDArray[np.float64], length: float) -> bool:
    """Whether a parked car stands within `length` metres from `start` (2,) in direction `way` (2,)."""
    rows = np.flatnonzero(world.present[: world.count] & (world.table.roles == Role.PARKED))
    along, across, reach_along, reach_across = _seen_from(world, rows, start, float(np.arctan2(way[1], way[0])))
    inside = (along > -reach_along) & (along < length + reach_along) & (np.abs(across) < reach_across + _HALF_WIDTH)
    return bool(inside.any())


def _seen_from(
    world: World, rows: NDArray[np.int64], place: NDArray[np.float64], yaw: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Of actors, seen from `place` (2,) in direction `yaw`: how far ahead and aside, half extents likewise [m]."""
    gap = world.pose[rows, :2] - place
    ahead, aside = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
    turn = world.pose[rows, 2] - yaw
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    half_length, half_width = world.half_sizes[rows].T
    return gap @ ahead, gap @ aside, half_length * c + half_width * s, half_length * s + half_width * c
