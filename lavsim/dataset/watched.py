"""An agent whose wishes and labels are recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from lavsim.agent import AgentShell, Readings
from lavsim.agent_runner import InProcessAgent
from lavsim.types import Control


class Driver(Protocol):
    """What a recorder asks of whoever drives."""

    @property
    def wish(self) -> Control | None:
        """The control asked for in the last step."""

    def labels(self) -> Mapping[str, Any]:
        """What it says of its driving, of the last step."""


class Watched(AgentShell):
    """An agent handle that remembers what its agent asked for.

    Args:
        agent: The agent, not started yet.
    """

    def __init__(self, agent: InProcessAgent) -> None:
        super().__init__(agent)
        self._labels = agent.labels
        self.wish: Control | None = None

    def step(self, readings: Readings, time: float) -> Control:
        self.wish = self._agent.step(readings, time)
        return self.wish

    def labels(self) -> Mapping[str, Any]:
        return self._labels()
