"""Who drives: kinds of drivers and classes of vehicles, drawn by actor id, so that adding an actor changes nobody else.

The mean share of the limit is that of CARLA's traffic manager, 0.7 (reference `carla.md` 5.1).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

from lavsim.random import Draws
from lavsim.types import ActorClass

# Columns of a driver as kernels hold them, in the order of `Driver`'s fields.
SPEED_FACTOR, HEADWAY, MIN_GAP, ACCELERATION, DECELERATION, POLITENESS, GAP, CORNERING, TOP_SPEED = range(9)
TRAITS = 9


@dataclass(frozen=True)
class Driver:
    """One driver of background traffic, and what its vehicle can do.

    Attributes:
        speed_factor: Wanted share of the speed limit.
        headway: Time gap to the leader [s].
        min_gap: Distance kept at standstill [m].
        acceleration: [m/s²].
        deceleration: Comfortable [m/s²].
        politeness: Weight of what a lane change costs the others (MOBIL), 0 to 1.
        gap: Time left free before and behind a road user who goes first [s].
        cornering: Lateral acceleration in bends, as a share of the ordinary 2 m/s².
        top_speed: Of the vehicle [m/s].
    """

    speed_factor: float = 0.7
    headway: float = 1.15
    min_gap: float = 2.0
    acceleration: float = 1.8
    deceleration: float = 2.5
    politeness: float = 0.3
    gap: float = 1.2
    cornering: float = 1.0
    top_speed: float = 60.0

    @property
    def traits(self) -> tuple[float, ...]:
        """All fields, in the order of the column constants."""
        return astuple(self)


@dataclass(frozen=True)
class _Kind:
    """Ranges of a kind of drivers: (low, high) of the fields of `Driver`."""

    share: float
    speed_factor: tuple[float, float]
    headway: tuple[float, float]
    min_gap: tuple[float, float]
    acceleration: tuple[float, float]
    deceleration: tuple[float, float]
    politeness: tuple[float, float]
    gap: tuple[float, float]
    cornering: tuple[float, float]


_KINDS = (
    _Kind(0.25, (0.55, 0.66), (1.3, 1.7), (2.0, 2.6), (1.3, 1.7), (2.0, 2.4), (0.4, 0.6), (1.6, 2.2), (0.75, 0.9)),
    _Kind(0.55, (0.65, 0.78), (0.95, 1.3), (1.6, 2.2), (1.7, 2.2), (2.3, 2.7), (0.2, 0.4), (1.0, 1.5), (0.9, 1.1)),
    _Kind(0.20, (0.78, 0.95), (0.7, 0.95), (1.3, 1.8), (2.2, 2.7), (2.6, 3.0), (0.0, 0.15), (0.6, 0.9), (1.1, 1.35)),
)  # cautious, normal, aggressive

# Shares of a car's acceleration, deceleration and cornering, and the top speed [m/s].
_CLASSES = {
    ActorClass.CAR: (1.0, 1.0, 1.0, 60.0),
    ActorClass.VAN: (0.8, 0.95, 0.85, 40.0),
    ActorClass.TRUCK: (0.5, 0.85, 0.7, 25.0),
    ActorClass.BUS: (0.5, 0.8, 0.65, 25.0),
    ActorClass.MOTORCYCLE: (1.3, 1.0, 1.1, 60.0),
    ActorClass.BICYCLE: (0.55, 0.9, 0.8, 6.0),
}


def draw_driver(draws: Draws, actor_id: int, actor_class: ActorClass = ActorClass.CAR) -> Driver:
    """The driver of an actor: its kind by share, its traits within the kind, limited by its vehicle."""
    unit = draws.stream("driver", actor_id).uniform(0, 9)
    at, kind = unit[8], _KINDS[-1]
    for candidate in _KINDS:
        if at < candidate.share:
            kind = candidate
            break
        at -= candidate.share

    def within(bounds: tuple[float, float], column: int) -> float:
        return float(bounds[0] + (bounds[1] - bounds[0]) * unit[column])

    acceleration, deceleration, cornering, top_speed = _CLASSES.get(actor_class, _CLASSES[ActorClass.CAR])
    return Driver(
        speed_factor=within(kind.speed_factor, 0),
        headway=within(kind.headway, 1),
        min_gap=within(kind.min_gap, 2),
        acceleration=acceleration * within(kind.acceleration, 3),
        deceleration=deceleration * within(kind.deceleration, 4),
        politeness=within(kind.politeness, 5),
        gap=within(kind.gap, 6),
        cornering=cornering * within(kind.cornering, 7),
        top_speed=top_speed,
    )
