"""An expert that takes the wheel of a recorded drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.agent import AgentHandle, AgentShell, Readings
from lavsim.log.replay import control_of
from lavsim.types import DT, Control

HANDOVER = "handover"  # entry of a log's header: the tick from which the agent that it names drove


def first_of(header: Mapping[str, Any]) -> int:
    """The tick from which a log shows the agent that it names; 0 where it drove from the beginning."""
    return int(header.get(HANDOVER, 0))


class Handover(AgentShell):
    """Gives the recorded controls up to a tick, and an agent's from there on.

    The agent is asked from the first tick on, so that it knows what has been by the time it drives.

    Args:
        agent: Who takes over.
        controls: (T, 5) `Snapshot.control` of the recorded ticks, those that its agent never asked for among them.
        first: Tick of the first of them.
        tick: The agent's first.
    """

    def __init__(self, agent: AgentHandle, controls: NDArray[np.float32], first: int, tick: int) -> None:
        super().__init__(agent)
        self._controls, self._first, self._tick = controls, first, tick

    def step(self, readings: Readings, time: float) -> Control:
        own = self._agent.step(readings, time)
        tick = round(time / DT)
        if tick >= self._tick:
            return own
        return control_of(self._controls[tick + 1 - self._first])  # a tick's control led there
