"""report.html: one file that shows a run, with no resource outside itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from lavsim.executor import Executor, SerialExecutor
from leaderboard.criteria.base import charges_of
from leaderboard.record import write_text
from leaderboard.report.beside import beside_the_score
from leaderboard.report.drive import PartTask, drive_name, duration, lost_part, part_of, pill
from leaderboard.report.hazards import Tallies, add_tallies, hazard_table
from leaderboard.report.markup import Child, Markup, el, join
from leaderboard.report.style import STYLE
from leaderboard.rules import get_rules
from leaderboard.run import REPORT, Run
from leaderboard.table import short_name

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def write_report(run: Run, with_replays: bool = True, executor: Executor | None = None) -> Path:
    """Writes the report of `run` and the replays of its drives into its folder, and gives the report's path."""
    path = run.folder / REPORT
    write_text(path, page(run, with_replays, executor))
    return path


def page(run: Run, with_replays: bool = False, executor: Executor | None = None) -> str:
    """The whole document.

    Args:
        run: The run.
        with_replays: Whether the replays of its drives are written, too.
        executor: What reads the drives; None: this process, one after the other.
    """
    config = run.run.get("config", {})
    title = f"{config.get('agent', 'agent')} on {config.get('routes', 'routes')}"
    tasks = [PartTask(index, run.of_one(record), with_replays) for index, record in enumerate(run.records)]
    done = sorted((executor or SerialExecutor()).run(part_of, tasks), key=lambda each: each.task.index)
    parts = [each.result or lost_part(each.task, each.lost or "") for each in done]
    tallies: Tallies = {}
    for part in parts:
        add_tallies(tallies, part.tallies)
    hazards = hazard_table(tallies)
    return document(
        title,
        el("p", _subtitle(run), class_="soft"),
        _notes(run),
        _tiles(run),
        el("h2", "Routes"),
        _routes(run),
        _repeated(run),
        el("h2", "Infractions"),
        _infractions(run),
        beside_the_score(run),
        join(el("h2", "Hazards"), hazards) if hazards is not None else None,
        el("h2", "Drives"),
        [part.section for part in parts],
        _footer(run),
    )


def document(title: str, *content: Child) -> str:
    """An HTML document in the report's style."""
    head = el(
        "head",
        el("meta", charset="utf-8"),
        el("meta", name="viewport", content="width=device-width, initial-scale=1"),
        el("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        el("title", title),
        el("style", Markup(STYLE)),
    )
    return "<!doctype html>\n" + el("html", head, el("body", el("main", el("h1", title), content)), lang="en") + "\n"


def _subtitle(run: Run) -> str:
    track = run.run.get("track")
    parts = [f"rules {run.run.get('rules', '?')}", f"seed {run.run.get('seed', '?')}"]
    parts += [f"track {track}"] if track else []
    parts += [f"benchmark {run.run.get('benchmark_id', '?')}", str(run.results.get("entry_status", ""))]
    return " · ".join(parts)


def _notes(run: Run) -> Markup | None:
    if run.run.get("track") != "PRIVILEGED":
        return None
    return el(
        "div", "This agent reads privileged sensors: its scores don't compare with sensor agents'.", class_="note"
    )


def _tiles(run: Run) -> Markup:
    mean, deviation = run.mean, run.total.get("scores_std_dev", {})

    def tile(name: str, key: str, digits: int, unit: str, kind: str = "tile") -> Markup:
        value = f"{mean[key]:.{digits}f}{unit}" if key in mean else "-"
        spread = deviation.get(key)
        below = f"± {spread:.{digits}f}" if isinstance(spread, int | float) else "one drive"
        return el("div", name, el("b", value), el("span", below, class_="soft small"), class_=kind)

    meta = run.total.get("meta", {})
    done = sum(r["status"] in ("Completed", "Perfect") for r in run.records)
    driven = el(
        "div",
        "Targets reached",
        el("b", f"{done} of {run.results['_checkpoint']['progress'][1]}"),
        el("span", f"{duration(meta.get('duration_game', 0.0))} simulated", class_="soft small"),
        class_="tile",
    )
    return el(
        "div",
        tile("Driving score", "score_composed", 1, "", "tile main"),
        tile("Route completion", "score_route", 1, " %"),
        tile("Infraction penalty", "score_penalty", 3, ""),
        driven,
        class_="tiles",
    )


def _routes(run: Run) -> Markup:
    names = ("route", "town", "status", "completion", "penalty", "score", "infractions")
    right = ("completion", "penalty", "score")
    head = el("tr", [el("th", name, class_="num" if name in right else None) for name in names])
    rows = []
    for record in run.records:
        drive, scores = run.drive(record["index"]), record["scores"]
        share = f"--share: {min(max(float(scores['score_route']), 0.0), 100.0):.1f}%"
        counts = [f"{len(v)} {short_name(k)}" for k, v in record["infractions"].items() if v]
        rows.append(
            el(
                "tr",
                el("td", el("a", drive_name(run, record), href=f"#drive-{record['index']}")),
                el("td", drive.get("town", "")),
                el("td", pill(record["status"])),
                el("td", f"{scores['score_route']:.1f} %", class_="num bar", style=share),
                el("td", f"{scores['score_penalty']:.3f}", class_="num"),
                el("td", el("b", f"{scores['score_composed']:.1f}"), class_="num"),
                el("td", ", ".join(counts) or "none", class_=None if counts else "soft"),
            )
        )
    return el("div", el("table", el("thead", head), el("tbody", rows)), class_="card wide")


def _repeated(run: Run) -> Markup | None:
    """Mean and deviation of each route over its repetitions; None where there are none."""
    scores: dict[str, list[float]] = {}
    for record in run.records:
        route = str(run.drive(record["index"]).get("route", record["route_id"]))
        scores.setdefault(route, []).append(float(record["scores"]["score_composed"]))
    if max(map(len, scores.values()), default=0) < 2:
        return None
    rows = [
        el(
            "tr",
            el("td", f"Route {route}"),
            el("td", str(len(found)), class_="num"),
            el("td", f"{np.mean(found):.1f}", class_="num"),
            el("td", f"{np.std(found, ddof=1):.1f}" if len(found) > 1 else "-", class_="num"),
            el("td", f"{min(found):.1f} to {max(found):.1f}", class_="num"),
        )
        for route, found in scores.items()
    ]
    names = ("drives", "mean score", "deviation", "range")
    head = el("tr", el("th", "route"), [el("th", name, class_="num") for name in names])
    return el("div", el("table", el("thead", head), el("tbody", rows)), class_="card wide", style="margin-top: 12px")


def _infractions(run: Run) -> Markup:
    charges = charges_of(get_rules(run.run.get("rules", "1.0")))
    rates = run.total.get("infractions", {})
    kilometres, plain = float(run.run.get("kilometres", 0.0)), run.run.get("infractions_per_km", {})
    rows = []
    for charge in sorted(charges.values(), key=lambda c: c.column):
        count = sum(len(r["infractions"].get(charge.key, [])) for r in run.records)
        rows.append(
            el(
                "tr",
                el("td", charge.label),
                el("td", str(count), class_="num"),
                el("td", f"{plain.get(charge.key, 0.0):.3f}", class_="num"),
                el("td", f"{rates.get(charge.key, 0.0):.3f}", class_="num"),
                class_=None if count else "soft",
            )
        )
    head = el(
        "tr", el("th", "kind"), [el("th", n, class_="num") for n in ("count", "per km driven", "leaderboard's rate")]
    )
    table = el("table", el("thead", head), el("tbody", rows))
    return join(
        el("div", table, class_="card wide"),
        el("p", f"{kilometres:.2f} km of route completed. The leaderboard's rate of rules 1.0 is a sum over routes, "
           "of 2.x one rate of the run with kilometres for off-road.", class_="soft small", style="margin-top: 8px"),
    )  # fmt: skip


def _footer(run: Run) -> Markup:
    shown = {"config": run.run.get("config", {}), "versions": run.run.get("versions", {})}
    text = json.dumps(shown, indent=2)
    return el("details", el("summary", "Configuration and versions"), el("pre", text, class_="mono"))
