"""What drives come to, and a run's files made from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from leaderboard.abilities import run_metrics
from leaderboard.record import Results, sensor_icons, write_run
from leaderboard.rules import Rules
from leaderboard.score import SHORTEST, RouteRecord, plain_rates

RUN_SCHEMA = 2


@dataclass(frozen=True)
class DriveOutcome:
    """What came of a drive.

    Attributes:
        record: For the results file.
        sensors: Types of the agent's sensors, in order; empty when it never said.
        track: The agent's track; None when it never said.
        details: For the run file, in JSON types.
    """

    record: RouteRecord
    sensors: tuple[str, ...]
    track: str | None
    details: dict[str, Any]


def write_outcomes(
    folder: Path,
    outcomes: Sequence[DriveOutcome],
    total: int,
    rules: Rules,
    header: Mapping[str, Any],
    finished: bool,
    strict: bool = False,
) -> Results:
    """Replaces results file and run file in `folder`.

    Args:
        folder: The run's.
        outcomes: Of the drives done, in order.
        total: Planned drives.
        rules: What they are judged by.
        header: What the run file says besides the drives.
        finished: Whether no more will come.
        strict: Whether the originals' bookkeeping defects are kept.

    Returns:
        What the results file says.
    """
    sensors = next((o.sensors for o in outcomes if o.sensors), ())
    results = Results(
        rules, total, tuple(outcome.record for outcome in outcomes), tuple(sensor_icons(sensors)), finished, strict
    )
    drives = [outcome.details for outcome in outcomes]
    kilometres = sum(d["dense_length"] * d["completion"] / 1e5 for d in drives)
    run = {
        **header,
        "track": header.get("track") or next((o.track for o in outcomes if o.track), None),
        "drives": drives,
        "kilometres": kilometres,
        "infractions_per_km": plain_rates(results.records, max(kilometres, SHORTEST), rules),
        "metrics": run_metrics(results.records, drives, total),
    }
    results.write(folder)
    write_run(folder, run)
    return results
