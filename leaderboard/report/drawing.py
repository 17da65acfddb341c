"""A drive as inline SVG: the map with route, track and infractions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import LineString

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType, Tag
from leaderboard.report.markup import Markup, el, join

Floats = NDArray[np.float64]

MARGIN = 22.0  # [m] around what was driven
ASPECT = 1.3  # width to height of the map
TOLERANCE = 0.15  # [m] lines are thinned by

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
