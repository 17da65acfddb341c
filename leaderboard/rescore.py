"""Judges recorded drives again, by other rules or newer criteria, without driving."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from lavsim.agent import AgentFailure, AgentStatus
from lavsim.errors import OutputError
from leaderboard.metrics import DriveMetrics, MetricsObserver
from leaderboard.observer import REASONS, CriteriaObserver, Verdict, judge
from leaderboard.outcomes import RUN_SCHEMA, DriveOutcome, write_outcomes
from leaderboard.recorded import RecordedDrive
from leaderboard.report.page import write_report
from leaderboard.rules import Rules, get_rules
from leaderboard.run import Run, claim_folder
from leaderboard.score import SIMULATION_CRASHED


def rescore(
    folder: Path, version: str, out: Path | None = None, overwrite: bool = False, town_path: Sequence[Path] = ()
) -> Run:
    """Judges the drives of a run by the rules of `version`.

    Where these would have ended a drive earlier (Bench2Drive's shorter blocked test), it is judged up to there; they
    can't make a drive longer than it was.

    Args:
        folder: The run's.
        version: Of the rules.
        out: Folder of the new run; None: below the old one.
        overwrite: Whether a run in `out` is replaced.
        town_path: Folders with towns.

    Returns:
        The new run, which lies in `out`.

    Raises:
        LavsimError: no such run or rules, a run that was cut short, a log that can't be read, or an occupied folder.
    """
    rules, old = get_rules(version), Run.load(folder)
    if old.run.get("schema") != RUN_SCHEMA:
        raise OutputError(f"{folder} has schema {old.run.get('schema')}, this lavsim reads {RUN_SCHEMA}")
    done, total = old.results["_checkpoint"]["progress"]
    if done != total:
        raise OutputError(f"the run in {folder} has {done} of {total} drives: finish it with --resume first")
    out = out or folder / f"rescored-{version}"
    outcomes = [_judge_again(old, record, rules, out, town_path) for record in old.records]
    claim_folder(out, overwrite)
    strict = bool(old.run["config"].get("strict_compat")) and rules.version != "corrected"
    header = {
        **{key: old.run[key] for key in ("schema", "versions", "look", "seed", "seeds", "track")},
        "benchmark_id": f"{old.run['benchmark_id']}, judged by {version}",
        "config": {**old.run["config"], "rules": version, "strict_compat": strict},
        "rules": version,
        "driven_under": old.run["rules"],
    }
    write_outcomes(out, outcomes, total, rules, header, finished=True, strict=strict)
    made = Run.load(out)
    write_report(made, with_replays=False)  # they take as long as judging; `lavsim report` writes them
    return made


def _judge_again(old: Run, record: dict[str, Any], rules: Rules, out: Path, town_path: Sequence[Path]) -> DriveOutcome:
    drive = old.drive(record["index"])
    log = old.folder / drive["log"] if drive.get("log") else None
    verdict, metrics = _watch(log, rules, town_path) if log is not None else (_never_driven(drive), DriveMetrics())
    name = drive["name"].removesuffix(f"_rep{drive['repetition']}")
    route_id = f"{name}_rep{drive['repetition']}" if rules.repetition_in_id else name
    details = {
        **drive,
        "completion": verdict.completion,
        "ticks": verdict.ticks,
        "infractions": [i.to_json() for i in sorted(verdict.infractions, key=lambda i: i.tick)],
        "metrics": metrics.to_json(),
        "log": _from(out, log),
        "picture": _from(out, old.folder / drive["picture"] if drive.get("picture") else None),
    }
    if record["status"].endswith(SIMULATION_CRASHED):
        verdict = replace(verdict, failure=SIMULATION_CRASHED)
    judged = judge(verdict, rules, record["index"], route_id, record["meta"]["duration_system"])
    return DriveOutcome(judged, tuple(old.results["sensors"]), old.run["track"], details)


def _watch(log: Path, rules: Rules, town_path: Sequence[Path]) -> tuple[Verdict, DriveMetrics]:
    recorded = RecordedDrive.open(log, town_path)
    criteria, metrics = CriteriaObserver(rules), MetricsObserver()
    criteria.watch(recorded.town, recorded.route)
    metrics.watch(recorded.town, recorded.route)
    status = recorded.log.status
    if status is None:
        raise OutputError(f"{log} was cut short: drive it again, a score of a part means nothing")
    failure: AgentFailure | None = None
    if status["agent_status"]:
        failure = AgentFailure(AgentStatus(status["agent_status"]), status["ending"])
    for snapshot in recorded.log:
        metrics.observe(snapshot)
        if criteria.observe(snapshot) is not None:
            failure = None
            break
    criteria.close(failure)
    return criteria.verdict(), metrics.metrics()


def _never_driven(drive: dict[str, Any]) -> Verdict:
    """The verdict of a drive that ended before its first tick."""
    status = AgentStatus(drive["agent_status"])
    verdict = Verdict(route_length=drive["dense_length"], keypoint_length=drive["keypoint_length"])
    return replace(verdict, failure=REASONS.get(status, SIMULATION_CRASHED))


def _from(folder: Path, path: Path | None) -> str | None:
    """`path` as a run in `folder` names it: relative, so that both can move together."""
    if path is None:
        return None
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
