"""report.html: one file that shows a run, with no resource outside itself."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lavsim.errors import LavsimError
from lavsim.types import DT
from leaderboard.criteria.base import charges_of
from leaderboard.record import write_text
from leaderboard.recorded import RecordedDrive
from leaderboard.report.drawing import map_drawing, speed_drawing
from leaderboard.report.markup import Markup, el, join
from leaderboard.report.style import STYLE
from leaderboard.rules import get_rules
from leaderboard.run import REPORT, Run
from leaderboard.table import short_name

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_JPEG_QUALITY = 86  # of embedded pictures; the files beside are lossless


def write_report(run: Run) -> Path:
    """Writes the report of `run` into its folder and gives its path."""
    path = run.folder / REPORT
    write_text(path, page(run))
    return path


def page(run: Run) -> str:
    """The whole document."""
    config = run.run.get("config", {})
    title = f"{config.get('agent', 'agent')} on {config.get('routes', 'routes')}"
    head = el(
        "head",
        el("meta", charset="utf-8"),
        el("meta", name="viewport", content="width=device-width, initial-scale=1"),
        el("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        el("title", title),
        el("style", Markup(STYLE)),
    )
    body = el(
        "main",
        el("h1", title),
        el("p", _subtitle(run), class_="soft"),
        _notes(run),
        _tiles(run),
        el("h2", "Routes"),
        _routes(run),
        el("h2", "Infractions"),
        _infractions(run),
        el("h2", "Drives"),
        [_drive(run, record) for record in run.records],
        _footer(run),
    )
    return "<!doctype html>\n" + el("html", head, el("body", body), lang="en") + "\n"


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
        el("span", f"{_minutes(meta.get('duration_game', 0.0))} simulated", class_="soft small"),
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
                el("td", el("a", _name(run, record), href=f"#drive-{record['index']}")),
                el("td", drive.get("town", "")),
                el("td", _pill(record["status"])),
                el("td", f"{scores['score_route']:.1f} %", class_="num bar", style=share),
                el("td", f"{scores['score_penalty']:.3f}", class_="num"),
                el("td", el("b", f"{scores['score_composed']:.1f}"), class_="num"),
                el("td", ", ".join(counts) or "none", class_=None if counts else "soft"),
            )
        )
    return el("div", el("table", el("thead", head), el("tbody", rows)), class_="card wide")


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


def _drive(run: Run, record: dict[str, Any]) -> Markup:
    drive, scores, meta = run.drive(record["index"]), record["scores"], record["meta"]
    facts = [
        ("score", f"{scores['score_composed']:.2f}"),
        ("completion", f"{scores['score_route']:.2f} %"),
        ("penalty", f"{scores['score_penalty']:.4f}"),
        ("route", f"{drive.get('dense_length', meta['route_length']):.0f} m"),
        ("time", _minutes(meta["duration_game"])),
        ("seed", str(drive.get("seed", "?"))),
        ("traffic", str(drive.get("traffic", "?"))),
        ("speed of simulation", f"{drive.get('real_time_factor', 0.0):.1f} x real time"),
    ]
    message = drive.get("agent_message")
    return el(
        "section",
        el("div", el("h3", _name(run, record)), el("span", drive.get("town", ""), class_="soft"),
           _pill(record["status"]), class_="head"),
        el("p", [el("span", el("span", f"{name} ", class_="soft"), value) for name, value in facts],
           class_="facts small"),
        el("p", "The agent ended it: ", el("span", message, class_="mono")) if message else None,
        _pictures(run, drive),
        class_="card drive",
        id=f"drive-{record['index']}",
    )  # fmt: skip


def _pictures(run: Run, drive: dict[str, Any]) -> Markup:
    infractions = drive.get("infractions", [])
    drawn, speed = _from_log(run, drive, infractions)
    events = [
        el(
            "li",
            el("span", str(number), class_="dot"),
            el(
                "div",
                el("p", el("b", short_name(entry["key"]).capitalize()), f" at {_moment(drive, entry)}"),
                el("p", entry["message"], class_="soft small"),
            ),
        )
        for number, entry in enumerate(infractions, 1)
    ]
    listed = el("ol", events, class_="events") if events else el("p", "No infractions.", class_="soft")
    return join(el("div", drawn, el("div", listed, speed), class_="pair"), _sheet(run, drive))


def _from_log(run: Run, drive: dict[str, Any], infractions: list[dict[str, Any]]) -> tuple[Markup, Markup | None]:
    """The map and the speed chart."""
    if not drive.get("log"):
        return el("p", "No recorded drive.", class_="soft"), None
    try:
        recorded = RecordedDrive.open(run.folder / drive["log"], _town_path(run))
        snapshots = [(s.tick, s.ego.x, s.ego.y, s.ego.speed) for s in recorded.log]
    except LavsimError as error:
        return el("p", f"The recorded drive can't be shown: {error}", class_="soft"), None
    driven = np.array(snapshots, np.float64).reshape(-1, 4)
    first = int(driven[0, 0]) if len(driven) else 0
    drawing = map_drawing(recorded.town, recorded.route, driven[:, 1:3], infractions)
    speed = speed_drawing((driven[:, 0] - first) * DT, driven[:, 3], infractions, first) if len(driven) else None
    caption = el("figcaption", "Dashed: the route. Solid: what was driven. Ringed: start (blue) and target (green).")
    return el("figure", drawing, caption), speed


def _sheet(run: Run, drive: dict[str, Any]) -> Markup | None:
    path = run.folder / str(drive.get("picture"))
    image = cv2.imread(str(path)) if drive.get("picture") and path.is_file() else None
    if image is None:
        return None
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    source = "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
    height, width = image.shape[:2]
    alt = "Contact sheet: bird's-eye view, cameras and LiDAR"
    return el("figure", el("img", src=source, alt=alt, width=width, height=height, loading="lazy"), class_="sheet")


def _footer(run: Run) -> Markup:
    shown = {"config": run.run.get("config", {}), "versions": run.run.get("versions", {})}
    text = json.dumps(shown, indent=2)
    return el("details", el("summary", "Configuration and versions"), el("pre", text, class_="mono"))


def _pill(status: str) -> Markup:
    return el("span", status, class_="pill good" if status in ("Completed", "Perfect") else "pill bad")


def _name(run: Run, record: dict[str, Any]) -> str:
    drive = run.drive(record["index"])
    name = f"Route {drive.get('route', record['route_id'])}"
    repeated = int(run.run.get("config", {}).get("repetitions", 1)) > 1
    return f"{name}, repetition {drive.get('repetition', 0)}" if repeated else name


def _moment(drive: dict[str, Any], entry: dict[str, Any]) -> str:
    return _minutes(int(entry["tick"]) * DT)


def _minutes(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 60.0 else f"{int(seconds // 60)}:{seconds % 60:04.1f} min"


def _town_path(run: Run) -> tuple[Path, ...]:
    return tuple(Path(p) for p in run.run.get("config", {}).get("town_path", ()))
