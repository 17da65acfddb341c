"""The results file in the leaderboard's layout, for tools that read it, and the run file beside it.

`results.json` holds the leaderboard's keys and nothing else; `duration_system` is its one wall-clock field. All that
is ours (benchmark id, versions, configuration, timings, places of infractions) goes to `run.json`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lavsim.cache import replace_atomically
from lavsim.errors import OutputError
from leaderboard.criteria.base import charges_of
from leaderboard.rules import Rules
from leaderboard.score import (
    AGENT_FAILURES,
    SENSORS_INVALID,
    SIMULATION_CRASHED,
    RouteRecord,
    Scores,
    Summary,
    summarise,
)

RESULTS, RUN = "results.json", "run.json"

_ICONS = {
    "sensor.camera.rgb": "carla_camera",
    "sensor.lidar.ray_cast": "carla_lidar",
    "sensor.other.radar": "carla_radar",
    "sensor.other.gnss": "carla_gnss",
    "sensor.other.imu": "carla_imu",
    "sensor.opendrive_map": "carla_opendrive_map",
    "sensor.speedometer": "carla_speedometer",
}
_SCORE_LABELS = ("Avg. driving score", "Avg. route completion", "Avg. infraction penalty")
# 2.x files keep the order in which its code made them; 1.0 files are sorted.
_ORDER_2 = (
    "collisions_layout",
    "collisions_pedestrian",
    "collisions_vehicle",
    "red_light",
    "stop_infraction",
    "outside_route_lanes",
    "min_speed_infractions",
    "yield_emergency_vehicle_infractions",
    "scenario_timeouts",
    "route_dev",
    "vehicle_blocked",
    "route_timeout",
)


def sensor_icons(types: Sequence[str]) -> list[str]:
    """The results file's names of sensor types, in order; types of ours go by their own names."""
    return [_ICONS.get(kind, kind) for kind in types]


@dataclass(frozen=True)
class Results:
    """A run as far as it has come.

    Attributes:
        rules: What it is judged by.
        total: Planned drives.
        records: Those done, in order.
        sensors: Icons of the agent's sensors.
        finished: Whether no more will come.
        strict: Whether the originals' bookkeeping defects are kept (`--strict-compat`).
    """

    rules: Rules
    total: int
    records: tuple[RouteRecord, ...] = ()
    sensors: tuple[str, ...] = ()
    finished: bool = False
    strict: bool = False

    def with_record(self, record: RouteRecord) -> Results:
        return replace(self, records=(*self.records, record))

    def summary(self) -> Summary:
        return summarise(self.records, self.total, self.rules, self.strict)

    def entry_status(self) -> str:
        """How the run stands, in the words of its rules."""
        statuses = [r.status for r in self.records]
        if not self.finished:
            return "Started"
        if any(SENSORS_INVALID in s for s in statuses):
            return "Rejected"
        if self.rules.generation == "1.0":
            if any(SIMULATION_CRASHED in s for s in statuses):
                return "Crashed"
            if len(self.records) != self.total:
                return "Finished with missing data"
            return "Finished with agent errors" if any(map(self._is_agents_fault, statuses)) else "Finished"
        if any(SIMULATION_CRASHED in s for s in statuses):
            return "Crashed"
        return "Finished" if self.records and len(self.records) == self.total else "Invalid"

    def _is_agents_fault(self, status: str) -> bool:
        return "Agent" in status if self.rules.blames_agent else status.endswith(AGENT_FAILURES)

    def eligible(self) -> bool:
        """Whether the run may be entered."""
        entry = self.entry_status()
        return entry == "Finished" or (self.rules.generation == "1.0" and entry == "Finished with agent errors")

    def to_json(self) -> dict[str, Any]:
        """The file's content."""
        first = self.rules.generation == "1.0"
        summary = self.summary() if self.finished else None
        labels, values = self._values(summary) if summary else ([], [])
        untouched = self.strict and first and not self.finished and not self.records and not self.sensors
        content: dict[str, Any] = {
            "_checkpoint": {
                "global_record": self._global(summary) if summary else {},
                "progress": [len(self.records), self.total],
                "records": [self._record(r) for r in self.records],
            },
            "entry_status": "" if untouched else self.entry_status(),
            "eligible": "" if untouched else self.eligible(),
            "labels": labels,
            "values": values,
            "sensors": list(self.sensors),
        }
        if not first:
            content["_checkpoint"] = {k: content["_checkpoint"][k] for k in ("progress", "records", "global_record")}
        return content

    def write(self, folder: Path) -> None:
        """Replaces the results file in `folder`; a reader sees the old one or the whole new one."""
        text = json.dumps(self.to_json(), indent=4, sort_keys=self.rules.generation == "1.0")
        write_text(folder / RESULTS, text)

    def _record(self, record: RouteRecord) -> dict[str, Any]:
        infractions = {key: list(record.infractions.get(key, ())) for key in self._keys()}
        meta = {
            "route_length": record.route_length,
            "duration_game": record.duration_game,
            "duration_system": record.duration_system,
        }
        return {
            "index": record.index,
            "route_id": record.route_id,
            "status": record.status,
            **({} if self.rules.generation == "1.0" else {"num_infractions": record.count}),
            "infractions": infractions,
            "scores": _scores(record.scores),
            "meta": meta,
        }

    def _global(self, summary: Summary) -> dict[str, Any]:
        first = self.rules.generation == "1.0"
        exceptions = [list(e) for e in summary.exceptions]
        if summary.deviation is not None:
            deviation: dict[str, Any] = _scores(summary.deviation)
        else:
            deviation = dict.fromkeys(_scores(summary.mean), "NaN" if self.strict else None)
        return {
            "index": -1,
            "route_id": -1,
            "status": summary.status,
            "infractions": {key: summary.rates[key] for key in self._keys()},
            ("scores" if first else "scores_mean"): _scores(summary.mean),
            "scores_std_dev": deviation,
            "meta": {
                "total_length": summary.total_length,
                "duration_game": summary.duration_game,
                "duration_system": summary.duration_system,
                **({"exceptions": exceptions} if exceptions or not first else {}),
            },
        }

    def _values(self, summary: Summary) -> tuple[list[str], list[str]]:
        charges = sorted(charges_of(self.rules).values(), key=lambda charge: charge.column)
        mean = summary.mean
        numbers = [mean.composed, mean.route, mean.penalty, *(summary.rates[c.key] for c in charges)]
        show = str if self.rules.rounds else "{:.3f}".format
        return [*_SCORE_LABELS, *(c.label for c in charges)], [show(n) for n in numbers]

    def _keys(self) -> list[str]:
        keys = list(charges_of(self.rules))
        return sorted(keys, key=lambda k: _ORDER_2.index(k) if k in _ORDER_2 else len(_ORDER_2))


def _scores(of: Scores) -> dict[str, float]:
    return {"score_route": of.route, "score_penalty": of.penalty, "score_composed": of.composed}


def write_text(path: Path, text: str) -> None:
    """Replaces the file at `path` by `text`.

    Raises:
        OutputError: it can't be written.
    """
    try:
        replace_atomically(path, text.encode())
    except OSError as error:
        raise OutputError(f"can't write {path}: {error.strerror}") from None


def write_run(folder: Path, run: Mapping[str, Any]) -> None:
    """Replaces the run file in `folder`."""
    write_text(folder / RUN, json.dumps(run, indent=2, sort_keys=True, allow_nan=False) + "\n")
