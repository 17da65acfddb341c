"""All criteria of the rules, watching a drive as one observer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lavsim.agent import AgentFailure, AgentStatus
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import Criterion, Infraction, criteria_of
from leaderboard.criteria.completion import Completion
from leaderboard.rules import Rules
from leaderboard.score import SENSORS_INVALID, RouteRecord, record_of

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.map.route import Route
    from lavsim.map.town_map import TownMap
    from lavsim.simulation import Simulation

REASONS = {
    AgentStatus.CRASHED: "Agent crashed",
    AgentStatus.SETUP_FAILED: "Agent couldn't be set up",
    AgentStatus.SENSORS_INVALID: SENSORS_INVALID,
    AgentStatus.TIMED_OUT: "Agent timed out",
}


@dataclass(frozen=True)
class Verdict:
    """What the criteria saw of one drive.

    Attributes:
        completion: Percent of the route.
        reached: Whether the target was reached.
        infractions: In the order of the criteria.
        failure: The status reason that the agent's failure gives, if it failed.
        ticks: Ticks watched.
        route_length: Length of the dense route [m].
        keypoint_length: Length of the line through its waypoints [m].
    """

    completion: float = 0.0
    reached: bool = False
    infractions: tuple[Infraction, ...] = ()
    failure: str | None = None
    ticks: int = 0
    route_length: float = 0.0
    keypoint_length: float = 0.0

    @property
    def duration(self) -> float:
        """Simulated time from the first tick to the last [s]."""
        return max(self.ticks - 1, 0) * DT


class CriteriaObserver:
    """Runs the criteria of `rules` in their order; the first that says so ends the drive, after all saw the tick."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self._criteria: list[Criterion] = []
        self._infractions: dict[str, list[Infraction]] = {}
        self._ticks = 0
        self._failure: str | None = None
        self._lengths = (0.0, 0.0)

    def start(self, simulation: Simulation) -> None:
        self.watch(simulation.town, simulation.route)

    def watch(self, town: TownMap, route: Route) -> None:
        """Prepares for a drive of `route`, live or recorded."""
        self._criteria = [criterion(self.rules) for criterion in criteria_of(self.rules)]
        self._infractions = {criterion.name: [] for criterion in self._criteria}
        self._ticks, self._failure = 0, None
        self._lengths = float(route.length), float(route.keypoint_length)
        for criterion in self._criteria:
            criterion.start(town, route)

    def observe(self, snapshot: Snapshot) -> str | None:
        self._ticks += 1
        ending = None
        for criterion in self._criteria:
            found = criterion.update(snapshot)
            if found:
                self._infractions[criterion.name].extend(found)
            ending = ending or criterion.ending
        return ending

    def finish(self, result: EpisodeResult) -> None:
        self.close(result.failure)

    def close(self, failure: AgentFailure | None) -> None:
        """Ends the watch; `failure` is the agent's, if it failed."""
        self._failure = REASONS[failure.status] if failure else None
        for criterion in self._criteria:
            self._infractions[criterion.name].extend(criterion.finish())

    def verdict(self) -> Verdict:
        """What there is to judge the drive by."""
        completion = next((c for c in self._criteria if isinstance(c, Completion)), None)
        return Verdict(
            completion=completion.percent if completion else 0.0,
            reached=bool(completion and completion.reached),
            infractions=tuple(i for name in self._infractions for i in self._infractions[name]),
            failure=self._failure,
            ticks=self._ticks,
            route_length=self._lengths[0],
            keypoint_length=self._lengths[1],
        )


def judge(verdict: Verdict, rules: Rules, index: int, route_id: str, duration_system: float) -> RouteRecord:
    """The record of a drive that `verdict` tells of.

    Args:
        verdict: What the criteria saw.
        rules: What it is judged by; decide how long a route is called.
        index: Place of the drive in the run.
        route_id: As the results file has it.
        duration_system: Wall-clock time of the drive [s].
    """
    return record_of(
        index=index,
        route_id=route_id,
        completion=verdict.completion,
        reached=verdict.reached,
        infractions=verdict.infractions,
        failure=verdict.failure,
        route_length=verdict.keypoint_length if rules.route_length == "waypoints" else verdict.route_length,
        duration_game=verdict.duration,
        duration_system=duration_system,
        rules=rules,
    )
