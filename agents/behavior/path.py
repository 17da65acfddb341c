"""The line to drive: a smooth reference path through the dense plan, in steps of half a metre."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.types import RoadOption
from lavsim.world.dynamics import REAR_LENGTH

Floats = NDArray[np.float64]

STEP = 0.5  # [m] spacing of the path's samples
MIN_ADVANCE = 0.4  # [m] plan points nearer than this, or behind, are joints of the plan's pieces
EXTENSION = 12.0  # [m] straight on behind the last plan point, so that the goal is driven through
CHANGE_OFFSET = 1.5  # [m] sideways jump between plan points that makes a lane change
CHANGE_RUN = 7.0  # [m] cleared before and behind such a jump: a change over about 20 m
SMOOTHING = 5  # samples; a kink of the map is spread over 2.5 m


@dataclass(frozen=True)
class ReferencePath:
    """Samples every `STEP` along the path of the vehicle's reference point; S of them.

    Attributes:
        xy: (S, 2) [m].
        z: (S,) [m].
        yaw: (S,) direction of the path, unwrapped [rad].
        curvature: (S,) [1/m], positive to the right.
        heading: (S,) the vehicle's own heading there: the path's less the slip angle of its bicycle model [rad].
        options: (S,) int8, `RoadOption` of the nearest plan point before.
        end: Length up to the last plan point [m]; the samples go on behind it.
    """

    xy: Floats
    z: Floats
    yaw: Floats
    curvature: Floats
    heading: Floats
    options: NDArray[np.int8]
    end: float

    def __len__(self) -> int:
        return len(self.yaw)

    def at(self, values: Floats, s: float) -> float:
        """One of the path's arrays at `s` [m], interpolated."""
        position = min(max(s / STEP, 0.0), len(values) - 1.001)
        index = int(position)
        share = position - index
        return float(values[index] * (1.0 - share) + values[index + 1] * share)

    def spans(self, options: Sequence[RoadOption]) -> list[tuple[float, float]]:
        """Stretches [m] whose plan points carry any of `options`: the ways through junctions."""
        inside = np.concatenate([[False], np.isin(self.options, [int(o) for o in options]), [False]])
        edges = np.flatnonzero(inside[1:] != inside[:-1])
        return [(float(a) * STEP, float(b - 1) * STEP) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def path_of_plan(plan: Sequence[tuple[Any, Any]]) -> ReferencePath:
    """The path along CARLA's dense plan: (transform, option) pairs about a metre apart."""
    points = np.array([(t.location.x, t.location.y, t.location.z) for t, _ in plan], dtype=np.float64)
    yaw = np.radians([t.rotation.yaw for t, _ in plan])
    return path_through(points, yaw, np.array([int(option) for _, option in plan], dtype=np.int8))


def path_through(points: Floats, yaw: Floats, options: NDArray[np.int8]) -> ReferencePath:
    """A smooth path through `points` (R, 3) with directions `yaw` (R,); slips backward at the plan's joints leave."""
    kept = _advancing(points, yaw)
    points, yaw, options = points[kept], yaw[kept], options[kept]
    if len(points) < 2:
        ahead = np.array([np.cos(yaw[0]), np.sin(yaw[0]), 0.0])
        points, yaw, options = np.stack([points[0], points[0] + ahead]), yaw[[0, 0]], options[[0, 0]]
    fine, along = _hermite(points, yaw)
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(fine[:, :2], axis=0).T))])
    end = float(travelled[-1])
    s = np.arange(0.0, end, STEP)
    sampled = np.stack([np.interp(s, travelled, fine[:, k]) for k in range(3)], axis=1)
    number = np.floor(np.interp(s, travelled, along) + 1e-6).astype(np.int64)
    extra = (np.arange(int(EXTENSION / STEP)) + 1.0) * STEP
    ahead = np.array([np.cos(yaw[-1]), np.sin(yaw[-1]), 0.0])
    sampled = np.concatenate([sampled, sampled[-1] + extra[:, None] * ahead])
    number = np.concatenate([number, np.full(len(extra), len(points) - 1)])
    course = np.unwrap(np.arctan2(np.gradient(sampled[:, 1]), np.gradient(sampled[:, 0])))
    course = smoothed(course)
    curvature = smoothed(np.gradient(course, STEP))
    slip = np.arcsin(np.clip(curvature * REAR_LENGTH, -0.4, 0.4))
    return ReferencePath(
        xy=np.ascontiguousarray(sampled[:, :2]),
        z=np.ascontiguousarray(sampled[:, 2]),
        yaw=course,
        curvature=curvature,
        heading=course - slip,
        options=options[number],
        end=end,
    )


class PathTracker:
    """Where on its path a vehicle is; never jumps to another pass over the same place."""

    BEHIND, AHEAD = 8, 40  # samples searched around the last place

    def __init__(self, path: ReferencePath) -> None:
        self.path = path
        self._index = 0
        self._is_placed = False

    def update(self, x: float, y: float) -> tuple[float, float]:
        """Place s along the path and offset to its right [m] of the point x, y."""
        path = self.path
        if self._is_placed:
            low, high = max(self._index - self.BEHIND, 0), min(self._index + self.AHEAD, len(path))
        else:  # the ego starts near the first point
            low, high, self._is_placed = 0, min(100, len(path)), True
        self._index, s, offset = _place(path.xy, path.yaw, low, high, x, y)
        return s, offset


@kernel
def _place(xy: Floats, yaw: Floats, low: int, high: int, x: float, y: float) -> tuple[int, float, float]:
    """Nearest of the samples low … high-1, place along the path and offset to its right of the point x, y."""
    index, best = low, math.inf
    for k in range(low, high):
        distance = (xy[k, 0] - x) ** 2 + (xy[k, 1] - y) ** 2
        if distance < best:
            index, best = k, distance
    cos, sin = math.cos(yaw[index]), math.sin(yaw[index])
    dx, dy = x - xy[index, 0], y - xy[index, 1]
    return index, index * STEP + dx * cos + dy * sin, dy * cos - dx * sin


def _advancing(points: Floats, yaw: Floats) -> NDArray[np.int64]:
    """Indices of points that each lie ahead of the one before, with lane changes drawn out."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    kept = [0]
    changes: list[int] = []  # positions in `kept` of the first point on the new lane
    for i in range(1, len(points)):
        last = kept[-1]
        dx, dy = points[i, 0] - points[last, 0], points[i, 1] - points[last, 1]
        if dx * cos[last] + dy * sin[last] < MIN_ADVANCE:
            continue
        straight = abs(float(np.angle(np.exp(1j * (yaw[i] - yaw[last]))))) < 0.5
        if abs(dy * cos[last] - dx * sin[last]) > CHANGE_OFFSET and straight:
            changes.append(len(kept))
        kept.append(i)
    keep = np.ones(len(kept), dtype=bool)
    xy = points[kept, :2]
    for change in changes:
        for sides in (range(change - 1, 0, -1), range(change, len(kept) - 1)):
            start = sides.start
            for k in sides:
                if np.hypot(*(xy[k] - xy[start])) >= CHANGE_RUN:
                    break
                keep[k] = False
    return np.array(kept)[keep]


def _hermite(points: Floats, yaw: Floats) -> tuple[Floats, Floats]:
    """Cubic pieces through `points` with tangents along `yaw`: (F, 3) fine points and their piece number + share."""
    chord = np.maximum(np.hypot(*np.diff(points[:, :2], axis=0).T), 1e-6)
    parts = np.maximum(np.ceil(chord / 0.1).astype(np.int64), 1)
    piece = np.repeat(np.arange(len(chord)), parts)
    offset = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    t = offset / parts[piece]
    tangent = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1)
    rise = np.concatenate([np.diff(points[:, 2]) / chord, [0.0]])
    tangent[:, 2] = rise
    a, b = points[piece], points[piece + 1]
    u, v = tangent[piece] * chord[piece, None], tangent[piece + 1] * chord[piece, None]
    v[:, 2] = u[:, 2]
    t1, t2, t3 = t[:, None], t[:, None] ** 2, t[:, None] ** 3
    fine = (2 * t3 - 3 * t2 + 1) * a + (t3 - 2 * t2 + t1) * u + (3 * t2 - 2 * t3) * b + (t3 - t2) * v
    return np.concatenate([fine, points[-1:]]), np.concatenate([piece + t, [len(points) - 1.0]])


def smoothed(values: Floats) -> Floats:
    """Moving average over `SMOOTHING` samples, ends held."""
    half = SMOOTHING // 2
    padded = np.concatenate([np.full(half, values[0]), values, np.full(half, values[-1])])
    return np.convolve(padded, np.full(SMOOTHING, 1.0 / SMOOTHING), mode="valid")
