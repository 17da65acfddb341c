"""The only drive loop: snapshot, sensors, agent, observers, next tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from lavsim.agent import AgentFailure, AgentHandle
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.world.snapshot import Snapshot


@dataclass(frozen=True)
class EpisodeResult:
    """How a drive ended.

    Attributes:
        ticks: Number of snapshots that observers saw.
        ending: What ended it: an observer's text, or the agent's failure.
        failure: The agent's failure, if that ended it.
    """

    ticks: int
    ending: str
    failure: AgentFailure | None = None

    def summary(self) -> dict[str, Any]:
        """The same in JSON types, without anything that depends on the clock."""
        status = int(self.failure.status) if self.failure is not None else 0
        return {"ticks": self.ticks, "ending": self.ending, "agent_status": status}


class Observer(Protocol):
    """Sees every tick of a drive: criteria, recorder, video."""

    def start(self, simulation: Simulation) -> None:
        """Called once, before the first tick is observed."""

    def observe(self, snapshot: Snapshot) -> str | None:
        """Sees a tick; a text ends the drive once all observers have seen it."""

    def finish(self, result: EpisodeResult) -> None:
        """Called once, however the drive ended."""


def run_episode(
    simulation: Simulation,
    agent: AgentHandle,
    observers: Sequence[Observer],
    suite: SensorSuite,
    max_ticks: int | None = None,
) -> EpisodeResult:
    """Drives until an observer ends it or the agent fails.

    Args:
        simulation: The world, at its first tick.
        agent: A started agent; it stays open.
        observers: In the order in which they see each tick.
        suite: Sensors that are read every tick, whether the agent asked for them or not.
        max_ticks: Ends the drive after so many ticks with the text "tick limit"; None lets observers decide.

    Returns:
        How it ended; the observers have been told too.
    """
    for observer in observers:
        observer.start(simulation)
    result: EpisodeResult | None = None
    ticks = 0
    try:
        while result is None:
            snapshot = simulation.snapshot
            try:
                control = agent.step(suite.read(simulation.recent(suite.history + 1)), snapshot.time)
            except AgentFailure as failure:  # as in the original, nobody judges the tick an agent failed in
                result = EpisodeResult(ticks, failure.message, failure)
                continue
            ticks += 1
            endings = [observer.observe(snapshot) for observer in observers]
            ending = next((text for text in endings if text is not None), None)
            if ending is not None:
                result = EpisodeResult(ticks, ending)
            elif max_ticks is not None and ticks >= max_ticks:
                result = EpisodeResult(ticks, "tick limit")
            else:
                simulation.tick(control)
    finally:
        final = result or EpisodeResult(ticks, "interrupted")
        for observer in observers:
            observer.finish(final)
    return final
