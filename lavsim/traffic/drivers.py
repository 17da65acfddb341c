"""Who drives: parameters drawn by actor id, so that adding an actor changes no other driver."""

from __future__ import annotations

from dataclasses import dataclass

from lavsim.random import Draws


@dataclass(frozen=True)
class Driver:
    """One driver of background traffic.

    Attributes:
        speed_factor: Wanted share of the speed limit; CARLA's traffic manager drives at 0.7.
        headway: Time gap to the leader [s].
        min_gap: Distance kept at standstill [m].
        acceleration: [m/s²].
        deceleration: Comfortable [m/s²].
    """

    speed_factor: float = 0.7
    headway: float = 1.4
    min_gap: float = 2.0
    acceleration: float = 1.8
    deceleration: float = 2.5


def draw_driver(draws: Draws, actor_id: int) -> Driver:
    """The driver of an actor: cautious to brisk around CARLA's defaults."""
    unit = draws.stream("driver", actor_id).uniform(0, 5)
    return Driver(
        speed_factor=0.6 + 0.25 * unit[0],
        headway=1.1 + 0.7 * unit[1],
        min_gap=1.5 + 1.5 * unit[2],
        acceleration=1.4 + 0.9 * unit[3],
        deceleration=2.2 + 0.8 * unit[4],
    )
