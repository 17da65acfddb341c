"""Bursts of steering noise, so that demonstrations show how to come back from where an expert never is.

The world gets the disturbed control; what the expert wished stays beside it as a label. A burst is a pure function of
draws, tick and speed, so a log tells both again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pydantic import Field, model_validator

from lavsim.agent import AgentHandle, AgentShell, Readings
from lavsim.config import Config
from lavsim.random import Draws
from lavsim.types import DT, Control
from lavsim.world.dynamics import steer_curvature

_FULL_STEER = steer_curvature(1.0)  # [1/m]
_SLOWEST = 3.0  # [m/s] below this speed a burst is no stronger
_STANDS = 0.5  # [m/s] who is slower is left alone
_WEAKEST = 0.4  # share of the largest push that a burst has at least


class ControlNoise(Config):
    """How the control of an expert is disturbed.

    Time is cut into spans of `every` seconds; in each at most one burst begins and ends. Its strength rises to the
    middle and falls again, and is bound to the speed: a burst pushes as hard at 5 as at 15 m/s.

    Source: triangular steering impulses after Codevilla et al. 2018, "End-to-end driving via conditional imitation
    learning", section V.
    """

    every: float = Field(default=5.0, gt=0.0, description="length of a span [s]")
    share: float = Field(default=0.5, ge=0.0, le=1.0, description="of spans that have a burst")
    shortest: float = Field(default=0.8, gt=0.0, description="duration of a burst [s]")
    longest: float = Field(default=2.0, gt=0.0, description="duration of a burst [s]")
    push: float = Field(default=5.0, ge=0.0, description="largest lateral acceleration that a burst adds [m/s²]")
    most: float = Field(default=0.3, ge=0.0, le=1.0, description="largest steer that a burst adds")

    @model_validator(mode="after")
    def _bursts_fit(self) -> ControlNoise:
        if not self.shortest <= self.longest <= self.every:
            raise ValueError(f"bursts of {self.shortest:g} to {self.longest:g} s must fit into {self.every:g} s")
        return self

    def steer(self, draws: Draws, tick: int, speed: float) -> float:
        """The steer that is added at `tick`, -1 to 1.

        Args:
            draws: Root of the drive's draws.
            tick: Of the world.
            speed: The ego's [m/s].
        """
        if speed < _STANDS:
            return 0.0
        time = tick * DT
        span = int(time / self.every)
        has, begin, lasts, strength = draws.stream("control noise").uniform(span, 4).tolist()
        if has >= self.share:
            return 0.0
        length = self.shortest + lasts * (self.longest - self.shortest)
        share = (time - span * self.every - begin * (self.every - length)) / length
        if not 0.0 < share < 1.0:
            return 0.0
        side = 2.0 * strength - 1.0
        push = self.push * math.copysign(_WEAKEST + (1.0 - _WEAKEST) * abs(side), side)
        curvature = push / max(speed, _SLOWEST) ** 2
        steer = min(max(curvature / _FULL_STEER, -self.most), self.most)
        return float(steer * (1.0 - abs(2.0 * share - 1.0)))


class DisturbedAgent(AgentShell):
    """An agent whose steer is disturbed on its way to the world.

    Args:
        agent: Who drives.
        noise: How it is disturbed.
        draws: Root of the drive's draws.
        speed: Reads the ego's speed [m/s].

    Attributes:
        wish: What the agent asked for last.
    """

    def __init__(self, agent: AgentHandle, noise: ControlNoise, draws: Draws, speed: Callable[[], float]) -> None:
        super().__init__(agent)
        self._noise, self._draws, self._speed = noise, draws, speed
        self.wish = Control()

    def step(self, readings: Readings, time: float) -> Control:
        self.wish = self._agent.step(readings, time)
        added = self._noise.steer(self._draws, round(time / DT), self._speed())
        return replace(self.wish, steer=min(max(self.wish.steer + added, -1.0), 1.0))

    def labels(self) -> dict[str, Any]:
        """What the agent says of its last step."""
        return self._agent.labels() if hasattr(self._agent, "labels") else {}
