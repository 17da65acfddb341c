"""Lines over time as inline SVG, with the infractions' moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.types import DT
from lavsim.viewer.inner import InnerView
from leaderboard.report.markup import Markup, el
from leaderboard.report.series import FARTHEST, Series

Floats = NDArray[np.float64]

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 420.0, 86.0, 36.0, 16.0, 16.0
MOST_SCALARS = 4  # numbers of the agent that get a chart
BINS = 260  # each drawn by its smallest and its largest value, so that no peak is lost


@dataclass(frozen=True)
class _Kind:
    name: str
    values: Floats
    low: float
    high: float


def charts(series: Series, infractions: Sequence[dict[str, Any]]) -> list[Markup]:
    """One chart for each line of `series`."""
    kinds = (
        _Kind("speed [km/h]", series.speed, 0.0, max(10.0, float(series.speed.max(initial=0.0)) * 1.08)),
        _Kind("steering", series.steer, -1.0, 1.0),
        _Kind("jerk [m/s³]", series.jerk, *_around(series.jerk, 5.0)),
        _Kind("distance to the nearest actor [m]", series.gap, 0.0, min(FARTHEST, 30.0)),
        _Kind("score", series.score, 0.0, 100.0),
    )
    return [_chart(kind, series.times, infractions) for kind in kinds]


def scalar_charts(inner: InnerView, infractions: Sequence[dict[str, Any]]) -> list[Markup]:
    """One chart for each of the first numbers that the agent published."""
    found: dict[str, list[tuple[float, float]]] = {}
    units: dict[str, str] = {}
    for tick, drawings in inner.frames:
        for name, drawing in drawings.items():
            if drawing["kind"] == "scalar":
                found.setdefault(name, []).append((tick * DT, float(drawing["value"])))
                units[name] = f" [{drawing['unit']}]" if drawing["unit"] else ""
    made = []
    for name, points in list(found.items())[:MOST_SCALARS]:
        times, values = np.array(points, np.float64).T
        low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
        made.append(_chart(_Kind(f"agent: {name}{units[name]}", values, low, max(high, low + 1.0)), times, infractions))
    return made


def _around(values: Floats, least: float) -> tuple[float, float]:
    largest = max(least, float(np.abs(values).max(initial=0.0)))
    return -largest, largest


def _chart(kind: _Kind, times: Floats, infractions: Sequence[dict[str, Any]]) -> Markup:
    begin, end = float(times[0]), max(float(times[-1]), float(times[0]) + 1.0)

    def place(time: float, value: float) -> tuple[float, float]:
        share = min(max((value - kind.low) / (kind.high - kind.low), 0.0), 1.0)
        x = LEFT + (WIDTH - LEFT - 4.0) * (time - begin) / (end - begin)
        return x, HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * share

    parts = [el("text", kind.name, x=LEFT, y=11, fill="var(--text)", font_size=11)]
    for value in (kind.low, (kind.low + kind.high) / 2.0, kind.high):
        y = place(begin, value)[1]
        parts.append(el("line", x1=LEFT, x2=WIDTH - 4, y1=y, y2=y, stroke="var(--edge)"))
        text = f"{value:.0f}" if kind.high - kind.low > 20.0 or value == round(value) else f"{value:.1f}"
        parts.append(el("text", text, x=LEFT - 5, y=y + 4, fill="var(--soft)", font_size=10, text_anchor="end"))
    for number, entry in enumerate(infractions, 1):
        x = place(min(max(int(entry["tick"]) * DT, begin), end), kind.low)[0]
        line = el("line", x1=x, x2=x, y1=TOP, y2=HEIGHT - BOTTOM, stroke="var(--mark)", stroke_dasharray="3 3")
        parts.append(el("g", line, el("title", f"{number}: {entry['message']}")))
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(t, v) for t, v in _thinned(times, kind.values)))
    parts.append(el("polyline", points=points, fill="none", stroke="var(--accent)", stroke_width=1.3))
    parts.append(el("text", f"{begin:.0f} s", x=LEFT, y=HEIGHT - 4, fill="var(--soft)", font_size=10))
    parts.append(el("text", f"{end:.0f} s", x=WIDTH - 4, y=HEIGHT - 4, fill="var(--soft)", font_size=10,
                    text_anchor="end"))  # fmt: skip
    box = f"0 0 {WIDTH:g} {HEIGHT:g}"
    return el("svg", *parts, class_="chart", viewBox=box, role="img", aria_label=kind.name)


def _thinned(times: Floats, values: Floats) -> list[tuple[float, float]]:
    """Smallest and largest value of each of `BINS` pieces, in their order."""
    if len(values) <= 2 * BINS:
        return list(zip(times.tolist(), values.tolist(), strict=True))
    kept: list[int] = [0]
    for piece in np.array_split(np.arange(len(values)), BINS):
        ends = {int(piece[np.argmin(values[piece])]), int(piece[np.argmax(values[piece])])}
        kept += sorted(ends)
    kept.append(len(values) - 1)
    return [(float(times[k]), float(values[k])) for k in kept]
