"""Where a lane ends for a red light: the leaderboard's stop waypoint, and the painted line near it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.map.lane import LaneTable
from lavsim.map.records import Network, ObjectRecord
from lavsim.map.section import RoadShape

PAINT_RANGE = 15.0  # [m] a painted stop line farther before the junction belongs to something else
STOP_LINE_NAMES = ("StopLine", "SolidSingleWhite")


@dataclass(frozen=True)
class StopLine:
    """Where a lane ends for a red light.

    Attributes:
        lane: Approach lane (index into the lane table).
        road_id: Its road in the file.
        lane_id: Its id in the file.
        u: Stop waypoint of the leaderboard, the last 0.5 m step before the junction, on the lane [m].
        x, y: The same point in the world [m].
        yaw: Direction of travel there [rad].
        width: Lane width there [m].
        paint_u: Painted stop line on the lane [m]; `u` where none is painted.
    """

    lane: int
    road_id: int
    lane_id: int
    u: float
    x: float
    y: float
    yaw: float
    width: float
    paint_u: float


def point_on(lanes: LaneTable, lane: int, u: float) -> NDArray[np.float64]:
    """x, y, z, yaw, curvature of `lane` at `u`, linear between centre points."""
    points = lanes.centre_line(lane)
    position = min(max(u / float(lanes.step[lane]), 0.0), len(points) - 1.0)
    row = min(int(position), len(points) - 2)
    return points[row] + (position - row) * (points[row + 1] - points[row])


def width_on(lanes: LaneTable, lane: int, u: float) -> float:
    """Width of `lane` at `u` [m]."""
    rows = lanes.rows(lane)
    return float(np.interp(u, np.arange(rows.stop - rows.start) * lanes.step[lane], lanes.width[rows]))


def stop_line(lanes: LaneTable, lane: int, u: float, paint: NDArray[np.float64]) -> StopLine:
    """The stop line of `lane` whose last step of the leaderboard's walk is at `u` [m].

    Args:
        lanes: All lanes.
        lane: Approach lane.
        u: Place on it [m].
        paint: (K, 3) centres and lengths of painted lines [m], as `painted_lines` gives them.
    """
    x, y, _, yaw, _ = point_on(lanes, lane, u)
    width = width_on(lanes, lane, u)
    painted = u
    end = lanes.points[lanes.first[lane + 1] - 1, :2]
    if len(paint):
        paint = paint[np.hypot(*(paint[:, :2] - end).T) < PAINT_RANGE + 2.0 + np.maximum(paint[:, 2], width)]
    if len(paint):
        points = lanes.centre_line(lane)[:, :2]
        near = int(np.ceil(PAINT_RANGE / float(lanes.step[lane]))) + 1
        tail = points[-near:]
        distance = np.hypot(paint[:, None, 0] - tail[None, :, 0], paint[:, None, 1] - tail[None, :, 1])
        line, point = np.unravel_index(int(np.argmin(distance)), distance.shape)
        if distance[line, point] < max(paint[line, 2] / 2.0, width / 2.0):
            painted = float((len(points) - len(tail) + int(point)) * lanes.step[lane])
    return StopLine(
        lane,
        int(lanes.road_id[lane]),
        int(lanes.lane_id[lane]),
        u,
        float(x),
        float(y),
        float(yaw),
        width,
        min(painted, u),
    )


def is_stop_line(thing: ObjectRecord) -> bool:
    """Whether an object is a painted stop line."""
    return thing.name in STOP_LINE_NAMES


def outline_in_world(thing: ObjectRecord, shape: RoadShape) -> NDArray[np.float64]:
    """Corners `(M, 2)` of an object's outline, or of its length x width box [m]."""
    if thing.road_outline and not thing.outline:
        return np.array([shape.place(s, t)[:2] for s, t, _ in thing.road_outline])
    corners: Sequence[Sequence[float]] = thing.outline
    if not corners:
        a, b = thing.length / 2.0, thing.width / 2.0
        corners = [(a, b), (a, -b), (-a, -b), (-a, b)]
    local = np.array([corner[:2] for corner in corners])
    x, y, _, yaw = shape.place(thing.s, thing.t)
    heading = -yaw + thing.heading  # OpenDRIVE's sense
    u, v = local[:, 0], local[:, 1]
    return np.stack(
        [x + u * np.cos(heading) - v * np.sin(heading), y - (u * np.sin(heading) + v * np.cos(heading))], axis=1
    )


def painted_lines(network: Network, shapes: dict[int, RoadShape]) -> NDArray[np.float64]:
    """Centres and lengths `(K, 3)` of painted stop lines."""
    rows = []
    for road in network.roads:
        for thing in road.objects:
            if is_stop_line(thing):
                corners = outline_in_world(thing, shapes[road.id])
                extent = float(np.hypot(*(corners.max(axis=0) - corners.min(axis=0))))
                rows.append((*corners.mean(axis=0), extent))
    return np.array(rows).reshape(-1, 3)
