"""The road network as drivers read it: columns of `LaneTable`, and what signs, bends and paint mean for them."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.map.town_map import TownMap
from lavsim.portable_math import cos_sin
from lavsim.types import LaneType

LATERAL_ACCELERATION = 2.0  # [m/s²] of an ordinary driver in bends
SLOWING = 1.5  # [m/s²] at which drivers come down to the speed of a bend or a limit
MAJOR, YIELDS, STOPS = 0, 1, 2
_RANKS = {"yield": YIELDS, "stop": STOPS}
_COLUMNS = (
    "first", "step", "length", "points", "junction", "speed_limit", "light", "turn", "succ_first", "succ",
    "pred_first", "pred", "conflict_first", "conflict", "conflict_u", "left", "right",
)  # fmt: skip


class Lanes(NamedTuple):
    """The columns of `LaneTable` that drivers read, and what they need beside them.

    Attributes:
        left, right: (L,) neighbour that a vehicle may change to, -1.
        setback: (L,) from the line to stop at to the lane's end [m].
        rank: (L,) who waits for whom at junctions without lights: `MAJOR`, `YIELDS` or `STOPS`.
        has_minor: (L,) whether somebody else has to wait at the junction of this lane.
        conflict_back: (E, 2) where a conflict lies on the other lane, as an interval of its u [m].
        merges: (E,) whether the two lanes of a conflict end in the same lane.
        bend: (P,) square of the speed that the bends from here to the lane's end allow [m²/s²].
        width: (L,) mean width [m].
        opposite: (L,) lane of the other direction across a broken centre line, -1.
        meets_start, meets_end: (L,) whether other lanes cross or join at the lane's start or end.
    """

    first: NDArray[np.int32]
    step: NDArray[np.float64]
    length: NDArray[np.float64]
    points: NDArray[np.float64]
    junction: NDArray[np.int32]
    speed_limit: NDArray[np.float64]
    light: NDArray[np.int32]
    turn: NDArray[np.int8]
    succ_first: NDArray[np.int32]
    succ: NDArray[np.int32]
    pred_first: NDArray[np.int32]
    pred: NDArray[np.int32]
    conflict_first: NDArray[np.int32]
    conflict: NDArray[np.int32]
    conflict_u: NDArray[np.float64]
    left: NDArray[np.int32]
    right: NDArray[np.int32]
    setback: NDArray[np.float64]
    rank: NDArray[np.int8]
    has_minor: NDArray[np.bool_]
    conflict_back: NDArray[np.float64]
    merges: NDArray[np.bool_]
    bend: NDArray[np.float64]
    width: NDArray[np.float64]
    opposite: NDArray[np.int32]
    meets_start: NDArray[np.bool_]
    meets_end: NDArray[np.bool_]


@lru_cache(maxsize=4)
def lanes_of(town: TownMap) -> Lanes:
    """What drivers read of a town."""
    table = town.lanes
    columns = {name: np.ascontiguousarray(getattr(table, name)) for name in _COLUMNS}
    columns["left"] = np.where(table.change_left, table.left, -1).astype(np.int32)
    columns["right"] = np.where(table.change_right, table.right, -1).astype(np.int32)
    setback, rank = _signs_and_lines(town)
    in_junction = table.junction >= 0
    minor = np.zeros(int(table.junction.max(initial=-1)) + 1, np.bool_)
    minor[table.junction[in_junction & (rank != MAJOR)]] = True
    bend = np.zeros(len(table.points))
    fill_bends(columns["first"], columns["step"], columns["points"], bend)
    counts = np.maximum(np.diff(table.first), 1)
    width = np.add.reduceat(table.width, table.first[:-1]) / counts if len(table) else np.zeros(0)
    meets_start, meets_end = _meetings(town)
    return Lanes(
        **columns,
        setback=setback,
        rank=rank,
        has_minor=np.where(in_junction, minor[table.junction] if len(minor) else False, False),
        conflict_back=_other_sides(town),
        merges=_merges(town),
        bend=bend,
        width=width,
        opposite=_oncoming_lanes(town),
        meets_start=meets_start,
        meets_end=meets_end,
    )


def _signs_and_lines(town: TownMap) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    setback = np.zeros(len(town.lanes))
    rank = np.full(len(town.lanes), MAJOR, np.int8)
    signs = [sign for sign in town.signs if sign.kind in _RANKS]
    for sign in signs:
        rank[list(sign.lanes)] = _RANKS[sign.kind]
    for line in (line for posts in (town.lights, signs) for post in posts for line in post.stop_lines):
        setback[line.lane] = max(setback[line.lane], town.lanes.length[line.lane] - line.paint_u)
    return setback, rank


def _other_sides(town: TownMap) -> NDArray[np.float64]:
    """`conflict_u` of the same meeting as the other lane has it; its whole length where it does not list it."""
    lanes = town.lanes
    owner = np.repeat(np.arange(len(lanes)), np.diff(lanes.conflict_first))
    entry = {(a, b): k for k, (a, b) in enumerate(zip(owner.tolist(), lanes.conflict.tolist(), strict=True))}
    back = np.zeros((len(owner), 2))
    for k, (a, b) in enumerate(zip(owner.tolist(), lanes.conflict.tolist(), strict=True)):
        other = entry.get((b, a), -1)
        back[k] = lanes.conflict_u[other] if other >= 0 else (0.0, lanes.length[b])
    return back


def _merges(town: TownMap) -> NDArray[np.bool_]:
    lanes = town.lanes
    owner = np.repeat(np.arange(len(lanes)), np.diff(lanes.conflict_first))
    return np.array(
        [
            bool(np.isin(lanes.successors(a), lanes.successors(b)).any())
            for a, b in zip(owner.tolist(), lanes.conflict.tolist(), strict=True)
        ],
        dtype=np.bool_,
    )


def _oncoming_lanes(town: TownMap) -> NDArray[np.int32]:
    """The lane beyond the centre line where that is broken all along the section."""
    table = town.lanes
    opposite = np.full(len(table), -1, np.int32)
    driving = np.flatnonzero((table.type == LaneType.DRIVING) & (table.junction < 0) & (np.abs(table.lane_id) == 1))
    at = {(int(table.road_id[k]), int(table.section[k]), int(table.lane_id[k])): int(k) for k in driving}
    sections = {(road.id, k): section for road in town.network.roads for k, section in enumerate(road.sections)}
    for (road, section, lane_id), lane in at.items():
        other = at.get((road, section, -lane_id), -1)
        centre = next((record for record in sections[road, section].lanes if record.id == 0), None)
        if other >= 0 and centre is not None and centre.marks and all(m.kind == "broken" for m in centre.marks):
            opposite[lane] = other
    return opposite


def _meetings(town: TownMap) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    lanes = town.lanes
    start, end = np.zeros(len(lanes), np.bool_), np.zeros(len(lanes), np.bool_)
    for lane in np.flatnonzero(lanes.type == LaneType.DRIVING).tolist():
        before, after = lanes.predecessors(lane), lanes.successors(lane)
        start[lane] = len(before) > 1 or bool((lanes.junction[before] >= 0).any())
        end[lane] = len(after) > 1 or any(lanes.junction[k] >= 0 or len(lanes.predecessors(k)) > 1 for k in after)
    return start, end


@kernel
def fill_bends(
    first: NDArray[np.int32], step: NDArray[np.float64], points: NDArray[np.float64], bend: NDArray[np.float64]
) -> None:
    """Works `Lanes.bend` out, from the end of each lane back."""
    for lane in range(len(step)):
        ahead = np.inf
        for p in range(first[lane + 1] - 1, first[lane] - 1, -1):
            here = LATERAL_ACCELERATION / max(abs(points[p, 4]), 1e-4)
            ahead = min(here, ahead + 2.0 * SLOWING * step[lane])
            bend[p] = ahead


@kernel
def lane_point(lanes: Lanes, lane: int, u: float) -> tuple[float, float, float, float]:
    """x, y [m], heading [rad] and curvature [1/m] of a lane centre at `u`."""
    first, last = lanes.first[lane], lanes.first[lane + 1] - 1
    at = min(max(u / lanes.step[lane], 0.0), float(last - first))
    k = min(first + int(at), max(last - 1, first))
    share = at - (k - first)
    a, b = lanes.points[k], lanes.points[min(k + 1, last)]
    return (
        a[0] + (b[0] - a[0]) * share,
        a[1] + (b[1] - a[1]) * share,
        a[3] + (b[3] - a[3]) * share,
        a[4] + (b[4] - a[4]) * share,
    )


@kernel
def lane_height(lanes: Lanes, lane: int, u: float) -> float:
    """z of a lane centre at `u` [m]."""
    first, last = lanes.first[lane], lanes.first[lane + 1] - 1
    at = min(max(u / lanes.step[lane], 0.0), float(last - first))
    k = min(first + int(at), max(last - 1, first))
    return lanes.points[k, 2] + (lanes.points[min(k + 1, last), 2] - lanes.points[k, 2]) * (at - (k - first))


@kernel
def project(lanes: Lanes, lane: int, u: float, x: float, y: float) -> tuple[float, float, float]:
    """Moves `u` along a lane to beside (x, y); returns it, the offset to the right [m] and the lane's heading [rad].

    The result may lie beyond the lane's ends by what the point is ahead of or behind them.
    """
    px, py, yaw, _curvature = lane_point(lanes, lane, u)
    dx, dy = x - px, y - py
    cos, sin = cos_sin(yaw)
    return min(max(u, 0.0), lanes.length[lane]) + dx * cos + dy * sin, dy * cos - dx * sin, yaw


@kernel
def settle(lanes: Lanes, lane: int, u: float, x: float, y: float) -> tuple[float, float, float]:
    """As `project`, from a `u` that may be several metres off (past a bend, lanes side by side differ by that)."""
    offset, yaw = 0.0, 0.0
    for _ in range(2):
        u, offset, yaw = project(lanes, lane, u, x, y)
    return u, offset, yaw


@kernel
def settle_beside(lanes: Lanes, lane: int, u: float, other: int, x: float, y: float) -> tuple[float, float, float]:
    """Where (x, y), which is at `u` along `lane`, is along the lane `other` beside it; results as of `project`."""
    return settle(lanes, other, u * lanes.length[other] / lanes.length[lane], x, y)


@kernel
def point_row(lanes: Lanes, lane: int, u: float) -> int:
    """Row of the centre point of a lane nearest below `u`."""
    last = lanes.first[lane + 1] - 1
    return min(max(lanes.first[lane] + int(u / lanes.step[lane]), lanes.first[lane]), last)
