"""A drive as inline SVG: the map with route, track and infractions, and the speed over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import LineString

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT, LaneType, Tag
from leaderboard.report.markup import Markup, el, join

Floats = NDArray[np.float64]

MARGIN = 22.0  # [m] around what was driven
ASPECT = 1.3  # width to height of the map
TOLERANCE = 0.15  # [m] lines are thinned by
MAX_SPEED_POINTS = 600

_PAVED = (
    (LaneType.SIDEWALK | LaneType.SHOULDER | LaneType.BORDER, "var(--walk)"),
    (LaneType.PARKING | LaneType.BIKING | LaneType.MEDIAN, "var(--walk)"),
    (LaneType.DRIVING | LaneType.BIDIRECTIONAL | LaneType.ENTRY | LaneType.EXIT, "var(--road)"),
)


def map_drawing(town: TownMap, route: Route, track: Floats, infractions: Sequence[dict[str, Any]]) -> Markup:
    """The drive from above, x to the right and y down as in CARLA.

    Args:
        town: Roads and buildings.
        route: What was to be driven.
        track: (T, 2) where the ego was [m].
        infractions: The run file's entries; numbered in their order.
    """
    shown = np.concatenate([route.points[:, :2], track]) if len(track) else route.points[:, :2]
    low, high = _frame(shown)
    size = high - low
    unit = float(max(size)) / 100.0  # a hundredth of the longer side [m]
    layers = [_buildings(town, low, high), *_roads(town, low, high), _route(route, unit)]
    if len(track) > 1:
        layers.append(_line(track, stroke="var(--drive)", stroke_width=0.42 * unit))
    layers += [_flag(route.points[0, :2], unit, "start"), _flag(route.points[-1, :2], unit, "target")]
    layers += [_mark(number, entry, unit) for number, entry in enumerate(infractions, 1)]
    label = f"Map of the drive with {len(infractions)} infractions"
    box = " ".join(f"{v:.1f}" for v in (*low, *size))
    return el("svg", *layers, class_="map", viewBox=box, role="img", aria_label=label)


def speed_drawing(times: Floats, speeds: Floats, infractions: Sequence[dict[str, Any]], first_tick: int) -> Markup:
    """Speed [km/h] over the drive's time [s], with the infractions' moments."""
    width, height, left, bottom = 420.0, 130.0, 30.0, 20.0
    keep = np.linspace(0, len(times) - 1, min(len(times), MAX_SPEED_POINTS)).astype(int)
    top = max(float(speeds.max(initial=0.0)) * 3.6, 10.0) * 1.1
    span = max(float(times[-1]), 1.0)

    def place(time: float, speed: float) -> tuple[float, float]:
        return left + (width - left - 6.0) * time / span, (height - bottom) * (1.0 - speed / top)

    line = np.array([place(float(times[k]), float(speeds[k]) * 3.6) for k in keep])
    parts = []
    for value in _ticks(top):
        y = place(0.0, value)[1]
        parts.append(el("line", x1=left, x2=width, y1=y, y2=y, stroke="var(--edge)"))
        text = f"{value:g}"
        parts.append(el("text", text, x=left - 6, y=y + 4, fill="var(--soft)", font_size=11, text_anchor="end"))
    for number, entry in enumerate(infractions, 1):
        x = place(max((int(entry["tick"]) - first_tick) * DT, 0.0), 0.0)[0]
        stroke = el("line", x1=x, x2=x, y1=0, y2=height - bottom, stroke="var(--mark)", stroke_dasharray="3 3")
        parts.append(el("g", stroke, el("title", f"{number}: {entry['message']}")))
    parts.append(_line(line, stroke="var(--accent)", stroke_width=1.6))
    parts.append(el("text", "km/h", x=2, y=height - 5, fill="var(--soft)", font_size=11))
    end = f"{span:.0f} s"
    parts.append(el("text", end, x=width - 6, y=height - 5, fill="var(--soft)", font_size=11, text_anchor="end"))
    return el("svg", *parts, class_="speed", viewBox=f"0 0 {width:g} {height:g}", role="img", aria_label="Speed")


def _ticks(top: float) -> list[float]:
    step = next((s for s in (5.0, 10.0, 20.0, 25.0, 50.0) if top / s <= 5.0), 100.0)
    return [step * k for k in range(int(top / step) + 1)]


def _frame(points: Floats) -> tuple[Floats, Floats]:
    """Corners of the part to show: all of `points` with a margin, in the drawing's own proportions."""
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    width, height = high - low
    half = np.array([max(width, height * ASPECT), max(height, width / ASPECT)]) / 2.0
    middle = (low + high) / 2.0
    return middle - half, middle + half


def _roads(town: TownMap, low: Floats, high: Floats) -> list[Markup]:
    lanes = town.lanes
    layers = []
    for types, colour in _PAVED:
        lines = []
        for lane in np.flatnonzero((lanes.type & int(types)) != 0):
            rows = slice(int(lanes.first[lane]), int(lanes.first[lane + 1]))
            points, width = lanes.points[rows, :2], float(lanes.width[rows].mean())
            if len(points) > 1 and np.all(points.max(axis=0) > low) and np.all(points.min(axis=0) < high):
                lines.append(_line(points, stroke_width=width + 0.3))  # lanes overlap a little: no seams
        layers.append(el("g", *lines, stroke=colour, stroke_linecap="butt"))
    return layers


def _buildings(town: TownMap, low: Floats, high: Floats) -> Markup:
    prisms = town.scenery.prisms
    shapes = []
    for index in np.flatnonzero(prisms.tag == Tag.BUILDING):
        corners = prisms.vertices[index, : prisms.count[index]]
        if np.all(corners.max(axis=0) > low) and np.all(corners.min(axis=0) < high):
            shapes.append(el("polygon", points=_points(corners)))
    return el("g", *shapes, fill="var(--building)")


def _route(route: Route, unit: float) -> Markup:
    dash = f"{1.1 * unit:.2f} {0.8 * unit:.2f}"
    return _line(
        route.points[:, :2], stroke="var(--route)", stroke_width=1.1 * unit, stroke_opacity=0.55, stroke_dasharray=dash
    )


def _line(points: Floats, **attributes: str | float) -> Markup:
    thinned = np.asarray(LineString(points).simplify(TOLERANCE).coords) if len(points) > 2 else points
    return el("polyline", points=_points(thinned), fill="none", stroke_linejoin="round", **attributes)


def _points(points: Floats) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _flag(at: Floats, unit: float, name: str) -> Markup:
    x, y = (float(v) for v in at)
    colour = "var(--route)" if name == "start" else "var(--good)"
    ring = el("circle", cx=x, cy=y, r=1.3 * unit, fill="var(--card)", stroke=colour, stroke_width=0.55 * unit)
    return el("g", ring, el("title", name))


def _mark(number: int, entry: dict[str, Any], unit: float) -> Markup:
    x, y = (float(v) for v in entry["position"][:2])
    circle = el("circle", cx=x, cy=y, r=1.7 * unit, fill="var(--mark)", stroke="var(--card)", stroke_width=0.3 * unit)
    text = el(
        "text",
        str(number),
        x=x,
        y=y + 0.72 * unit,
        fill="var(--mark-text)",
        font_size=2.0 * unit,
        font_weight=600,
        text_anchor="middle",
    )
    return el("g", join(circle, text), el("title", f"{number}: {entry['message']}"))
