"""Joins the results of runs that shared out the routes of one benchmark.

Reads runs of ours and results files that the leaderboard itself wrote. Source: reference `leaderboard.md` 5.3.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lavsim.errors import OutputError
from leaderboard.criteria.base import charges_of
from leaderboard.outcomes import RUN_SCHEMA, DriveOutcome, write_outcomes
from leaderboard.record import RESULTS, Results
from leaderboard.report.page import write_report
from leaderboard.rules import Rules, get_rules
from leaderboard.run import Run, claim_folder
from leaderboard.score import OUTSIDE, RouteRecord, Scores, metres_of_text

_ROUTE_ID = re.compile(r"RouteScenario_(?P<route>.+?)(?:_rep(?P<repetition>\d+))?$")


@dataclass(frozen=True)
class Part:
    """What one source adds.

    Attributes:
        path: The file or folder.
        total: Drives it was planned to have.
        records: Those it has.
        sensors: Icons of the agent's sensors.
        run: The run, where it is one of ours.
    """

    path: Path
    total: int
    records: tuple[RouteRecord, ...]
    sensors: tuple[str, ...]
    run: Run | None


def merge(
    sources: Sequence[Path], out: Path, version: str | None = None, overwrite: bool = False, strict: bool = False
) -> Results:
    """Joins `sources` into one run in the folder `out`.

    Args:
        sources: Folders of runs, or results files of the leaderboard.
        out: Folder of the joined run; it gets a report where every source is a run of ours.
        version: Rules that results files were written under; runs of ours say so themselves.
        overwrite: Whether a run in `out` is replaced.
        strict: Whether the originals' bookkeeping defects are kept.

    Returns:
        What the joined results file says.

    Raises:
        OutputError: a source can't be read, or they don't belong together: other rules, other sensors, a route twice.
    """
    rules = _common_rules(sources, version)
    parts = [_read(path, rules) for path in sources]
    suites = {part.sensors for part in parts if part.sensors}
    if len(suites) > 1:
        raise OutputError(f"{parts[0].path} and the others were driven with different sensors: they can't be joined.")
    joined = sorted(((record, part) for part in parts for record in part.records), key=lambda pair: _place(pair[0]))
    _refuse_twice([record for record, _ in joined])
    claim_folder(out, overwrite)
    sensors = next(iter(suites), ())
    outcomes = [_outcome(record, part, number, out, sensors) for number, (record, part) in enumerate(joined)]
    total = sum(part.total for part in parts)
    finished = len(outcomes) == total
    results = write_outcomes(out, outcomes, total, rules, _header(parts, rules), finished, strict)
    if all(part.run is not None for part in parts):
        write_report(Run.load(out))
    return results


def read_record(content: Mapping[str, Any], rules: Rules) -> RouteRecord:
    """A record of a results file; the metres driven outside are read from its text: there is no other place."""
    meta, scores, found = content["meta"], content["scores"], content["infractions"]
    infractions = {key: tuple(found.get(key, ())) for key in charges_of(rules)}
    outside = infractions.get(OUTSIDE, ())
    return RouteRecord(
        index=int(content["index"]),
        route_id=str(content["route_id"]),
        status=str(content["status"]),
        scores=Scores(scores["score_route"], scores["score_penalty"], scores["score_composed"]),
        infractions=infractions,
        route_length=meta["route_length"],
        duration_game=meta["duration_game"],
        duration_system=meta["duration_system"],
        metres_outside=metres_of_text(outside[0]) if outside else 0.0,
        read_back=True,
    )


def _common_rules(sources: Sequence[Path], version: str | None) -> Rules:
    named = {Run.load(path).run["rules"] for path in sources if path.is_dir()}
    named |= {version} if version is not None else set()
    if not named:
        raise OutputError("results files don't say what rules they were written under: give --rules.")
    if len(named) > 1:
        raise OutputError(f"runs under the rules {' and '.join(sorted(named))} can't be joined.")
    return get_rules(named.pop())


def _read(path: Path, rules: Rules) -> Part:
    run = Run.load(path) if path.is_dir() else None
    file = path / RESULTS if run else path
    try:
        content = run.results if run else json.loads(file.read_text(encoding="utf-8"))
        checkpoint = content["_checkpoint"]
        records = tuple(read_record(record, rules) for record in checkpoint["records"])
        return Part(path, int(checkpoint["progress"][1]), records, tuple(content["sensors"]), run)
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise OutputError(f"{file} is no results file of the leaderboard: {error!r}.") from None


def _place(record: RouteRecord) -> tuple[int, str, int]:
    """Where a record stands: by route number, then by repetition; names that are no numbers come last."""
    match = _ROUTE_ID.match(record.route_id)
    route, repetition = (match["route"], match["repetition"]) if match else (record.route_id, None)
    number = int(route) if route.isdigit() else 2**31
    return number, route if number == 2**31 else "", int(repetition or 0)


def _refuse_twice(records: Sequence[RouteRecord]) -> None:
    seen: dict[str, int] = {}
    for record in records:
        seen[record.route_id] = seen.get(record.route_id, 0) + 1
    twice = [route for route, count in seen.items() if count > 1]
    if twice:
        raise OutputError(f"{twice[0]} is in more than one of the runs; each drive may be there once.")


def _outcome(record: RouteRecord, part: Part, index: int, out: Path, sensors: tuple[str, ...]) -> DriveOutcome:
    record_there = replace(record, index=index, metres_outside=_metres_of(record, part))
    details: dict[str, Any] = {"index": index, "name": record.route_id, "dense_length": record.route_length}
    details |= {"completion": record.scores.route, "log": None, "picture": None}
    details |= {"scenarios": [], "metrics": {}}
    if part.run is None:
        return DriveOutcome(record_there, sensors, None, details)
    details |= part.run.drive(record.index) | {"index": index}
    for name in ("log", "picture"):
        if details.get(name):
            details[name] = Path(os.path.relpath((part.path / details[name]).resolve(), out.resolve())).as_posix()
    return DriveOutcome(record_there, sensors, part.run.run["track"], details)


def _metres_of(record: RouteRecord, part: Part) -> float:
    """Metres off the road [m]: as the run says where it is one of ours, else as the text does."""
    if part.run is None:
        return record.metres_outside
    found = part.run.drive(record.index)["infractions"]
    return float(sum(i["metres"] or 0.0 for i in found if i["key"] == OUTSIDE))


def _header(parts: Sequence[Part], rules: Rules) -> dict[str, Any]:
    runs = [part.run.run for part in parts if part.run is not None]
    ids = sorted({run["benchmark_id"] for run in runs})
    first = runs[0] if runs else {}
    return {
        "schema": RUN_SCHEMA,
        "rules": rules.version,
        "benchmark_id": "+".join(ids) or "unknown",
        "merged_from": [str(part.path) if not part.path.is_absolute() else part.path.name for part in parts],
        **{key: first.get(key) for key in ("versions", "config", "look", "seed", "seeds", "track")},
    }
