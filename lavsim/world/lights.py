"""Traffic lights: cycles after CARLA's, a pure function of time unless a hazard holds a group.

Source: reference `carla.md` 4.1: the controllers (phases) of a junction run one after another, each green 10 s, yellow
3 s, red 2 s, all others red meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import LightGroup
from lavsim.types import LightState


@dataclass(frozen=True)
class LightCycle:
    """Durations of one phase [s]."""

    green: float = 10.0
    yellow: float = 3.0
    red: float = 2.0

    @property
    def duration(self) -> float:
        return self.green + self.yellow + self.red


class TrafficLights:
    """States of all lights of a town.

    Args:
        count: Number of lights in the town.
        groups: Junctions with their phases; a light in none of them stays green.
        cycle: Durations.
    """

    def __init__(self, count: int, groups: Sequence[LightGroup], cycle: LightCycle | None = None) -> None:
        self._cycle = cycle or LightCycle()
        self._phase = np.full(count, -1, dtype=np.int64)
        self._phases = np.ones(count, dtype=np.int64)
        for group in groups:
            for number, phase in enumerate(group.phases):
                self._phase[list(phase)] = number
                self._phases[list(phase)] = len(group.phases)
        self._held: dict[int, LightState] = {}

    def hold(self, light: int, state: LightState) -> None:
        """Keeps a light at `state` until `release`."""
        self._held[light] = state

    def release(self, light: int) -> None:
        self._held.pop(light, None)

    def states(self, time: float) -> NDArray[np.uint8]:
        """`LightState` of every light at `time` [s], `(L,)` uint8."""
        cycle = self._cycle
        since = np.mod(time - self._phase * cycle.duration, self._phases * cycle.duration)
        states = np.where(
            since < cycle.green,
            LightState.GREEN,
            np.where(since < cycle.green + cycle.yellow, LightState.YELLOW, LightState.RED),
        ).astype(np.uint8)
        states[self._phase < 0] = LightState.GREEN
        for light, state in self._held.items():
            states[light] = state
        return states
