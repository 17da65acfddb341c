"""What the town says about the path: speed limits and stop lines on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.behavior.path import STEP, ReferencePath
from lavsim.geometry import wrap_angle
from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

LINE_REACH = 1.8  # [m] a stop line whose middle is that near to the path is the path's own


@dataclass(frozen=True)
class StopPoint:
    """Where a red light or a stop sign holds the path.

    Attributes:
        s: End of the approach lane, which the rear must not cross at red [m along the path].
        light: The light that governs it; -1 at a stop sign.
        before: How far before it the stop line is painted, a crosswalk in between [m].
    """

    s: float
    light: int
    before: float = 0.0


def limits_along(path: ReferencePath, town: TownMap) -> Floats:
    """Speed limit (S,) [m/s] of the lanes under the path."""
    lanes = town.nearest(path.xy).lane
    return town.lanes.speed_limit[np.maximum(lanes, 0)]


def stop_points(path: ReferencePath, town: TownMap) -> list[StopPoint]:
    """Stop lines that the path crosses, in order; one that is passed twice is there twice."""
    lines = [(line, light.index) for light in town.lights for line in light.stop_lines]
    lines += [(line, -1) for sign in town.signs if sign.kind == "stop" for line in sign.stop_lines]
    found: list[StopPoint] = []
    for line, light in lines:
        distance = np.hypot(path.xy[:, 0] - line.x, path.xy[:, 1] - line.y)
        aligned = np.abs(wrap_angle(path.yaw - line.yaw)) < 0.8
        near = np.flatnonzero((distance < LINE_REACH) & aligned)
        for visit in np.split(near, np.flatnonzero(np.diff(near) > 10) + 1):
            if len(visit):
                nearest = int(visit[np.argmin(distance[visit])])
                dx, dy = line.x - path.xy[nearest, 0], line.y - path.xy[nearest, 1]
                yaw = path.yaw[nearest]
                s = nearest * STEP + float(dx * np.cos(yaw) + dy * np.sin(yaw))
                found.append(StopPoint(s, light, line.u - line.paint_u))
    return sorted(found, key=lambda point: point.s)
