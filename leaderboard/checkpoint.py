"""One file for each drive done, so that a run killed at any moment goes on where it was.

A drive's file is written in one piece after its log and picture are; a drive without one is driven again from its
start. What the run's own files say is made from these alone, so a run that was interrupted ends with the files of one
that was not, wall-clock fields apart.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lavsim.errors import OutputError
from leaderboard.outcomes import DriveOutcome
from leaderboard.record import write_text
from leaderboard.run import DRIVES
from leaderboard.score import RouteRecord, Scores

SCHEMA = 1


def save_outcome(folder: Path, name: str, outcome: DriveOutcome) -> None:
    """Writes the file of the drive called `name` into the run's `folder`."""
    record = outcome.record
    content = {
        "schema": SCHEMA,
        "record": {
            "index": record.index,
            "route_id": record.route_id,
            "status": record.status,
            "scores": record.scores.to_json(),
            "infractions": {key: list(texts) for key, texts in record.infractions.items()},
            "route_length": record.route_length,
            "duration_game": record.duration_game,
            "duration_system": record.duration_system,
            "metres_outside": record.metres_outside,
        },
        "sensors": list(outcome.sensors),
        "track": outcome.track,
        "details": outcome.details,
    }
    write_text(folder / DRIVES / f"{name}.json", json.dumps(content, indent=2, allow_nan=False) + "\n")


def load_outcome(folder: Path, name: str) -> DriveOutcome | None:
    """The drive called `name` as its file in `folder` tells it; None if it was not finished.

    Raises:
        OutputError: the file is not one of ours.
    """
    path = folder / DRIVES / f"{name}.json"
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA:
            raise OutputError(f"{path} has schema {content['schema']}, this lavsim reads {SCHEMA}")
        return DriveOutcome(
            _record(content["record"]), tuple(content["sensors"]), content["track"], dict(content["details"])
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"can't read {path}: {error}") from None


def _record(fields: Mapping[str, Any]) -> RouteRecord:
    scores = fields["scores"]
    return RouteRecord(
        **{
            **fields,
            "scores": Scores(scores["score_route"], scores["score_penalty"], scores["score_composed"]),
            "infractions": {key: tuple(texts) for key, texts in fields["infractions"].items()},
            "read_back": True,
        }
    )
