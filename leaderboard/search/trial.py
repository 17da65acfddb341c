"""One drive of a search: how near to failing the agent came with these values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from lavsim.agent import AgentStatus
from lavsim.errors import AgentError
from lavsim.log.reader import LogReader
from leaderboard.drive import DriveTask, Tick, run_drive
from leaderboard.observer import Verdict
from leaderboard.outcomes import DriveOutcome
from leaderboard.score import SIMULATION_CRASHED
from leaderboard.search.criticality import Criticality, criticality_of

IGNORED = frozenset({"min_speed_infractions"})  # careful driving is no failure
NOT_REACHED, AGENT_FAILED = "not reached", "agent failed"
_DIGITS = 6


@dataclass(frozen=True)
class TrialTask:
    """A drive to be made.

    Attributes:
        number: Of the candidate.
        attempts: Candidates before it that could not stand on the route.
        point: The candidate in the unit cube.
        values: Of the hazard's parameters.
        drive: All that decides the drive.
    """

    number: int
    attempts: int
    point: tuple[float, ...]
    values: Mapping[str, float | str]
    drive: DriveTask


@dataclass(frozen=True)
class Trial:
    """How a drive went.

    Attributes:
        number: Of the candidate.
        attempts: Candidates before it that could not stand on the route.
        point: The candidate in the unit cube.
        values: Of the hazard's parameters.
        failed_by: Infractions from the hazard's trigger on, and "not reached"; empty: the agent did not fail.
        margin: 0 for a failure, else by time to contact and required deceleration up to 1; what is searched is small.
        set_off: Whether the hazard was.
        contact_time: Least time to contact [s]; None: none.
        deceleration: Largest required deceleration [m/s²].
        headway: Least time headway [s]; None: none.
        log: The recorded drive in the search's folder; failures alone keep it.
    """

    number: int
    attempts: int = 0
    point: tuple[float, ...] = ()
    values: Mapping[str, float | str] = field(default_factory=dict)
    failed_by: tuple[str, ...] = ()
    margin: float = 1.0
    set_off: bool = False
    contact_time: float | None = None
    deceleration: float = 0.0
    headway: float | None = None
    log: str | None = None

    @property
    def failed(self) -> bool:
        return bool(self.failed_by)

    def to_json(self) -> dict[str, Any]:
        """Its line in the search's file, without the number."""
        row = {key: value for key, value in asdict(self).items() if key != "number"}
        return {**row, "point": list(self.point), "failed_by": list(self.failed_by)}

    @staticmethod
    def from_json(number: int, row: Mapping[str, Any]) -> Trial:
        given = {**row, "number": number, "point": tuple(row["point"]), "failed_by": tuple(row["failed_by"])}
        return Trial(**given)


def run_trial(task: TrialTask, report: Callable[[Tick], None]) -> Trial:
    """Drives a candidate.

    Raises:
        AgentError: the agent could not be set up; it would not be for the next candidate either.
    """

    def on_tick(verdict: Verdict) -> None:
        report(Tick(task.number, verdict.completion, verdict.duration, len(verdict.infractions)))

    drive = task.drive
    outcome = run_drive(drive, on_tick)
    if outcome.details["agent_status"] in (AgentStatus.SETUP_FAILED, AgentStatus.SENSORS_INVALID):
        raise AgentError(f"{drive.agent.target} can't drive: {outcome.details['agent_message']}")
    critical, begun = criticality_of(LogReader(drive.log)) if drive.log.exists() else (Criticality(), -1)
    failed_by = causes_of(outcome, begun)
    if not failed_by:
        for path in (drive.log, drive.output):
            path.unlink(missing_ok=True)
    return Trial(
        number=task.number,
        attempts=task.attempts,
        point=task.point,
        values=dict(task.values),
        failed_by=failed_by,
        margin=0.0 if failed_by else round(critical.margin, _DIGITS),
        set_off=begun >= 0,
        log=drive.log.relative_to(drive.out).as_posix() if failed_by else None,
        **critical.to_json(),
    )


def lost_trial(task: TrialTask) -> Trial:
    """A candidate whose process was lost: not the agent's failure, and nothing to search around."""
    return Trial(task.number, task.attempts, task.point, dict(task.values))


def causes_of(outcome: DriveOutcome, begun: int) -> tuple[str, ...]:
    """Why a drive failed, from tick `begun` on; empty if it did not, or the hazard was never set off."""
    details = outcome.details
    if begun < 0 or outcome.record.status.endswith(SIMULATION_CRASHED):
        return ()
    keys = {str(i["key"]) for i in details["infractions"] if i["tick"] >= begun} - IGNORED
    if details["agent_status"]:
        return (*sorted(keys), AGENT_FAILED)
    return (*sorted(keys), *([NOT_REACHED] if details["completion"] < 100.0 else []))
