"""Kerb stones along the sidewalks: low, narrow, and what a LiDAR finds the road's edge by.

The sidewalk behind a stone lies level with the road, as lanes and walkers have it. Stones are left out where crosswalks
meet the sidewalk and where vehicles drive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.geometry import right
from lavsim.map.lane import DRIVABLE
from lavsim.render.solids import Material, Solids, slabs
from lavsim.types import LaneType, Tag

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

HEIGHT, WIDTH = 0.12, 0.15  # [m]
BURIED = 0.05  # [m] below the road, so that no beam slips under
SET_BACK = 0.03  # [m] from the road's edge
LONGEST = 12.0  # [m] of a stone
MOST_SAG = 0.05  # [m] its middle may lie off the arc of a bend
ALIGNED = 0.02  # [m] its ends' heights may differ from a straight line between them
STONE = (150, 148, 144)
_ROADSIDE = DRIVABLE | int(LaneType.SHOULDER | LaneType.BIKING | LaneType.STOP | LaneType.RESTRICTED)


def kerb_solids(quads: NDArray[np.float64]) -> Solids:
    """The stones of `kerb_quads`."""
    return slabs(quads, HEIGHT + BURIED, Tag.SIDEWALK, STONE, Material.PLAIN)


def kerb_quads(town: TownMap) -> NDArray[np.float64]:
    """(N, 4, 3) tops of the kerb stones of a town."""
    lanes = town.lanes
    index = {
        (int(r), int(s), int(k)): n
        for n, (r, s, k) in enumerate(zip(lanes.road_id, lanes.section, lanes.lane_id, strict=True))
    }
    stones = []
    for lane in np.flatnonzero(lanes.type == LaneType.SIDEWALK).tolist():
        number = int(lanes.lane_id[lane])
        inner = index.get((int(lanes.road_id[lane]), int(lanes.section[lane]), number - (1 if number > 0 else -1)))
        if inner is not None and lanes.type[inner] & _ROADSIDE:
            stones.append(lanes.rows(lane))
    if not stones:
        return np.zeros((0, 4, 3))
    rows = np.concatenate([np.arange(part.start, part.stop) for part in stones])
    aside = right(lanes.points[rows, 3])  # travel has the road to its left, on either side
    edge = lanes.points[rows, :2] - aside * (lanes.width[rows, None] / 2.0 - SET_BACK)
    free = _is_free(town, edge + aside * WIDTH / 2.0)
    quads: list[NDArray[np.float64]] = []
    begin = 0
    for part in stones:
        end = begin + part.stop - part.start
        quads += _stones(edge[begin:end], aside[begin:end], lanes.points[part, 2], lanes.points[part, 3],
                         free[begin:end])  # fmt: skip
        begin = end
    return np.array(quads).reshape(-1, 4, 3)


def _is_free(town: TownMap, places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether a stone may lie at each place."""
    driven = town.nearest(places, DRIVABLE)
    free: NDArray[np.bool_] = ~(driven.inside & (driven.distance < driven.width / 2.0 - SET_BACK))
    crossed = shapely.union_all([shapely.Polygon(polygon).buffer(0.3) for polygon in town.crosswalks])
    shapely.prepare(crossed)
    return free & ~shapely.contains_xy(crossed, places[:, 0], places[:, 1])


def _stones(
    edge: NDArray[np.float64],
    aside: NDArray[np.float64],
    z: NDArray[np.float64],
    yaw: NDArray[np.float64],
    free: NDArray[np.bool_],
) -> list[NDArray[np.float64]]:
    """Stones along one sidewalk, each as long as the sidewalk runs straight."""
    found = []
    first = 0
    while first < len(edge) - 1:
        last = first
        while last + 1 < len(edge) and free[first] and free[last + 1] and _is_straight(edge, z, yaw, first, last + 1):
            last += 1
        if last > first:
            ends = [first, last, last, first]
            corners = edge[ends] + aside[ends] * np.array([[0.0], [0.0], [WIDTH], [WIDTH]])
            found.append(np.column_stack([corners, z[ends] + HEIGHT]))
        first = max(last, first + 1)
    return found


def _is_straight(
    edge: NDArray[np.float64], z: NDArray[np.float64], yaw: NDArray[np.float64], first: int, last: int
) -> bool:
    length = float(np.hypot(*(edge[last] - edge[first])))
    if length > LONGEST or length * abs(yaw[last] - yaw[first]) / 8.0 > MOST_SAG:
        return False
    middle = (first + last) // 2
    line = z[first] + (z[last] - z[first]) * (middle - first) / (last - first)
    return bool(abs(z[middle] - line) < ALIGNED)
