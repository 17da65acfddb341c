"""Scans as perception takes them: turned, painted where the front cameras look, thinned, several on top of each other.

Points are (x ahead, y right, z up [m], intensity) in the sensor's frame, 2.4 m above the ego's origin; a turn rotates
the world about the ego, clockwise from above [rad].
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import GridConfig, LavConfig
from lavsim.dataset.reader import Dataset
from lavsim.geometry import wrap_angle
from lavsim.random import Draws

SCORES = 4  # painted on a point: pedestrian, lane mark, road, vehicle
CAMERA_AHEAD = 1.5  # of the LiDAR [m]; both stand at one height
FRONT_YAWS = np.radians((-60.0, 0.0, 60.0))
HALF_WIDTH, HALF_HEIGHT = 128.0 / 204.84, 144.0 / 204.84  # tangents of half the cameras' angles
SHIFT_JITTER, TURN_JITTER = 0.4, 0.1  # of a past scan's pose [m], [rad]
_LEAST_DEPTH = 0.1  # [m]

Floats = NDArray[np.float32]


class Scores(Protocol):
    """Where the painted scores of recorded scans are to be had."""

    def scores(self, episode: int, frame: int) -> Floats:
        """(N, 4) of the scan's points, in their order."""


def turned(xy: NDArray[np.floating], angle: float) -> NDArray[np.floating]:
    """Places (..., 2) ahead and right after the world was turned about the ego; planner points turn alike."""
    c, s = np.cos(angle), np.sin(angle)
    found = np.empty_like(xy)
    found[..., 0] = c * xy[..., 0] - s * xy[..., 1]
    found[..., 1] = s * xy[..., 0] + c * xy[..., 1]
    return found


def in_front_view(points: Floats) -> NDArray[np.bool_]:
    """(N,) whether one of the three front cameras sees where points (N, >= 3) lie."""
    x, y, z = points[:, 0] - CAMERA_AHEAD, points[:, 1], points[:, 2]
    seen = np.zeros(len(points), bool)
    for yaw in FRONT_YAWS:
        depth, right = x * np.cos(yaw) + y * np.sin(yaw), y * np.cos(yaw) - x * np.sin(yaw)
        seen |= (depth > _LEAST_DEPTH) & (np.abs(right) < depth * HALF_WIDTH) & (np.abs(z) < depth * HALF_HEIGHT)
    return seen


def scan_points(
    data: Dataset,
    episode: int,
    frame: int,
    config: LavConfig,
    scores: Scores | None,
    angle: float,
    draws: Draws | None,
    right: float = 0.0,
) -> Floats:
    """(P, F) points of a frame on the grid, F = `config.point_features`.

    Args:
        data: Where it was recorded.
        episode: Its episode.
        frame: Its number there.
        config: Sizes.
        scores: What the points are painted with; zeros if None though the sizes have scores.
        angle: The world is turned by it.
        draws: Of the points that are left out and the jitter of past scans; without them every n-th point goes, and
            past scans lie where they were.
        right: As seen from so far right of the ego [m], before the turn.
    """
    scans = config.temporal.scans
    first = _segment_start(data, episode, frame)
    parts = []
    for age in range(min(scans, frame - first + 1)):
        points = _one_scan(data, episode, frame - age, config, scores)
        if age:
            points[:, :2] = _carried(data, episode, frame - age, frame, points[:, :2], draws, age)
        if scans > 1:
            tags = np.zeros((len(points), scans), np.float32)
            tags[:, age] = 1.0
            points = np.concatenate([points, tags], axis=1)
        parts.append(points)
    points = np.concatenate(parts)
    points[:, 1] -= right
    points[:, :2] = turned(points[:, :2], angle)
    points = thinned(points, config, draws)
    if config.painted:
        points[~in_front_view(points), 4 : 4 + SCORES] = 0.0
    return points


def thinned(points: Floats, config: LavConfig, draws: Draws | None = None) -> Floats:
    """Those of points (P, >= 3) that lie on the grid, and of them no more than the networks take."""
    most = config.pillars.points * config.temporal.scans
    return _some(points[_on_grid(points, config.grid)], most, draws)


def _one_scan(data: Dataset, episode: int, frame: int, config: LavConfig, scores: Scores | None) -> Floats:
    points: Floats = data.read(episode, frame, ["lidar"])["lidar"]
    if not config.painted:
        return points
    found = scores.scores(episode, frame) if scores is not None else np.zeros((len(points), SCORES), np.float32)
    return np.concatenate([points, found], axis=1)


def _carried(
    data: Dataset, episode: int, past: int, now: int, xy: Floats, draws: Draws | None, age: int
) -> NDArray[np.floating]:
    """Places (P, 2) in the frame of a past frame's ego, in the frame of this one's."""
    table = data.table(episode)
    turn = float(wrap_angle(table["yaw"][past] - table["yaw"][now]))
    (dx, dy), yaw = (table["position"][past] - table["position"][now])[:2], table["yaw"][now]
    shift = np.array([np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx])
    if draws is not None:
        unit = draws.stream("past", age).uniform(0, 3, -1.0, 1.0)
        shift, turn = shift + SHIFT_JITTER * unit[:2], turn + TURN_JITTER * unit[2]
    return (turned(xy, turn) + shift).astype(np.float32)


def _segment_start(data: Dataset, episode: int, frame: int) -> int:
    """The first frame after the last jump in time before a frame."""
    return max((at for at in (0, *data.episodes[episode].breaks) if at <= frame), default=0)


def _on_grid(points: Floats, grid: GridConfig) -> NDArray[np.bool_]:
    x, y = points[:, 0], points[:, 1]
    return (x <= grid.ahead) & (x > -grid.behind) & (y >= -grid.aside) & (y < grid.aside)


def _some(points: Floats, most: int, draws: Draws | None) -> Floats:
    """At most `most` of points."""
    if len(points) <= most:
        return points
    if draws is None:
        return points[np.arange(most) * len(points) // most]
    return points[np.sort(np.argpartition(draws.stream("points").bits(0, len(points)), most)[:most])]
