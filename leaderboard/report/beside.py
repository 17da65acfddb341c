"""The part of a report that tells what was measured beside the score."""

from __future__ import annotations

from typing import Any

from leaderboard.report.drive import drive_name
from leaderboard.report.markup import Markup, el, join
from leaderboard.run import Run

# Key in the run file, head of the column, digits.
_OF_DRIVES = (
    ("efficiency", "efficiency", 1),
    ("smoothness", "smooth", 2),
    ("mean_speed", "speed m/s", 1),
    ("speeding_seconds", "speeding s", 1),
    ("critical_seconds", "critical s", 1),
    ("least_distance", "least gap m", 2),
    ("harsh_brakings", "harsh brakings", 0),
    ("mean_jerk", "jerk m/s³", 2),
)


def beside_the_score(run: Run) -> Markup | None:
    """Bench2Drive's measures of the run and ours of each drive; None for a run without any (merged results files)."""
    total: dict[str, Any] = run.run.get("metrics") or {}
    drives = [(record, run.drive(record["index"]).get("metrics") or {}) for record in run.records]
    if not total and not any(metrics for _, metrics in drives):
        return None
    told = [
        ("success rate", total.get("success_rate")),
        ("efficiency", total.get("efficiency")),
        ("smoothness", total.get("smoothness")),
        *((f"{name.lower()} ability", value) for name, value in (total.get("abilities") or {}).items()),
    ]
    facts = [el("span", el("span", f"{name} ", class_="soft"), f"{_number(value, 1)} %") for name, value in told]
    head = el("tr", el("th", "route"), [el("th", name, class_="num") for _, name, _ in _OF_DRIVES])
    rows = [
        el(
            "tr",
            el("td", drive_name(run, record), style="white-space: nowrap"),
            [el("td", _number(metrics.get(key), digits), class_="num") for key, _, digits in _OF_DRIVES],
        )
        for record, metrics in drives
    ]
    return join(
        el("h2", "Beside the score"),
        el("p", "Bench2Drive's: ", facts, class_="facts small"),
        el("div", el("table", el("thead", head), el("tbody", rows)), class_="card wide"),
        el("p", "Critical: somebody would be touched within 1.5 s if all kept their velocity.", class_="soft small"),
    )


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
