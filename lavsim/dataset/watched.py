"""An agent whose wishes and labels are recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from lavsim.agent import AgentPlan, Readings, Track
from lavsim.agent_runner import InProcessAgent
from lavsim.types import Control


class Driver(Protocol):
    """What a recorder asks of whoever drives."""

    @property
    def wish(self) -> Control | None:
        """The control asked for in the last step."""

    def labels(self) -> Mapping[str, Any]:
        """What it says of its driving, of the last step."""


class Watched:
    """An agent handle that remembers what its agent asked for.

    Args:
        agent: The agent, not started yet.
    """

    def __init__(self, agent: InProcessAgent) -> None:
        self._agent = agent
        self.wish: Control | None = None

    @property
    def track(self) -> Track:
        return self._agent.track

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        self._agent.start(plan, spacing)

    def sensors(self) -> list[dict[str, Any]]:
        return self._agent.sensors()

    def step(self, readings: Readings, time: float) -> Control:
        self.wish = self._agent.step(readings, time)
        return self.wish

    def labels(self) -> Mapping[str, Any]:
        return self._agent.labels()

    def close(self) -> None:
        self._agent.close()
