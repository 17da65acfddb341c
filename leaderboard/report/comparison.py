"""comparison.html: several runs of one benchmark beside the first of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lavsim.errors import OutputError
from leaderboard.record import write_text
from leaderboard.report.compare import CONFIDENCE, METRICS, POWER, RESAMPLES, Comparison, Difference, compare
from leaderboard.report.markup import Markup, el
from leaderboard.report.page import document
from leaderboard.run import COMPARISON, Run

_SIZE = 300.0  # of the scatter drawing


def check_comparable(runs: Sequence[Run]) -> None:
    """Refuses runs of different benchmarks.

    Raises:
        OutputError: their ids differ.
    """
    first = runs[0].run.get("benchmark_id")
    for run in runs[1:]:
        own = run.run.get("benchmark_id")
        if own != first:
            raise OutputError(
                f"{run.folder} was driven under benchmark {own}, {runs[0].folder} under {first}: "
                "towns, routes, traffic or rules differ, so their scores can't be compared."
            )


def write_comparison(runs: Sequence[Run], path: Path | None = None) -> Path:
    """Writes the comparison of `runs` with the first of them, into its folder by default; the path."""
    path = path if path is not None else runs[0].folder / COMPARISON
    write_text(path, comparison_page(runs))
    return path


def comparison_page(runs: Sequence[Run]) -> str:
    """The whole document."""
    names = _names(runs)
    pairs = list(zip(names, runs, strict=True))
    sections = [_section(names[0], name, compare(runs[0], run)) for name, run in pairs[1:]]
    note = (
        f"Drives are paired by town, route, repetition and seed. Intervals hold {CONFIDENCE:.0%} of the means of "
        f"{RESAMPLES:,} resamples of the routes. The smallest difference is what so many routes would show with a "
        f"chance of {POWER:.0%}."
    )
    privileged = [name for name, run in pairs if run.run.get("track") == "PRIVILEGED"]
    warning = el("div", f"Reads privileged sensors: {', '.join(privileged)}.", class_="note") if privileged else None
    subtitle = f"rules {runs[0].run.get('rules', '?')} · benchmark {runs[0].run.get('benchmark_id', '?')}"
    head = el("p", subtitle, class_="soft")
    table = el("div", el("table", [_who(name, run) for name, run in pairs]), class_="card wide")
    return document(f"Runs beside {names[0]}", head, warning, table, sections, el("p", note, class_="soft note-below"))


def _who(name: str, run: Run) -> Markup:
    """A row that says what a run is."""
    config = run.run.get("config", {})
    told = [str(config.get("agent", "?")), str(config.get("agent_config") or ""), f"seed {run.run.get('seed', '?')}"]
    return el("tr", el("td", el("b", name)), [el("td", text) for text in told])


def _names(runs: Sequence[Run]) -> list[str]:
    """The runs' folders, by their last part where that tells them apart."""
    short = [run.folder.name for run in runs]
    return short if len(set(short)) == len(short) else [str(run.folder) for run in runs]


def _section(base: str, other: str, found: Comparison) -> Markup:
    head = el("tr", el("th", "metric"), [el("th", name, class_="num") for name in (
        base, other, "difference", "interval", "smallest shown", "better / worse")])  # fmt: skip
    names = dict(METRICS)
    rows = [_row(names[difference.metric], difference) for difference in found.differences]
    counts = f"{found.pairs} pairs on {found.routes} routes"
    counts += f", {found.unpaired} drives without a partner" if found.unpaired else ""
    drawn = el("figure", _scatter(found), el("figcaption", f"Driving scores of each pair: across {base}, up {other}."))
    return el(
        "section",
        el("h2", f"{other} against {base}"),
        el("p", _verdict(found.differences[0], other)),
        el("div", el("table", el("thead", head), el("tbody", rows)), class_="card wide"),
        el("p", counts, class_="soft small", style="margin-top: 8px"),
        el("div", drawn, class_="card drive scatter"),
    )


def _row(name: str, found: Difference) -> Markup:
    digits = 3 if found.metric == "score_penalty" else 1
    smallest = f"{found.smallest:.{digits}f}" if found.smallest < 1e9 else "-"
    cells = (
        f"{found.base:.{digits}f}",
        f"{found.other:.{digits}f}",
        f"{found.mean:+.{digits}f}",
        f"{found.low:+.{digits}f} to {found.high:+.{digits}f}",
        smallest,
        f"{found.wins} / {found.losses}",
    )
    return el("tr", el("td", name), [el("td", cell, class_="num") for cell in cells])


def _verdict(found: Difference, other: str) -> str:
    if found.low != found.low:  # no pair
        return "No drive of one has a partner in the other."
    if found.low > 0.0 or found.high < 0.0:
        better = "higher" if found.mean > 0.0 else "lower"
        return f"{other} scores {better}: {found.mean:+.1f} points ({found.low:+.1f} to {found.high:+.1f})."
    told = f"; these pairs would show {found.smallest:.1f} points or more" if found.smallest < 1e9 else ""
    return f"No difference in driving score is shown{told}."


def _scatter(found: Comparison) -> Markup:
    def place(value: float) -> float:
        return 24.0 + (_SIZE - 34.0) * value / 100.0

    parts = [el("line", x1=place(0), y1=_SIZE - place(0), x2=place(100), y2=_SIZE - place(100), stroke="var(--edge)")]
    for value in (0.0, 50.0, 100.0):
        text = f"{value:.0f}"
        for x, y, anchor in ((place(value), _SIZE - 8.0, "middle"), (20.0, _SIZE - place(value) + 4.0, "end")):
            parts.append(el("text", text, x=x, y=y, fill="var(--soft)", font_size=10, text_anchor=anchor))
    for name, (base, other) in zip(found.names, found.scores.tolist(), strict=True):
        dot = el("circle", cx=place(base), cy=_SIZE - place(other), r=4, fill="var(--accent)", fill_opacity=0.6)
        parts.append(el("g", dot, el("title", f"{name}: {base:.1f} and {other:.1f}")))
    return el("svg", *parts, viewBox=f"0 0 {_SIZE:g} {_SIZE:g}", role="img", aria_label="Scores of the pairs")
