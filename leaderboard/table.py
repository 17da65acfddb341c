"""A run as a table in the terminal, and the same for programs."""

from __future__ import annotations

from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from leaderboard.run import Run

_SHORT = {
    "collisions_pedestrian": "pedestrian",
    "collisions_vehicle": "vehicle",
    "collisions_layout": "layout",
    "red_light": "red light",
    "stop_infraction": "stop sign",
    "outside_route_lanes": "off-road",
    "route_dev": "deviation",
    "route_timeout": "timeout",
    "vehicle_blocked": "blocked",
    "min_speed_infractions": "min speed",
    "yield_emergency_vehicle_infractions": "emergency",
    "scenario_timeouts": "scenario timeout",
}


def short_name(key: str) -> str:
    """A kind of infraction in a word or two."""
    return _SHORT.get(key, key.replace("_", " "))


def infraction_text(infractions: dict[str, list[str]]) -> str:
    """ "2 vehicle, 1 red light"; "-" for none."""
    return ", ".join(f"{len(found)} {short_name(key)}" for key, found in infractions.items() if found) or "-"


def run_table(run: Run) -> RenderableType:
    """One row for each drive, the means below."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_footer=bool(run.mean))
    mean = run.mean
    table.add_column("route", "mean")
    table.add_column("town")
    table.add_column("status", str(run.total.get("status", "")))
    for name, key, digits in (
        ("completion %", "score_route", 1),
        ("penalty", "score_penalty", 3),
        ("score", "score_composed", 1),
    ):
        table.add_column(name, f"{mean.get(key, 0.0):.{digits}f}", justify="right")
    table.add_column("infractions", overflow="fold")
    for record in run.records:
        drive, scores = run.drive(record["index"]), record["scores"]
        good = record["status"] in ("Completed", "Perfect")
        repeated = int(run.run.get("config", {}).get("repetitions", 1)) > 1
        name = str(drive.get("route", record["route_id"]))
        table.add_row(
            Text(f"{name} #{drive.get('repetition', 0)}" if repeated else name),
            Text(str(drive.get("town", ""))),
            Text(record["status"], style="green" if good else "red"),
            f"{scores['score_route']:.1f}",
            f"{scores['score_penalty']:.3f}",
            f"{scores['score_composed']:.1f}",
            Text(infraction_text(record["infractions"])),
        )
    return Group(table, Text(_below(run), style="dim"))


def run_facts(run: Run) -> dict[str, Any]:
    """What the table says, for programs: scores in the leaderboard's own names and ranges."""
    drives = [
        {
            "route": str(run.drive(record["index"]).get("route", record["route_id"])),
            "repetition": run.drive(record["index"]).get("repetition", 0),
            "town": run.drive(record["index"]).get("town", ""),
            "status": record["status"],
            **record["scores"],
            "infractions": {kind: len(found) for kind, found in record["infractions"].items() if found},
        }
        for record in run.records
    ]
    about = {key: run.run.get(key) for key in ("rules", "benchmark_id", "track")}
    return {"run": str(run.folder), "status": run.total.get("status", ""), **about, "mean": run.mean, "drives": drives}


def _below(run: Run) -> str:
    rules, track = run.run.get("rules", ""), run.run.get("track")
    parts = [f"rules {rules}", f"benchmark {run.run.get('benchmark_id', '')}", str(run.results["entry_status"])]
    if track == "PRIVILEGED":
        parts.append("PRIVILEGED sensors: not comparable with sensor agents")
    elif track:
        parts.append(f"track {track}")
    return " · ".join(parts)
