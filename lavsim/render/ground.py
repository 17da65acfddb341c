"""What lies on the ground, as a raster of classes drawn once a town from its lanes and paint.

A cell is 0.1 m and one byte: Town01 with its margin is 17 MB, a square kilometre 100 MB. The raster is kept in the
cache folder and mapped into memory, so worker processes share it and only cells that are looked at are loaded.

Paint is finer: the low half of a byte is the `Surface`, and each bit of the high half says that a quarter of the cell
(0.05 m) is bare road. So marks that run askew have no teeth, and a byte below 16 is a plain `Surface`.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lavsim.cache import cache_dir, replace_atomically
from lavsim.kernel import kernel, lean_kernel
from lavsim.types import LaneType, Tag

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

VERSION = 7  # of what is drawn; raise it whenever another raster comes out
RESOLUTION = 0.1  # [m] a cell
_FINE = RESOLUTION / 2.0  # [m] what is drawn, before four become one
MARGIN = 20.0  # [m] of terrain around the lanes
DASH, GAP = 3.0, 6.0  # [m] of broken marks
STRIPE = 0.5  # [m] width of a zebra stripe and of the gap to the next
THINNEST = 0.15  # [m] paint is at least so wide: narrower lines would break up in the cells
STOP_LINE = 0.4  # [m] width of a stop line


class Surface(IntEnum):
    """What a cell of ground is."""

    TERRAIN = 0
    ROAD = 1
    SIDEWALK = 2
    SHOULDER = 3
    PARKING = 4
    MEDIAN = 5
    CROSSWALK_GAP = 6
    CROSSWALK = 7
    STOP_LINE = 8
    WHITE_SOLID = 9
    WHITE_BROKEN = 10
    YELLOW_SOLID = 11
    YELLOW_BROKEN = 12
    CURB = 13


TAG_OF_SURFACE: NDArray[np.uint8] = np.full(len(Surface), Tag.ROAD_LINE, np.uint8)
for _surface, _tag in (
    (Surface.TERRAIN, Tag.TERRAIN),
    (Surface.ROAD, Tag.ROAD),
    (Surface.SIDEWALK, Tag.SIDEWALK),
    (Surface.SHOULDER, Tag.ROAD),
    (Surface.PARKING, Tag.ROAD),
    (Surface.MEDIAN, Tag.TERRAIN),
    (Surface.CROSSWALK_GAP, Tag.ROAD),
    (Surface.CURB, Tag.SIDEWALK),
):
    TAG_OF_SURFACE[_surface] = _tag

# Lane types in the order they are drawn: what comes later covers what came before.
_SURFACE_OF_TYPE = (
    (LaneType.MEDIAN | LaneType.BORDER | LaneType.NONE, Surface.MEDIAN),
    (LaneType.SIDEWALK, Surface.SIDEWALK),
    (LaneType.SHOULDER | LaneType.RESTRICTED, Surface.SHOULDER),
    (LaneType.PARKING, Surface.PARKING),
    (LaneType.DRIVING | LaneType.BIDIRECTIONAL | LaneType.STOP | LaneType.BIKING | LaneType.ENTRY | LaneType.EXIT
     | LaneType.OFF_RAMP | LaneType.ON_RAMP | LaneType.TRAM | LaneType.RAIL | LaneType.ROADWORKS, Surface.ROAD),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class GroundRaster:
    """Classes of the ground.

    Attributes:
        classes: (H, W) uint8, read-only; row i spans y = origin[1] + i * resolution onwards, columns x. `classes & 15`
            is the `Surface` of a cell; the high bits name its bare quarters (1 right half, 2 lower half of bit number).
        origin: (2,) x, y of the corner of cell (0, 0) [m].
        resolution: Side of a cell [m].
    """

    classes: NDArray[np.uint8]
    origin: Floats
    resolution: float = RESOLUTION

    def __post_init__(self) -> None:
        self.classes.flags.writeable = False

    @staticmethod
    def blank(bounds: tuple[float, float, float, float], surface: Surface = Surface.TERRAIN) -> GroundRaster:
        """One surface everywhere in x0, y0, x1, y1 [m]."""
        x0, y0, x1, y1 = bounds
        shape = (round((y1 - y0) / RESOLUTION), round((x1 - x0) / RESOLUTION))
        return GroundRaster(np.full(shape, surface, np.uint8), np.array([x0, y0]))

    def at(self, points: Floats) -> NDArray[np.uint8]:
        """(N,) `Surface` under world `points` (N, 2); terrain outside the raster."""
        cells = (points - self.origin) / self.resolution
        return np.array([surface_at(self.classes, x, y) for x, y in cells], np.uint8)


_PLAIN_CODES, _ROAD = 16, int(Surface.ROAD)
_FIRST_PAINT, _LAST_PAINT = int(Surface.CROSSWALK), int(Surface.YELLOW_BROKEN)


@lean_kernel
def surface_at(classes, x, y):  # type: ignore[no-untyped-def]
    """`Surface` at a place in cells (x along columns); terrain outside the raster."""
    column, row = int(np.floor(x)), int(np.floor(y))
    if column < 0 or row < 0 or column >= classes.shape[1] or row >= classes.shape[0]:
        return np.uint8(0)
    cell = classes[row, column]
    if cell < _PLAIN_CODES:
        return cell
    quarter = (1 if x - column >= 0.5 else 0) + (2 if y - row >= 0.5 else 0)
    return np.uint8(_ROAD) if (cell >> (4 + quarter)) & 1 else np.uint8(cell & 15)


@kernel
def _merge_quarters(fine, classes):  # type: ignore[no-untyped-def]
    """Cells of four quarters each: paint with its bare quarters, otherwise the commonest surface."""
    quarters = np.empty(4, np.uint8)
    for row in range(classes.shape[0]):
        for column in range(classes.shape[1]):
            paint, common, most = 0, 0, 0
            for q in range(4):
                quarters[q] = fine[2 * row + (q >> 1), 2 * column + (q & 1)]
                if _FIRST_PAINT <= quarters[q] <= _LAST_PAINT:
                    paint = max(paint, int(quarters[q]))
            for q in range(4):
                count = np.sum(quarters == quarters[q])
                if count > most:
                    common, most = int(quarters[q]), count
            if paint > 0:
                common = paint
                for q in range(4):
                    common |= (16 << q) if quarters[q] != paint else 0
            classes[row, column] = common


@dataclass(frozen=True)
class Level:
    """Which part of a town a raster shows, where roads pass over each other.

    Attributes:
        name: Of the raster's file.
        bounds: x0, y0, x1, y1 [m], whole metres.
        lanes: (P,) bool, the centre points of lanes that belong to it.
        owns: Tells of points (N, 2) with heights (N,), NaN where the map gives none, which belong to it.
    """

    name: str
    bounds: Floats
    lanes: NDArray[np.bool_]
    owns: Callable[[Floats, Floats], NDArray[np.bool_]]


def whole_bounds(town: TownMap) -> Floats:
    """x0, y0, x1, y1 of a town with its margin [m], whole metres."""
    bounds = np.round(town.bounds, 2)  # errors of rounding must not move it by a metre
    return np.concatenate([np.floor(bounds[:2] - MARGIN), np.ceil(bounds[2:] + MARGIN)])


def cached_array(name: str, town: TownMap, version: int, bounds: Floats) -> Path:
    """File in the cache folder for an array over `bounds`, which its name holds, since the array does not."""
    place = "_".join(f"{value:.0f}" for value in bounds)
    return cache_dir() / f"{name}-{town.digest}-{version}-{place}.npy"


def whole_town(town: TownMap) -> Level:
    """All of a town without bridges."""
    return Level(
        "ground",
        whole_bounds(town),
        np.ones(len(town.lanes.points), np.bool_),
        lambda points, heights: np.ones(len(points), np.bool_),
    )


def ground_raster(town: TownMap, level: Level | None = None) -> GroundRaster:
    """The raster of `town` (of one level of it), from the cache folder when it was drawn before."""
    level = whole_town(town) if level is None else level
    path = cached_array(level.name, town, VERSION, level.bounds)
    if not path.exists():
        buffer = io.BytesIO()
        np.save(buffer, draw_ground(town, level))
        replace_atomically(path, buffer.getvalue())
    return GroundRaster(_mapped(path), level.bounds[:2].copy())


def _mapped(path: Path) -> NDArray[np.uint8]:
    classes: NDArray[np.uint8] = np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
    return classes


def draw_ground(town: TownMap, level: Level) -> NDArray[np.uint8]:
    """(H, W) classes, drawn from the map."""
    low = level.bounds[:2]
    columns, rows = np.rint((level.bounds[2:] - low) / RESOLUTION).astype(int)
    classes = np.zeros((2 * rows, 2 * columns), np.uint8)
    _draw_lanes(classes, low, town, level)
    for polygon in town.crosswalks:
        if level.owns(np.asarray(polygon)[:, :2], np.full(len(polygon), np.nan)).all():
            _draw_crosswalk(classes, low, np.asarray(polygon, np.float64))
    for mark in town.marks:
        surface = _surface_of_mark(mark.colour, mark.kind)
        if surface is not None:
            broken = surface in (Surface.WHITE_BROKEN, Surface.YELLOW_BROKEN)
            points = np.asarray(mark.points, np.float64)[:, :2]
            mine = level.owns(points, np.full(len(points), np.nan) if mark.z is None else mark.z)
            for rows_of in _runs(mine):
                line = np.ascontiguousarray(points[rows_of])
                _fill_line(classes, low, line, max(float(mark.width), THINNEST), broken, int(surface))
    if not any(mark.kind == "stop" for mark in town.marks):
        for stop in (stop for light in town.lights for stop in light.stop_lines):
            x, y, z, yaw, _ = town.centre([stop.lane], [stop.paint_u])[0]
            if level.owns(np.array([[x, y]]), np.array([z]))[0]:
                fill_polygon(classes, (_across(x, y, yaw, stop.width) - low) / _FINE, int(Surface.STOP_LINE))
    merged = np.empty((rows, columns), np.uint8)
    _merge_quarters(classes, merged)
    return merged


def _runs(mask: NDArray[np.bool_]) -> Iterable[slice]:
    """Stretches of True, at least two long, each with the point that follows it, so that neighbours meet."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    for begin, end in edges.reshape(-1, 2).tolist():
        if min(end + 1, len(mask)) - begin > 1:
            yield slice(begin, min(end + 1, len(mask)))


def _draw_lanes(classes: NDArray[np.uint8], low: Floats, town: TownMap, level: Level) -> None:
    lanes = town.lanes
    for types, surface in _SURFACE_OF_TYPE:
        for lane in np.flatnonzero(lanes.type & int(types)):
            first, last = int(lanes.first[lane]), int(lanes.first[lane + 1])
            for run in _runs(level.lanes[first:last]):
                rows = slice(first + run.start, first + run.stop)
                points = np.ascontiguousarray(lanes.points[rows][:, [0, 1, 3]])
                _fill_strip(classes, low, points, lanes.width[rows] / 2.0 + 0.02, int(surface))


def _surface_of_mark(colour: str, kind: str) -> Surface | None:
    if kind in ("none", "grass"):
        return None
    if kind in ("curb", "stop"):
        return Surface.CURB if kind == "curb" else Surface.STOP_LINE
    broken = kind in ("broken", "broken broken", "botts dots")
    if colour == "yellow":
        return Surface.YELLOW_BROKEN if broken else Surface.YELLOW_SOLID
    return Surface.WHITE_BROKEN if broken else Surface.WHITE_SOLID


def _across(x: float, y: float, yaw: float, width: float) -> Floats:
    """Corners of a stop line at x, y across a lane of heading `yaw`; it ends at the point, never past it."""
    ahead, aside = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    half = aside * (width / 2.0 - 0.15)
    front, back = np.array([x, y]), np.array([x, y]) - STOP_LINE * ahead
    return np.stack([front - half, front + half, back + half, back - half])


def _draw_crosswalk(classes: NDArray[np.uint8], low: Floats, polygon: Floats) -> None:
    """Stripes along the traffic: side by side along the crossing's longer axis, which walkers follow."""
    if len(polygon) > 1 and np.allclose(polygon[0], polygon[-1]):
        polygon = polygon[:-1]
    centre = polygon.mean(axis=0)
    axis = _long_axis(polygon)
    across = np.array([-axis[1], axis[0]])
    along, aside = (polygon - centre) @ axis, (polygon - centre) @ across
    fill_polygon(classes, (polygon - low) / _FINE, int(Surface.CROSSWALK_GAP))
    for begin in _stripes(float(along.min()), float(along.max())):
        corners = [(begin, aside.min()), (begin + STRIPE, aside.min()), (begin + STRIPE, aside.max()),
                   (begin, aside.max())]  # fmt: skip
        quad = np.array([centre + a * axis + b * across for a, b in corners])
        fill_polygon(classes, (quad - low) / _FINE, int(Surface.CROSSWALK))


def _long_axis(polygon: Floats) -> Floats:
    edges = np.roll(polygon, -1, axis=0) - polygon
    longest: Floats = edges[np.argmax(np.hypot(edges[:, 0], edges[:, 1]))]
    return longest / np.hypot(*longest)


def _stripes(begin: float, end: float) -> Iterable[float]:
    count = int((end - begin + STRIPE) // (2.0 * STRIPE))
    first = (begin + end) / 2.0 - (2 * count - 1) * STRIPE / 2.0
    return (first + 2.0 * STRIPE * k for k in range(count))


@kernel
def fill_polygon(classes, corners, value):  # type: ignore[no-untyped-def]
    """Sets the cells whose centres lie in a convex polygon; corners (n, 2) in cells, x then y."""
    n = len(corners)
    top, bottom = corners[:, 1].min(), corners[:, 1].max()
    first, last = max(0, int(np.ceil(top - 0.5))), min(classes.shape[0], int(np.ceil(bottom - 0.5)))
    for row in range(first, last):
        left, right = np.inf, -np.inf
        y = row + 0.5
        for e in range(n):
            x0, y0, x1, y1 = corners[e, 0], corners[e, 1], corners[(e + 1) % n, 0], corners[(e + 1) % n, 1]
            if y0 > y1:
                x0, y0, x1, y1 = x1, y1, x0, y0
            if y0 <= y < y1:
                x = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
                left, right = min(left, x), max(right, x)
        begin, end = max(0, int(np.ceil(left - 0.5))), min(classes.shape[1], int(np.ceil(right - 0.5)))
        for column in range(begin, end):
            classes[row, column] = value


@kernel
def _fill_strip(classes, low, points, half, value):  # type: ignore[no-untyped-def]
    """Sets the cells under a strip about points (n, 3: x, y, yaw) with half widths (n,)."""
    quad = np.empty((4, 2))
    for i in range(len(points) - 1):
        for corner in range(4):
            at = i if corner in (0, 3) else i + 1
            side = half[at] if corner < 2 else -half[at]
            quad[corner, 0] = (points[at, 0] - side * np.sin(points[at, 2]) - low[0]) / _FINE
            quad[corner, 1] = (points[at, 1] + side * np.cos(points[at, 2]) - low[1]) / _FINE
        fill_polygon(classes, quad, value)


@kernel
def _fill_line(classes, low, points, width, broken, value):  # type: ignore[no-untyped-def]
    """Paints a line along points (n, 2), dashed if `broken`."""
    quad = np.empty((4, 2))
    period = DASH + GAP
    driven = 0.0
    for i in range(len(points) - 1):
        dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        length = np.sqrt(dx * dx + dy * dy)
        if length < 1e-9:
            continue
        done = 0.0
        while done < length:
            phase = (driven + done) % period if broken else 0.0
            left = (DASH - phase if phase < DASH else period - phase) if broken else length
            piece = min(max(left, 1e-6), length - done)
            if phase < DASH:
                for corner in range(4):
                    at = done if corner in (0, 3) else done + piece
                    side = width / 2.0 if corner < 2 else -width / 2.0
                    quad[corner, 0] = (points[i, 0] + (at * dx - side * dy) / length - low[0]) / _FINE
                    quad[corner, 1] = (points[i, 1] + (at * dy + side * dx) / length - low[1]) / _FINE
                fill_polygon(classes, quad, value)
            done += piece
        driven += length
