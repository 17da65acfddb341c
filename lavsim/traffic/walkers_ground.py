"""What background walkers read of a town: the footways with the room beside posts, and the traffic that comes to each
place where they cross."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lavsim.map.footways import FootwayKind, Footways, get_footways
from lavsim.map.lane import DRIVABLE
from lavsim.map.town_map import TownMap
from lavsim.portable_math import snapped
from lavsim.types import RoadOption

Floats = NDArray[np.float64]

EDGE_MARGIN = 0.3  # [m] between a walker's middle and the edge of the ground
POST_MARGIN = 0.36  # [m] between a walker's middle and what stands there
ROOM_BEHIND = 0.75  # [m] along the way, before and behind a post, in which one keeps clear of it
OUTLINE = 0.4  # [m] between points looked at on the outline of what stands there
WALKING_PACE = 1.4  # [m/s]
LOOK_MARGIN = 3.0  # [s] that is looked ahead beyond the time needed to cross
NEAREST_LOOK, FARTHEST_LOOK = 35.0, 160.0  # [m] along the lanes
BOX_MARGIN = 3.0  # [m]

EDGE = np.dtype(
    [("a", "i4"), ("b", "i4"), ("kind", "i4"), ("first", "i4"), ("last", "i4"), ("crossed", "i4"),
     ("crossed_end", "i4"), ("approach", "i4"), ("approach_end", "i4"), ("step", "f8"), ("length", "f8"),
     ("near_kerb", "f8"), ("far_kerb", "f8"), ("x", "f8"), ("y", "f8"), ("reach", "f8")]
)  # fmt: skip
CROSSED = np.dtype([("lane", "i4"), ("light", "i4"), ("enter", "f8"), ("leave", "f8")])
APPROACH = np.dtype(
    [("crossed", "i4"), ("row", "i4"), ("rows", "i4"), ("light", "i4"), ("turn", "i4"), ("step", "f8"),
     ("ahead", "f8"), ("line", "f8"), ("zone", "f8"), ("x0", "f8"), ("y0", "f8"), ("x1", "f8"), ("y1", "f8")]
)  # fmt: skip


class Ground(NamedTuple):
    """A town as walkers know it.

    Attributes:
        node_first, node_edge: As `Footways`.
        edge: (E,) records: nodes `a`, `b`; `kind`; rows `first` to `last` of `points`; rows of `crossed` and
            `approach`; `step` of the points, `length` and kerbs along the edge [m]; middle `x`, `y` and how far from
            it traffic matters [m].
        points: (P, 7) x, y, z [m], cosine and sine of the direction, and how far to the left (negative) and right the
            middle of a walker may be [m].
        crossed: (K,) lanes crossed: `lane`, its `light` or -1, walkers are in the way from `enter` to `leave` [m].
        approach: (A,) lanes on which traffic comes to `crossed`: `rows` of `lane_points` from `row` on, `step` [m]
            apart; a place at `u` on it is `ahead` - u before the walkers' way [m], which takes `zone` [m]; `line` [m]
            before the way traffic stops at `light`, -1 for none; `turn` of the junction lane it leads over; bounds.
        lane_points: (Q, 5) as `LaneTable.points`.
    """

    node_first: NDArray[np.int32]
    node_edge: NDArray[np.int32]
    edge: NDArray[np.void]
    points: Floats
    crossed: NDArray[np.void]
    approach: NDArray[np.void]
    lane_points: Floats


@lru_cache(maxsize=8)
def get_ground(town: TownMap) -> Ground:
    """What walkers read of a town, made once a process."""
    footways = get_footways(town)
    edge = np.zeros(len(footways), EDGE)
    edge["a"], edge["b"] = footways.ends.T
    edge["kind"] = footways.kind
    edge["first"], edge["last"] = footways.first[:-1], footways.first[1:] - 1
    edge["crossed"], edge["crossed_end"] = footways.crossed_first[:-1], footways.crossed_first[1:]
    edge["step"], edge["length"] = footways.step, footways.length
    edge["near_kerb"], edge["far_kerb"] = footways.kerb.T
    middle = (edge["first"] + edge["last"]) // 2
    edge["x"], edge["y"] = footways.points[middle, :2].T
    crossed = np.zeros(len(footways.crossed_lane), CROSSED)
    crossed["lane"], crossed["light"] = footways.crossed_lane, footways.crossed_light
    crossed["enter"], crossed["leave"] = footways.crossed_way.T
    approach = _approaches(town, footways, edge)
    points = _with_room(town, footways)
    return Ground(footways.node_first, footways.node_edge, edge, points, crossed, approach, town.lanes.points)


def _with_room(town: TownMap, footways: Footways) -> Floats:
    """Points of all edges with the room to either side, beside what stands there."""
    yaw, room = footways.points[:, 3], np.maximum(footways.points[:, 4] - EDGE_MARGIN, 0.05)
    points = snapped(np.column_stack([footways.points[:, :3], np.cos(yaw), np.sin(yaw), -room, room]))
    spots, owner = _outlines(town)
    if not len(spots) or not len(points):
        return points
    widest = float(footways.points[:, 4].max()) + 0.5
    tree = cKDTree(points[:, :3])
    near = np.flatnonzero(tree.query(spots, distance_upper_bound=widest + 0.5)[0] < np.inf)
    hits: Sequence[list[int]] = tree.query_ball_point(spots[near], widest)  # type: ignore[assignment]
    spot = np.repeat(near, [len(hit) for hit in hits])
    at = np.array([p for hit in hits for p in hit], np.int64)
    gap = spots[spot, :2] - points[at, :2]
    cos, sin = points[at, 3], points[at, 4]
    along, aside = gap[:, 0] * cos + gap[:, 1] * sin, gap[:, 1] * cos - gap[:, 0] * sin
    beside = (np.abs(along) < ROOM_BEHIND) & (np.abs(aside) < footways.points[at, 4] + POST_MARGIN)
    pairs = np.column_stack([at, owner[spot], np.zeros_like(at)])[beside]
    for (row, _), span in _spans(pairs[:, :2], snapped(aside[beside])):
        _make_room(points, row, span)
    return points


def _spans(pairs: NDArray[np.int64], aside: Floats) -> list[tuple[tuple[int, int], tuple[float, float]]]:
    """Least and greatest of `aside` for each pair, in order of the pairs."""
    unique, group = np.unique(pairs, axis=0, return_inverse=True)
    low, high = np.full(len(unique), np.inf), np.full(len(unique), -np.inf)
    np.minimum.at(low, group.ravel(), aside)
    np.maximum.at(high, group.ravel(), aside)
    keys = [(int(a), int(b)) for a, b in unique]
    return list(zip(keys, zip(low.tolist(), high.tolist(), strict=True), strict=True))


def _make_room(points: Floats, row: int, span: tuple[float, float]) -> None:
    """Leaves the wider side of what covers `span` at a point."""
    low, high = points[row, 5], points[row, 6]
    left, right = span[0] - POST_MARGIN, span[1] + POST_MARGIN
    if left - low >= high - right:
        points[row, 6] = min(high, left)
    else:
        points[row, 5] = max(low, right)
    if points[row, 5] > points[row, 6]:  # too narrow: as far from it as there is ground
        points[row, 5:] = low if left - low >= high - right else high


def _outlines(town: TownMap) -> tuple[Floats, NDArray[np.int64]]:
    """Points on the outlines of what stands on the ground (n, 3), and which solid each belongs to."""
    prisms = town.scenery.prisms
    spots, owner = [], []
    for k in np.flatnonzero(prisms.solid & (prisms.z1 - prisms.z0 > 0.3)).tolist():
        ring = prisms.vertices[k, : prisms.count[k]]
        closed = np.concatenate([ring, ring[:1]])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
        at = np.linspace(0.0, along[-1], max(3, int(along[-1] / OUTLINE)), endpoint=False)
        line = np.column_stack([np.interp(at, along, closed[:, 0]), np.interp(at, along, closed[:, 1])])
        spots.append(np.column_stack([line, np.full(len(line), prisms.z0[k])]))
        owner.append(np.full(len(line), k))
    if not spots:
        return np.zeros((0, 3)), np.zeros(0, np.int64)
    return np.concatenate(spots), np.concatenate(owner)


def _approaches(town: TownMap, footways: Footways, edge: NDArray[np.void]) -> NDArray[np.void]:
    """Lanes on which traffic comes to each place where walkers cross; fills what `edge` knows of them."""
    lanes = town.lanes
    setback = {line.lane: lanes.length[line.lane] - line.paint_u for post in town.lights for line in post.stop_lines}
    rows: list[tuple[float, ...]] = []
    for number in np.flatnonzero(footways.kind != FootwayKind.SIDEWALK).tolist():
        edge["approach"][number] = len(rows)
        kerbs = footways.kerb[number]
        look = 0.0
        for k in range(footways.crossed_first[number], footways.crossed_first[number + 1]):
            speed = float(lanes.speed_limit[footways.crossed_lane[k]])
            seconds = float(kerbs[1] - kerbs[0]) / WALKING_PACE + LOOK_MARGIN
            reach = min(max(speed * seconds, NEAREST_LOOK), FARTHEST_LOOK)
            rows += _upstream(town, footways, k, reach, setback)
            look = max(look, reach)
        edge["approach_end"][number] = len(rows)
        edge["reach"][number] = look + float(kerbs[1] - kerbs[0])
    approach = np.zeros(len(rows), APPROACH)
    for column, values in zip(APPROACH.names or (), zip(*rows, strict=True), strict=False):
        approach[column] = values
    return approach


def _upstream(
    town: TownMap, footways: Footways, k: int, reach: float, setback: dict[int, float]
) -> list[tuple[float, ...]]:
    """Rows of `Ground.approach` for one crossed lane: itself and the lanes that lead to it within `reach`."""
    lanes = town.lanes
    start = int(footways.crossed_lane[k])
    low, high = (float(v) for v in footways.crossed_u[k])
    light, line = -1, 0.0
    if lanes.junction[start] < 0 and footways.crossed_light[k] >= 0:
        light, line = int(footways.crossed_light[k]), low - (lanes.length[start] - setback.get(start, 0.0))
    rows: list[tuple[float, ...]] = []
    waiting = deque([(start, low, light, line, int(RoadOption.VOID))])
    seen = {start}
    while waiting:
        lane, ahead, light, line, turn = waiting.popleft()
        end = high if lane == start else float(lanes.length[lane])
        begin = max(ahead - reach, 0.0)
        step = float(lanes.step[lane])
        first = int(lanes.first[lane]) + int(begin / step)
        count = max(int(np.ceil((end - begin) / step)), 1) + 1
        count = min(count, int(lanes.first[lane + 1]) - first)
        xy = lanes.points[first : first + count, :2]
        bounds = [*(xy.min(axis=0) - BOX_MARGIN), *(xy.max(axis=0) + BOX_MARGIN)]
        offset = (first - int(lanes.first[lane])) * step
        rows.append((k, first, count, light, turn, step, ahead - offset, line, high - low, *bounds))
        if ahead >= reach:
            continue
        for before in lanes.predecessors(lane).tolist():
            if before in seen or not lanes.type[before] & DRIVABLE:
                continue
            seen.add(before)
            gate, stop, way = light, line, turn
            if lanes.junction[lane] >= 0 and lanes.junction[before] < 0:
                if gate < 0 and lanes.light[lane] >= 0:
                    gate, stop = int(lanes.light[lane]), ahead + setback.get(before, 0.0)
                way = int(lanes.turn[lane]) if way == RoadOption.VOID else way
            waiting.append((before, ahead + float(lanes.length[before]), gate, stop, way))
    return rows
