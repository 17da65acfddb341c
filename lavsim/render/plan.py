"""The map from above as a raster of bits: what BEV images show of a town, drawn once and kept in the cache folder."""

from __future__ import annotations

import io
from dataclasses import dataclass
from enum import IntFlag
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lavsim.cache import cache_dir, replace_atomically
from lavsim.geometry import right
from lavsim.kernel import kernel
from lavsim.render.ground import MARGIN, fill_polygon
from lavsim.types import LaneType

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

VERSION = 1  # of what is drawn; raise it whenever another raster comes out
RESOLUTION = 0.125  # [m] a cell: half a pixel of LAV's images
LINE_WIDTH = 0.5  # [m] of marks and stop lines: two pixels of LAV's images
_ROAD_TYPES = int(LaneType.DRIVING | LaneType.BIDIRECTIONAL)
_LIMIT_SHIFT, _MOST_LIMITS = 5, 7


class PlanBit(IntFlag):
    """What a cell holds; the bits above are the number of the road's speed limit, 0 where there is none."""

    ROAD = 1  # driving lanes, without shoulders, parking lanes and sidewalks
    SOLID = 2  # marks; broken ones are drawn through, and none inside junctions
    BROKEN = 4
    STOP = 8  # stop lines of stop signs
    CROSSWALK = 16


@dataclass(frozen=True, eq=False)
class Plan:
    """The raster.

    Attributes:
        cells: (H, W) uint8 of `PlanBit`; row i spans y = origin[1] + i * RESOLUTION onwards, columns x.
        origin: (2,) corner of cell (0, 0) [m].
        limits: (8,) uint8 speed limits by number [km/h], 0 none.
    """

    cells: NDArray[np.uint8]
    origin: Floats
    limits: NDArray[np.uint8]


def plan_of(town: TownMap) -> Plan:
    """The plan of `town`, from the cache folder when it was drawn before."""
    origin, limits = np.floor(np.asarray(town.bounds[:2]) - MARGIN), _limits(town)
    path = cache_dir() / f"plan-{town.digest}-{VERSION}.npy"
    if not path.exists():
        buffer = io.BytesIO()
        np.save(buffer, draw_plan(town))
        replace_atomically(path, buffer.getvalue())
    return Plan(np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)), origin, limits)


def _limits(town: TownMap) -> NDArray[np.uint8]:
    """Distinct speed limits of the driving lanes [km/h], ascending from number 1 on; the highest share the last."""
    driving = (town.lanes.type & _ROAD_TYPES) != 0
    distinct = np.unique(np.rint(town.lanes.speed_limit[driving] * 3.6).astype(np.uint8))[:_MOST_LIMITS]
    table = np.zeros(_MOST_LIMITS + 1, np.uint8)
    table[1 : 1 + len(distinct)] = distinct
    return table


def draw_plan(town: TownMap) -> NDArray[np.uint8]:
    """(H, W) cells, drawn from the map."""
    low = np.floor(np.asarray(town.bounds[:2]) - MARGIN)
    high = np.ceil(np.asarray(town.bounds[2:]) + MARGIN)
    columns, rows = np.rint((high - low) / RESOLUTION).astype(int)
    cells, layer = np.zeros((rows, columns), np.uint8), np.zeros((rows, columns), np.uint8)
    limits = _limits(town)
    lanes = town.lanes
    driving = np.flatnonzero(lanes.type & _ROAD_TYPES)
    for lane in driving[np.argsort(lanes.speed_limit[driving], kind="stable")].tolist():
        limit = int(np.searchsorted(limits[1:][limits[1:] > 0], np.uint8(round(lanes.speed_limit[lane] * 3.6)))) + 1
        _strip(cells, low, town, lane, PlanBit.ROAD | (min(limit, _MOST_LIMITS) << _LIMIT_SHIFT))
    for polygon in town.crosswalks:
        fill_polygon(layer, (np.asarray(polygon, np.float64)[:, :2] - low) / RESOLUTION, int(PlanBit.CROSSWALK))
    cells |= layer
    for bit in (PlanBit.SOLID, PlanBit.BROKEN):
        layer[:] = 0
        for mark in town.marks:
            if _bit_of_mark(mark.kind) == bit:
                _line(layer, low, np.ascontiguousarray(np.asarray(mark.points, np.float64)[:, :2]), int(bit))
        for lane in driving[lanes.junction[driving] >= 0].tolist():
            _strip(layer, low, town, lane, 0)
        cells |= layer
    layer[:] = 0
    for sign in town.signs:
        for stop in sign.stop_lines if sign.kind == "stop" else ():
            fill_polygon(layer, (stop_quad(stop.x, stop.y, stop.yaw, stop.width) - low) / RESOLUTION, int(PlanBit.STOP))
    cells |= layer
    return cells


def stop_quad(x: float, y: float, yaw: float, width: float) -> Floats:
    """(4, 2) corners of a stop line across a lane of heading `yaw`, `LINE_WIDTH` thick about x, y."""
    ahead, aside = np.array([np.cos(yaw), np.sin(yaw)]) * LINE_WIDTH / 2.0, right(yaw) * width / 2.0
    centre = np.array([x, y])
    return np.stack([centre + ahead - aside, centre + ahead + aside, centre - ahead + aside, centre - ahead - aside])


def _bit_of_mark(kind: str) -> PlanBit | None:
    if kind in ("none", "grass", "curb", "stop"):
        return None
    return PlanBit.BROKEN if kind in ("broken", "broken broken", "botts dots") else PlanBit.SOLID


def _strip(cells: NDArray[np.uint8], low: Floats, town: TownMap, lane: int, value: int) -> None:
    rows = slice(town.lanes.first[lane], town.lanes.first[lane + 1])
    points, half = town.lanes.points[rows], town.lanes.width[rows] / 2.0 + 0.02
    aside = np.stack([-np.sin(points[:, 3]), np.cos(points[:, 3])], axis=1) * half[:, None]
    _fill_strip(cells, (points[:, :2] - aside - low) / RESOLUTION, (points[:, :2] + aside - low) / RESOLUTION, value)


def _line(cells: NDArray[np.uint8], low: Floats, points: Floats, value: int) -> None:
    step = np.gradient(points, axis=0) if len(points) > 1 else np.zeros_like(points)
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)
    aside = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None] * (LINE_WIDTH / 2.0)
    _fill_strip(cells, (points - aside - low) / RESOLUTION, (points + aside - low) / RESOLUTION, value)


@kernel
def _fill_strip(cells, left, right_side, value):  # type: ignore[no-untyped-def]
    """Sets the cells between two lines of n points each, in cells."""
    quad = np.empty((4, 2))
    for i in range(len(left) - 1):
        quad[0], quad[1], quad[2], quad[3] = left[i], left[i + 1], right_side[i + 1], right_side[i]
        fill_polygon(cells, quad, value)


@kernel
def warp_plan(cells, origin_x, origin_y, x, y, yaw, per_metre, ego_column, ego_row, width, height):  # type: ignore[no-untyped-def]
    """(height, width) cells under the pixels' centres of an image with the ego's heading up, 0 outside."""
    c, s = np.cos(yaw), np.sin(yaw)
    step = 1.0 / (per_metre * RESOLUTION)  # cells a pixel
    out = np.zeros((height, width), np.uint8)
    rows, columns = cells.shape
    first_x, first_y = (x - origin_x) / RESOLUTION, (y - origin_y) / RESOLUTION
    for row in range(height):
        ahead = (ego_row - row - 0.5) * step
        begin = (0.5 - ego_column) * step
        for column in range(width):
            aside = begin + column * step
            i = int(np.floor(first_y + ahead * s + aside * c))
            j = int(np.floor(first_x + ahead * c - aside * s))
            if 0 <= i < rows and 0 <= j < columns:
                out[row, column] = cells[i, j]
    return out
