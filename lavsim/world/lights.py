"""Traffic lights: cycles after CARLA's, a pure function of the tick apart from what a hazard holds.

Source: reference `carla.md` 4.1: the controllers (phases) of a junction run one after another, each green 10 s, yellow
3 s, red 2 s, all others red meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError
from lavsim.map.town_map import LightGroup
from lavsim.types import DT, LightState

_RED, _YELLOW, _GREEN = LightState.RED, LightState.YELLOW, LightState.GREEN


@dataclass(frozen=True)
class LightCycle:
    """Durations of one phase [s]."""

    green: float = 10.0
    yellow: float = 3.0
    red: float = 2.0

    def __post_init__(self) -> None:
        for name in ("green", "yellow", "red"):
            if not 0.0 <= getattr(self, name) < 3600.0:
                raise ConfigError(f"light_cycle.{name} must lie in 0 to 3600 [s], got {getattr(self, name)}.")
        if self.ticks == 0:
            raise ConfigError("light_cycle must last at least one tick of 0.05 s.")

    @property
    def ticks(self) -> int:
        """Ticks of a phase: the three durations, each rounded to whole ticks."""
        return sum(round(part / DT) for part in (self.green, self.yellow, self.red))

    def state(self, ticks: int) -> tuple[LightState, int]:
        """State of the active phase `ticks` after it began, and the tick at which that state ends."""
        green = round(self.green / DT)
        yellow = green + round(self.yellow / DT)
        if ticks < green:
            return _GREEN, green
        return (_YELLOW, yellow) if ticks < yellow else (_RED, self.ticks)


LONE_RED = 10.0  # [s] red of a light that no controller names (reference `carla.md` 4.1)


class _Group:
    """A junction: its phases and the clock that runs them.

    Args:
        phases: Lights of each phase.
        cycle: Durations of its phases.

    Attributes:
        lights: All its lights.
        frozen_at: Tick at which it was stopped; None while it runs.
    """

    def __init__(self, phases: Sequence[Sequence[int]], cycle: LightCycle) -> None:
        self.phases = [np.array(phase, dtype=np.int64) for phase in phases]
        self.lights = np.concatenate(self.phases)
        self.cycle = cycle
        self.frozen_at: int | None = None
        self._lost = 0  # ticks spent frozen

    def freeze(self, tick: int) -> None:
        if self.frozen_at is None:
            self.frozen_at = tick

    def resume(self, tick: int) -> None:
        if self.frozen_at is not None:
            self._lost += tick - self.frozen_at
            self.frozen_at = None

    def write(self, tick: int, states: NDArray[np.uint8]) -> int:
        """Writes its lights' states at `tick`; returns the tick until which they hold."""
        clock = (tick if self.frozen_at is None else self.frozen_at) - self._lost
        phase, since = divmod(clock % (self.cycle.ticks * len(self.phases)), self.cycle.ticks)
        state, end = self.cycle.state(since)
        states[self.lights] = _RED
        states[self.phases[phase]] = state
        return tick + end - since if self.frozen_at is None else _NEVER


_NEVER = 2**62


class TrafficLights:
    """States of all lights of a town.

    Without a hazard's hand on it a group's state depends on the tick alone. Every group begins with its first phase
    green. A light in no group is one of its own, with a longer red.

    Args:
        count: Number of lights in the town.
        groups: Junctions with their phases.
        cycle: Durations.
    """

    def __init__(self, count: int, groups: Sequence[LightGroup], cycle: LightCycle | None = None) -> None:
        cycle = cycle or LightCycle()
        self._count = count
        self._groups = [_Group(group.phases, cycle) for group in groups if any(group.phases)]
        grouped = {int(light) for group in self._groups for light in group.lights}
        alone = LightCycle(cycle.green, cycle.yellow, LONE_RED)
        self._groups += [_Group([[light]], alone) for light in range(count) if light not in grouped]
        self._group_of = {int(light): group for group in self._groups for light in group.lights}
        self._held: dict[int, LightState] = {}
        self._states = np.zeros(0, np.uint8)
        self._valid = (1, 0)  # first and last tick of `_states`

    def states(self, time: float) -> NDArray[np.uint8]:
        """`LightState` of every light at `time` [s], `(L,)` uint8, read-only; the same array until one changes."""
        tick = round(time / DT)
        if not self._valid[0] <= tick < self._valid[1]:
            states = np.full(self._count, _RED, np.uint8)
            end = min((group.write(tick, states) for group in self._groups), default=_NEVER)
            for light, state in self._held.items():
                states[light] = state
            states.flags.writeable = False
            self._states, self._valid = states, (tick, end)
        return self._states

    def group_of(self, light: int) -> tuple[int, ...]:
        """All lights of the junction of `light`, itself included."""
        return tuple(int(member) for member in self._group_of[light].lights)

    def hold(self, light: int, state: LightState) -> None:
        """Keeps a light at `state` until `release`; its group's clock runs on."""
        self._held[light] = state
        self._forget()

    def release(self, light: int) -> None:
        """Lets a light follow its group again."""
        self._held.pop(light, None)
        self._forget()

    def hold_junction(self, light: int, time: float, greens: Sequence[int] = ()) -> None:
        """Stops the group of `light` at `time` [s]: all its lights red but `greens`, until `release_junction`."""
        group = self._group_of[light]
        group.freeze(round(time / DT))
        self._held |= {int(member): _GREEN if member in greens else _RED for member in group.lights}
        self._forget()

    def freeze_junction(self, light: int, time: float) -> None:
        """Stops the clock of the group of `light` with the states it has."""
        self._group_of[light].freeze(round(time / DT))
        self._forget()

    def release_junction(self, light: int, time: float) -> None:
        """Lets the group of `light` go on where it was when it was stopped."""
        group = self._group_of[light]
        group.resume(round(time / DT))
        for member in group.lights:
            self._held.pop(int(member), None)
        self._forget()

    def _forget(self) -> None:
        self._valid = (1, 0)
