"""A walker or a bicycle crosses in a straight line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Script
from lavsim.types import DT, ActorClass
from lavsim.world.actor import Actor


def walk(actor: Actor, way: NDArray[np.float64], speed: float, length: float) -> Script:
    """Walks `length` metres in direction `way` (2,) and stops; ends early when it is knocked down."""
    unit = np.asarray(way, dtype=np.float64) / np.hypot(*way)
    start = actor.xy
    while float(np.hypot(*(actor.xy - start))) < length and actor.is_present:
        actor.walk(speed * unit)
        yield
    actor.walk(np.zeros(2))


def ride(actor: Actor, speed: float, length: float, acceleration: float = 12.0) -> Script:
    """Drives `length` metres straight ahead, as it stands, up to `speed` [m/s], and stops."""
    start = actor.xy
    while float(np.hypot(*(actor.xy - start))) < length and actor.is_present:
        actor.drive(min(speed, actor.speed + acceleration * DT))
        yield
    actor.drive(0.0)


def cross(actor: Actor, way: NDArray[np.float64], speed: float, length: float) -> Script:
    """`walk` for walkers, `ride` for what has wheels (which must look in the direction `way`)."""
    is_walker = actor.world.table.classes[actor.row] == ActorClass.WALKER
    return walk(actor, way, speed, length) if is_walker else ride(actor, speed, length)
