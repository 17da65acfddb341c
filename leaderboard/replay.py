"""Replays of scored drives: what the viewer tells about a drive, taken from its run or judged again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lavsim.errors import OutputError
from lavsim.log.reader import LogReader
from lavsim.viewer.replay import Event, Story
from leaderboard.observer import CriteriaObserver
from leaderboard.recorded import RecordedDrive
from leaderboard.rules import get_rules
from leaderboard.run import Run
from leaderboard.table import short_name


def story_of(log: LogReader, drive: Mapping[str, Any], record: Mapping[str, Any], run: Run) -> Story:
    """What is told of a drive of `run`.

    Args:
        log: The recorded drive.
        drive: The run file's entry.
        record: The leaderboard's record.
        run: The run.
    """
    config = run.run.get("config", {})
    scores = record["scores"]
    parts = [
        str(drive.get("town", log.town_name)),
        f"seed {drive.get('seed', '?')}",
        f"rules {run.run.get('rules', '?')}",
    ]
    parts.append(f"score {scores['score_composed']:.1f}, completion {scores['score_route']:.1f} %")
    return Story(
        title=f"Route {drive.get('route', record['route_id'])}: {config.get('agent', 'agent')}",
        subtitle=" · ".join(parts),
        badge=str(record["status"]),
        is_good=record["status"] in ("Completed", "Perfect"),
        note=_note(log, drive.get("agent_message")),
        infractions=events_of(drive.get("infractions", [])),
    )


def story_of_log(recorded: RecordedDrive) -> Story:
    """What is told of a log: from the run that it lies in, else judged again by the rules of its header."""
    log = recorded.log
    try:
        run = Run.load(log.path.parent.parent)
    except OutputError:
        run = None
    for record in run.records if run is not None else ():
        assert run is not None
        drive = run.drive(record["index"])
        if drive.get("log") and (run.folder / drive["log"]).resolve() == log.path.resolve():
            return story_of(log, drive, record, run)
    version = str(log.header.get("rules", "1.0"))
    ending = str((log.status or {}).get("ending", ""))
    return Story(
        title=f"Route {log.header.get('route_id', log.path.stem)}",
        subtitle=" · ".join((log.town_name, f"seed {log.header.get('seed', '?')}", f"rules {version}")),
        badge=ending if len(ending) < 40 else "",
        note=_note(log, None),
        infractions=events_of(_judged(recorded, version)),
    )


def events_of(infractions: Sequence[Mapping[str, Any]]) -> list[Event]:
    """Infractions as the viewer takes them, in the order of the run file."""
    return [
        Event(int(i["tick"]), short_name(str(i["key"])), str(i["message"]), *(float(v) for v in i["position"][:2]))
        for i in infractions
    ]


def _judged(recorded: RecordedDrive, version: str) -> list[dict[str, Any]]:
    criteria = CriteriaObserver(get_rules(version))
    criteria.watch(recorded.town, recorded.route)
    for snapshot in recorded.log:
        if criteria.observe(snapshot) is not None:
            break
    criteria.close(None)
    return [i.to_json() for i in sorted(criteria.verdict().infractions, key=lambda i: i.tick)]


def _note(log: LogReader, message: Any) -> str:
    if message:
        return f"The agent ended it: {message}"
    return "The recording is cut short." if log.status is None else ""
