"""An actor that drives along a line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import Script, Stage
from lavsim.scenarios.moves.pursuit import STEP, Column, Line, line_of, make_column, pursue
from lavsim.world.actor import Actor

ACCELERATION, DECELERATION = 4.0, 8.0  # [m/s²] at most, where a hazard says nothing else


def step_column(stage: Stage, line: Line, column: Column, limits: tuple[float, float]) -> None:
    """Lets all vehicles of `column` act for this tick."""
    world, n = stage.world, stage.world.count
    pursue(
        line, column, world.tick, limits, world.present[:n], world.pose[:n], world.velocity[:n], world.body[:n, 0],
        world.half_sizes, world.height[:n], world.touched[:n], world.command[:n],
    )  # fmt: skip


class LaneFollower:
    """Drives an actor along a line until its end, where it stops.

    Args:
        stage: Where.
        actor: Any vehicle, near the beginning of the line.
        line: (N, 2) lane centres (`lavsim.scenarios.place.line_ahead`) or any other points [m].
        speed: Wanted [m/s]; slower in bends.
        keeps_distance: Whether it brakes for what stands or drives ahead of it.
        limits: How hard it speeds up and brakes at most [m/s²].
    """

    def __init__(
        self,
        stage: Stage,
        actor: Actor,
        line: NDArray[np.float64],
        speed: float,
        keeps_distance: bool = False,
        limits: tuple[float, float] = (ACCELERATION, DECELERATION),
    ) -> None:
        self.actor, self.line, self.limits = actor, line_of(line), limits
        self._stage, self._column = stage, make_column(1)
        self._column.row[0], self._column.keeps[0] = actor.row, keeps_distance
        gaps = np.hypot(*(self.line.xy - actor.xy).T)
        self._column.at[0] = STEP * float(np.argmin(gaps))
        self.speed = speed

    @property
    def speed(self) -> float:
        """Wanted speed [m/s]."""
        return float(self._column.wanted[0])

    @speed.setter
    def speed(self, value: float) -> None:
        self._column.wanted[0] = value

    @property
    def travelled(self) -> float:
        """Metres of the line behind it."""
        return float(self._column.at[0])

    @property
    def left(self) -> float:
        """Metres of the line before it."""
        return self.line.length - self.travelled

    @property
    def finished(self) -> bool:
        """Whether it is at the end of the line, or gone."""
        return self.left < 0.5 or not self.actor.is_present

    def start_aside(self, offset: float) -> None:
        """Takes `offset` metres to the right of the line for its place, without moving there."""
        self._column.offset[0] = self._column.target[0] = offset

    def shift(self, offset: float, seconds: float) -> None:
        """Moves `offset` metres to the right of the line within that time: a cut-in, a lane change."""
        self._column.target[0] = offset
        self._column.rate[0] = abs(offset - self._column.offset[0]) / max(seconds, 0.05)

    def step(self) -> None:
        """Acts for this tick."""
        if self.finished:
            self.actor.drive(0.0)
        else:
            step_column(self._stage, self.line, self._column, self.limits)

    def run(self) -> Script:
        """Acts until the line ends."""
        while not self.finished:
            self.step()
            yield
        self.actor.drive(0.0)

    def stop(self) -> Script:
        """Brakes to standstill on the line."""
        self.speed = 0.0
        while self.actor.speed > 0.01 and self.actor.is_present:
            self.step()
            yield
        self.actor.drive(0.0)
