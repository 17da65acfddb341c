"""Who and what lies where along the path: actors in the path's own coordinates, and the lanes beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.behavior.path import STEP, ReferencePath
from lavsim.kernel import kernel
from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

BEHIND, AHEAD = 90.0, 200.0  # [m] of path that is looked at
ASIDE = 12.0  # [m] off the path: farther off nobody counts
SAME_LEVEL = 3.0  # [m]


class Neighbours(NamedTuple):
    """Actors near the path, N of them, the ego left out.

    Attributes:
        row: (N,) in the reading.
        rear, front: (N,) their extent along the path [m].
        left, right: (N,) across it, to the right [m].
        speed: (N,) along the path [m/s]; negative who comes against it.
    """

    row: NDArray[np.int64]
    rear: Floats
    front: Floats
    left: Floats
    right: Floats
    speed: Floats


def neighbours(path: ReferencePath, s: float, truth: Mapping[str, Any]) -> Neighbours:
    """Who is near the path around place `s` [m]."""
    low = max(int((s - BEHIND) / STEP), 0)
    high = min(int((s + AHEAD) / STEP) + 1, len(path))
    found = _neighbours(path.xy, path.yaw, low, high, truth["xyz"], truth["yaw"], truth["velocities"], truth["sizes"])
    return Neighbours(*found)


@kernel
def _neighbours(
    path: Floats,
    course: Floats,
    low: int,
    high: int,
    xyz: Floats,
    yaw: Floats,
    velocities: Floats,
    sizes: NDArray[np.float32],
) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats, Floats]:
    count = len(xyz)
    row = np.empty(count, np.int64)
    rear, front, left, right, speed = np.empty((5, count))
    n = 0
    for k in range(1, count):
        if abs(xyz[k, 2] - xyz[0, 2]) >= SAME_LEVEL:
            continue
        nearest, best = -1, ASIDE * ASIDE
        i = low
        while i < high:
            distance = (path[i, 0] - xyz[k, 0]) ** 2 + (path[i, 1] - xyz[k, 1]) ** 2
            if distance < best:
                nearest, best = i, distance
            apart = math.sqrt(distance) - math.sqrt(best)
            i += max(1, int(apart / 0.6))  # samples are at most 0.6 m apart
        if nearest < 0:
            continue
        cos, sin = math.cos(course[nearest]), math.sin(course[nearest])
        dx, dy = xyz[k, 0] - path[nearest, 0], xyz[k, 1] - path[nearest, 1]
        along, aside = dx * cos + dy * sin, dy * cos - dx * sin
        turned = yaw[k] - course[nearest]
        c, s = abs(math.cos(turned)), abs(math.sin(turned))
        length = 0.5 * (sizes[k, 0] * c + sizes[k, 1] * s)
        width = 0.5 * (sizes[k, 0] * s + sizes[k, 1] * c)
        row[n] = k
        rear[n], front[n] = nearest * STEP + along - length, nearest * STEP + along + length
        left[n], right[n] = aside - width, aside + width
        speed[n] = velocities[k, 0] * cos + velocities[k, 1] * sin
        n += 1
    return row[:n], rear[:n], front[:n], left[:n], right[:n], speed[:n]


WITHIN, BESIDE, AGAINST = "within", "beside", "against"
_EDGE = 0.4  # [m] of the vehicle that may hang over the outermost lane
_SAMPLES = 2.0  # [m]


def ground(
    path: ReferencePath, town: TownMap, begin: float, end: float, offset: float, half_width: float
) -> str | None:
    """What lies under a stretch of road `offset` metres to the right of the path.

    Returns:
        WITHIN the path's lane, BESIDE it (a lane of the same direction), AGAINST (one of the other direction), or None
        where not all of it is driving lane.
    """
    s = np.arange(begin, end, _SAMPLES)
    index = np.clip(np.round(s / STEP).astype(np.int64), 0, len(path) - 1)
    outer = offset + math.copysign(half_width - _EDGE, offset)
    normal = np.stack([-np.sin(path.yaw[index]), np.cos(path.yaw[index])], axis=1)
    points = np.concatenate([path.xy[index] + d * normal for d in (offset, outer)])
    z = np.concatenate([path.z[index]] * 2)
    hits = town.nearest(np.column_stack([points, z]))
    if np.any(hits.lane < 0) or np.any(np.abs(hits.offset) > hits.width / 2.0 + 0.05):
        return None
    along = np.cos(hits.yaw - np.concatenate([path.yaw[index]] * 2))
    if np.any(along < 0.0):
        return AGAINST
    own = town.nearest(np.column_stack([path.xy[index], path.z[index]])).lane
    return WITHIN if np.array_equal(hits.lane[len(index) :], own) else BESIDE
