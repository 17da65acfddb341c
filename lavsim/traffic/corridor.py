"""Where driving lanes are, as a raster: whoever stands clear of all of them is in nobody's way."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.map.town_map import TownMap
from lavsim.portable_math import cos_sin
from lavsim.traffic.obstacles import LOOKAHEAD_TIME, Boxes
from lavsim.types import LaneType

_PIXEL = 0.5  # [m]
_REACH = 1.8  # [m] half the widest vehicle and what it keeps free beside it
_LOOKS = 4  # places within `LOOKAHEAD_TIME` at which a moving box is looked for


class Corridor(NamedTuple):
    """Pixels within `_REACH` of the centre of a driving lane.

    Attributes:
        origin: (2,) lower corner [m].
        inside: (rows along y, columns along x).
    """

    origin: NDArray[np.float64]
    inside: NDArray[np.bool_]


@lru_cache(maxsize=4)
def corridor_of(town: TownMap) -> Corridor:
    """The corridor of a town's driving lanes."""
    lanes = town.lanes
    low = np.asarray(town.bounds[:2]) - 4.0
    columns, rows = (int(v) for v in np.ceil((np.asarray(town.bounds[2:]) + 4.0 - low) / _PIXEL))
    inside = np.zeros((rows, columns), np.bool_)
    owner = np.repeat(np.arange(len(lanes)), np.diff(lanes.first))
    _draw(inside, low, np.ascontiguousarray(lanes.points[lanes.type[owner] == LaneType.DRIVING, :2]))
    return Corridor(low, inside)


@kernel
def _draw(inside: NDArray[np.bool_], low: NDArray[np.float64], points: NDArray[np.float64]) -> None:
    reach = math.ceil(_REACH / _PIXEL)
    for k in range(len(points)):
        column, row = int((points[k, 0] - low[0]) / _PIXEL), int((points[k, 1] - low[1]) / _PIXEL)
        for j in range(-reach, reach + 1):
            for i in range(-reach, reach + 1):
                near = i * i + j * j <= (_REACH / _PIXEL) ** 2
                if near and 0 <= row + j < len(inside) and 0 <= column + i < inside.shape[1]:
                    inside[row + j, column + i] = True


@kernel
def _is_inside(corridor: Corridor, x: float, y: float) -> bool:
    column, row = int((x - corridor.origin[0]) / _PIXEL), int((y - corridor.origin[1]) / _PIXEL)
    if row < 0 or column < 0 or row >= corridor.inside.shape[0] or column >= corridor.inside.shape[1]:
        return False
    return bool(corridor.inside[row, column])


@kernel
def is_in_the_way(corridor: Corridor, boxes: Boxes, i: int) -> bool:
    """Whether box `i` reaches into the corridor where it is."""
    x, y, yaw = boxes.pose[i, 0], boxes.pose[i, 1], boxes.pose[i, 2]
    cos, sin = cos_sin(yaw)
    along, across = int(2.0 * boxes.half[i, 0] / _PIXEL) + 1, int(2.0 * boxes.half[i, 1] / _PIXEL) + 1
    for a in range(along + 1):
        for c in range(across + 1):
            forward = (2.0 * a / along - 1.0) * boxes.half[i, 0]
            right = (2.0 * c / across - 1.0) * boxes.half[i, 1]
            if _is_inside(corridor, x + forward * cos - right * sin, y + forward * sin + right * cos):
                return True
    return False


@kernel
def comes_in_the_way(corridor: Corridor, boxes: Boxes, i: int) -> bool:
    """Whether the centre of small box `i` (a walker) is in the corridor now or within `LOOKAHEAD_TIME`."""
    for k in range(_LOOKS + 1):
        time = k * LOOKAHEAD_TIME / _LOOKS
        if _is_inside(
            corridor, boxes.pose[i, 0] + boxes.velocity[i, 0] * time, boxes.pose[i, 1] + boxes.velocity[i, 1] * time
        ):
            return True
    return False
