"""What the audit of traffic asks of places: the stop line ahead of each lane, and boxes that are about to meet."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lavsim.map.stop_lines import StopLine
from lavsim.map.town_map import LaneHits, TownMap

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StopLines:
    """Lines of lights and stop signs, and which of them comes next on each lane.

    Attributes:
        x, y, yaw, width: (S,) the middle of each line [m], the direction of travel [rad], the lane's width [m].
        light: (S,) number of its light, -1 for a stop sign.
        of_lane: (L,) the next line on or after each lane, -1.
        at: (L,) where that line is in the lane's own u, beyond the lane's length if it lies on a later lane [m].
    """

    x: Floats
    y: Floats
    yaw: Floats
    width: Floats
    light: NDArray[np.int64]
    of_lane: NDArray[np.int64]
    at: Floats

    def ahead(self, hits: LaneHits) -> tuple[NDArray[np.int64], Floats]:
        """Line ahead of each place (-1 for none or one that is passed) and the way to it [m]."""
        line = self.of_lane[hits.lane]
        rest = self.at[hits.lane] - hits.u
        return np.where(rest > 0.0, line, -1), rest

    def crossed(self, line: NDArray[np.int64], xy: Floats) -> NDArray[np.bool_]:
        """Whether points (N, 2) lie just behind the lines they were heading for."""
        dx, dy = xy[:, 0] - self.x[line], xy[:, 1] - self.y[line]
        cos, sin = np.cos(self.yaw[line]), np.sin(self.yaw[line])
        aside = np.abs(dy * cos - dx * sin)
        return (dx * cos + dy * sin >= 0.0) & (aside < self.width[line] / 2.0 + 1.0)


def build_stop_lines(town: TownMap, reach: float) -> StopLines:
    """All stop lines of `town`, each known on the lanes up to `reach` [m] before it."""
    posts: list[tuple[StopLine, int]] = [(line, light.index) for light in town.lights for line in light.stop_lines]
    posts += [(line, -1) for sign in town.signs if sign.kind == "stop" for line in sign.stop_lines]
    lanes = town.lanes
    of_lane, at = np.full(len(lanes), -1, np.int64), np.zeros(len(lanes))
    lines = [line for line, _ in posts]
    places = town.centre([p.lane for p in lines], [p.paint_u for p in lines]) if lines else np.zeros((0, 5))
    waiting: list[tuple[float, int, int]] = []  # way from the lane's start to the line, lane, line; nearest first
    for k, line in enumerate(lines):
        heapq.heappush(waiting, (line.paint_u, line.lane, k))
    while waiting:
        way, lane, k = heapq.heappop(waiting)
        if of_lane[lane] >= 0:
            continue
        of_lane[lane], at[lane] = k, way
        if way < reach:
            for before in lanes.predecessors(lane).tolist():
                heapq.heappush(waiting, (way + float(lanes.length[before]), before, k))
    return StopLines(
        places[:, 0], places[:, 1], places[:, 3], np.array([p.width for p in lines]),
        np.array([light for _, light in posts], np.int64), of_lane, at,
    )  # fmt: skip


def boxes_about_to_meet(
    pose: Floats, velocity: Floats, turn: Floats, half: Floats, z: Floats, horizon: float, closing: float
) -> tuple[NDArray[np.int64], Floats]:
    """Pairs of boxes that overlap within `horizon` if everybody goes on as it does.

    Args:
        pose: (N, 3) x, y [m], yaw [rad].
        velocity: (N, 2) [m/s].
        turn: (N,) yaw rate [rad/s].
        half: (N, 2) half length, half width [m].
        z: (N,) ground level [m]; pairs more than 3 m apart don't meet.
        horizon: [s]
        closing: Relative speed from which a pair counts [m/s].

    Returns:
        (P, 2) rows of the pairs, and (P,) when they first overlap [s], to a quarter of the horizon.
    """
    if len(pose) < 2:
        return np.zeros((0, 2), np.int64), np.zeros(0)
    fastest = float(np.hypot(*velocity.T).max())
    tree = cKDTree(pose[:, :2])
    pairs = tree.query_pairs(2.0 * float(half.max()) + 2.0 * fastest * horizon, output_type="ndarray").astype(np.int64)
    a, b = pairs[:, 0], pairs[:, 1]
    between, apart = velocity[b] - velocity[a], pose[b, :2] - pose[a, :2]
    speed = np.hypot(*between.T)
    reach = np.hypot(*half[a].T) + np.hypot(*half[b].T) + speed * horizon
    meets = (speed > closing) & (np.hypot(*apart.T) < reach) & (np.abs(z[a] - z[b]) < 3.0)
    pairs = pairs[meets & (np.sum(between * apart, axis=1) < 0.0)]
    first = np.full(len(pairs), np.inf)
    for time in horizon * np.arange(1.0, 5.0) / 4.0:
        later = _carried(pose, velocity, turn, time)
        met = _overlap(later, half, pairs) & np.isinf(first)
        first[met] = time
    return pairs[np.isfinite(first)], first[np.isfinite(first)]


def _carried(pose: Floats, velocity: Floats, turn: Floats, time: float) -> Floats:
    """Poses after `time` [s] at the same speed and yaw rate."""
    half_turn = turn * time / 2.0
    cos, sin = np.cos(half_turn), np.sin(half_turn)
    vx, vy = velocity[:, 0] * cos - velocity[:, 1] * sin, velocity[:, 0] * sin + velocity[:, 1] * cos
    return np.column_stack([pose[:, 0] + vx * time, pose[:, 1] + vy * time, pose[:, 2] + turn * time])


def _overlap(pose: Floats, half: Floats, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(P,) whether the boxes of pairs overlap: no axis of either parts them."""
    overlapping = np.ones(len(pairs), np.bool_)
    for one, two in ((pairs[:, 0], pairs[:, 1]), (pairs[:, 1], pairs[:, 0])):
        dx, dy = (pose[two, :2] - pose[one, :2]).T
        cos, sin = np.cos(pose[one, 2]), np.sin(pose[one, 2])
        turned = pose[two, 2] - pose[one, 2]
        c, s = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        overlapping &= np.abs(dx * cos + dy * sin) < half[one, 0] + half[two, 0] * c + half[two, 1] * s
        overlapping &= np.abs(dy * cos - dx * sin) < half[one, 1] + half[two, 0] * s + half[two, 1] * c
    return overlapping
