"""Vehicles of hazards that follow a line: the kernel that steers and brakes them, and the line as it reads it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import asin, atan, cos_sin, snapped
from lavsim.types import DT

Floats = NDArray[np.float64]

STEP = 0.5  # [m] between the points of a line
_LATERAL = 4.0  # [m/s²] in bends: who plays a part in a hazard drives briskly
_SLOWING = 4.0  # [m/s²] before bends
_FASTEST = 90.0  # [m/s]
_STEER_LENGTH, _STEER_TIME = 4.0, 0.35  # [m], [s] over which an error of position fades, as for background drivers
_STAND_OFF, _HEADWAY = 3.0, 1.0  # [m], [s] kept to what is ahead
_BESIDE = 0.4  # [m] kept free on either side of the way
_LEVEL_GAP = 3.0  # [m] as in `lavsim.world.physics`
_UPSET = 100  # ticks after a contact in which a driver brakes


class Line(NamedTuple):
    """A way to follow.

    Attributes:
        xy: (P, 2) points, `STEP` apart [m].
        yaw: (P,) direction [rad, not wrapped].
        bend: (P,) curvature [1/m].
        pace: (P,) speed that the bends from here on allow [m/s].
    """

    xy: Floats
    yaw: Floats
    bend: Floats
    pace: Floats

    @property
    def length(self) -> float:
        """[m]"""
        return STEP * (len(self.xy) - 1)


def line_of(points: Floats) -> Line:
    """The line through `points` (N, 2), N at least 2."""
    points = np.asarray(points, dtype=np.float64)[:, :2]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    count = max(int(along[-1] / STEP), 2)
    at = np.arange(count + 1) * STEP
    xy = np.stack([np.interp(at, along, points[:, k]) for k in (0, 1)], axis=1)
    ahead = np.gradient(xy, axis=0)
    yaw = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    bend = np.gradient(yaw, STEP)
    return Line(snapped(xy), snapped(yaw), snapped(bend), snapped(pace_of(bend, _LATERAL, _SLOWING)))


def pace_of(bend: Floats, lateral: float, slowing: float) -> Floats:
    """Speed (P,) that the bends from each point on allow [m/s].

    Args:
        bend: (P,) curvature at points `STEP` apart [1/m].
        lateral: Acceleration in bends [m/s²].
        slowing: Braking before them [m/s²].
    """
    pace = np.sqrt(lateral / np.maximum(np.abs(bend), lateral / _FASTEST**2))
    for k in range(len(pace) - 2, -1, -1):
        pace[k] = min(pace[k], math.sqrt(pace[k + 1] ** 2 + 2.0 * slowing * STEP))
    return pace


class Column(NamedTuple):
    """Vehicles on one line, one slot each.

    Attributes:
        row: (V,) row in the world, -1 for a free slot.
        at: (V,) metres of the line behind it.
        wanted: (V,) speed [m/s].
        offset, target, rate: (V,) to the right of the line [m], where that shall go, and how fast [m/s].
        keeps: (V,) whether it keeps its distance to what is ahead.
    """

    row: NDArray[np.int64]
    at: Floats
    wanted: Floats
    offset: Floats
    target: Floats
    rate: Floats
    keeps: NDArray[np.bool_]


def make_column(count: int) -> Column:
    at, wanted, offset, target, rate = np.zeros((5, count))
    return Column(np.full(count, -1, np.int64), at, wanted, offset, target, rate, np.zeros(count, np.bool_))


@kernel
def pursue(
    line: Line,
    column: Column,
    tick: int,
    limits: tuple[float, float],
    present: NDArray[np.bool_],
    pose: Floats,
    velocity: Floats,
    forward: Floats,
    half: Floats,
    height: Floats,
    touched: NDArray[np.int64],
    command: Floats,
) -> None:
    """Writes what every vehicle of `column` does in this tick.

    Args:
        line: Their way.
        column: Who; where they are is updated.
        tick: Now.
        limits: How hard they speed up and brake at most [m/s²].
        present, pose, velocity, half, height, touched: Columns of the world; half sizes are 0 for what has no box.
        forward: (N,) speed ahead [m/s].
        command: (N, 2) speed after the tick [m/s] and curvature [1/m]; filled for their rows.
    """
    last = len(line.yaw) - 1
    for i in range(len(column.row)):
        row = column.row[i]
        if row < 0 or not present[row]:
            continue
        change = column.target[i] - column.offset[i]
        most = column.rate[i] * DT
        column.offset[i] += min(max(change, -most), most)
        aside = _advance(line, column, i, pose[row, 0], pose[row, 1])
        k = min(int(column.at[i] / STEP + 0.5), last)
        speed = max(forward[row], 0.0)
        allowed = min(column.wanted[i], line.pace[k])
        if touched[row] >= 0 and tick - touched[row] < _UPSET:
            allowed = 0.0
        elif column.keeps[i]:
            gap, pace = _gap_ahead(line, column, i, present, pose, velocity, half, height)
            room = max(gap - _STAND_OFF, 0.0)
            # What a stop behind a leader that brakes as hard leaves, and what a headway leaves.
            allowed = min(allowed, math.sqrt(2.0 * _SLOWING * room + pace * pace), pace + room / _HEADWAY)
        command[row, 0] = min(max(allowed, speed - limits[1] * DT), speed + limits[0] * DT)
        slope = 0.0 if speed < 0.5 or change == 0.0 else min(max(change, -most), most) / (DT * speed)
        command[row, 1] = _steer(line, k, aside - column.offset[i], slope, pose[row, 2], 0.58 * half[row, 0], speed)


@kernel
def _advance(line: Line, column: Column, i: int, x: float, y: float) -> float:
    """Finds where vehicle `i` is along the line; returns its offset to the right of it [m]."""
    last = len(line.yaw) - 1
    aside = 0.0
    for _ in range(2):
        k = min(max(int(column.at[i] / STEP), 0), last)
        cos, sin = cos_sin(line.yaw[k])
        dx, dy = x - line.xy[k, 0], y - line.xy[k, 1]
        column.at[i] = max(k * STEP + dx * cos + dy * sin, 0.0)
        aside = dy * cos - dx * sin
    return aside


@kernel
def _steer(line: Line, k: int, aside: float, slope: float, yaw: float, rear: float, speed: float) -> float:
    """Curvature that brings a vehicle onto the line, critically damped, as background drivers steer."""
    bend = line.bend[k]
    slip = asin(max(-0.9, min(0.9, bend * rear)))
    error = yaw + slip - line.yaw[k] - atan(slope)
    error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
    reach = max(_STEER_LENGTH, _STEER_TIME * speed)
    return bend - aside / reach**2 - 2.0 * error / reach


@kernel
def _gap_ahead(
    line: Line,
    column: Column,
    i: int,
    present: NDArray[np.bool_],
    pose: Floats,
    velocity: Floats,
    half: Floats,
    height: Floats,
) -> tuple[float, float]:
    """Free way to the nearest box ahead on the line [m] and its speed along it [m/s]; inf and 0 if it is free."""
    own = column.row[i]
    reach = 10.0 + 4.0 * max(column.wanted[i], 5.0)
    end = min(int((column.at[i] + reach) / STEP) + 1, len(line.yaw))
    start = int(column.at[i] / STEP)
    nearest, pace = np.inf, 0.0
    for j in range(len(present)):
        dx, dy = pose[j, 0] - pose[own, 0], pose[j, 1] - pose[own, 1]
        if j == own or not present[j] or half[j, 0] == 0.0 or dx * dx + dy * dy > reach * reach:
            continue
        if abs(height[j] - height[own]) > _LEVEL_GAP:
            continue
        best, where = np.inf, -1
        for k in range(start, end, 2):
            ex, ey = pose[j, 0] - line.xy[k, 0], pose[j, 1] - line.xy[k, 1]
            gap = ex * ex + ey * ey
            if gap < best:
                best, where = gap, k
        if where <= start:
            continue
        cos, sin = cos_sin(line.yaw[where])
        ex, ey = pose[j, 0] - line.xy[where, 0], pose[j, 1] - line.xy[where, 1]
        aside = abs(ey * cos - ex * sin - column.offset[i])
        its_cos, its_sin = cos_sin(pose[j, 2] - line.yaw[where])
        wide = abs(its_sin) * half[j, 0] + abs(its_cos) * half[j, 1]
        if aside > wide + half[own, 1] + _BESIDE:
            continue
        long = abs(its_cos) * half[j, 0] + abs(its_sin) * half[j, 1]
        gap = where * STEP - column.at[i] - half[own, 0] - long
        if gap < nearest:
            nearest, pace = gap, max(0.0, velocity[j, 0] * cos + velocity[j, 1] * sin)
    return nearest, pace
