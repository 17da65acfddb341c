"""Where walkers get across a road: crosswalks of the map joined to the sidewalks, and places for jaywalkers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lavsim.geometry import forward, right, wrap_angle
from lavsim.map.footway_strips import Strip, point_tree
from lavsim.map.lane import CLEAR_HEIGHT, DRIVABLE, LaneTable
from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

REACH = 9.0  # [m] from the end of a crosswalk to the middle of its sidewalk
BEFORE_KERB = 0.35  # [m] from who waits to the end of the crosswalk
CLEAR_OF_LANE = 0.65  # [m] from who waits to the edge of a driven lane, at least
SWEPT = 1.3  # [m] half of what a car takes beside its lane's centre, with a margin
NEAR_LINE = 15.0  # [m] between a crosswalk and the junction whose lights stop the traffic before it
SPACING = 0.25  # [m] at which a way across is looked at

JAYWALK_EVERY = 25.0  # [m] between places where a road may be crossed anywhere
JAYWALK_OFF_ENDS = 14.0  # [m] of them from junctions and crosswalks
JAYWALK_WIDEST = 24.0  # [m] from sidewalk to sidewalk
JAYWALK_HALF = 0.7  # [m] half width of the way
JAYWALK_FASTEST = 61.0 / 3.6  # [m/s] limit of roads that people cross anywhere


@dataclass(frozen=True)
class Crossed:
    """A driving lane that a way across leads over.

    Attributes:
        lane: Its number.
        low, high: Travelled length on it between which vehicles meet the walkers [m].
        enter, leave: Along the way across, between which walkers are in the vehicles' way [m].
        light: The light that stops its traffic right before the crosswalk, -1.
    """

    lane: int
    low: float
    high: float
    enter: float
    leave: float
    light: int


@dataclass(frozen=True)
class Spine:
    """A way across.

    Attributes:
        points: (4, 3) from the middle of one sidewalk over its kerb and the other kerb to the other sidewalk [m].
        half: Half its width [m].
        ends: Strip and number of its point, on either side.
        kerb: Along the way: where to wait on either side [m].
        crossed: Lanes in order of the table.
        is_marked: Whether it is a crosswalk.
    """

    points: Floats
    half: float
    ends: tuple[tuple[int, int], tuple[int, int]]
    kerb: tuple[float, float]
    crossed: tuple[Crossed, ...]
    is_marked: bool


class DrivenLanes:
    """Points of all driving lanes, to find those that a way leads over."""

    def __init__(self, town: TownMap) -> None:
        self.town = town
        lanes = town.lanes
        driven = np.flatnonzero((lanes.type & DRIVABLE) > 0)
        counts = lanes.first[driven + 1] - lanes.first[driven]
        self.lane = np.repeat(driven, counts)
        self.row = np.concatenate([np.arange(lanes.first[k], lanes.first[k + 1]) for k in driven])
        self.points = lanes.points[self.row]
        self.u = (self.row - lanes.first[self.lane]) * lanes.step[self.lane]
        self.tree = cKDTree(self.points[:, :2])
        self.lines = {line.lane: (light.index, line.paint_u) for light in town.lights for line in light.stop_lines}

    def clearance(self, points: Floats) -> Floats:
        """From each of `points` (n, 3) to the edge of the nearest driven lane [m]; negative on it."""
        hits = self.town.nearest(points, DRIVABLE)
        return np.where(hits.lane >= 0, hits.distance - hits.width / 2.0, np.inf)

    def crossed(self, start: Floats, end: Floats, offset: float, half: float) -> tuple[Crossed, ...]:
        """Lanes between the kerbs `start` and `end` (3,), which lie `offset` [m] along the way."""
        lanes = self.town.lanes
        length = float(np.hypot(*(end - start)[:2]))
        axis = (end - start)[:2] / max(length, 1e-9)
        middle = (start + end)[:2] / 2.0
        near = np.array(sorted(self.tree.query_ball_point(middle, length / 2.0 + half + 4.0)), np.int64)
        if not len(near):
            return ()
        local = self.points[near, :2] - start[:2]
        along, aside = local @ axis, local @ np.array([-axis[1], axis[0]])
        z = start[2] + (end - start)[2] * np.clip(along / max(length, 1e-9), 0.0, 1.0)
        inside = (along > -0.5) & (along < length + 0.5) & (np.abs(aside) < half + 1.0)
        inside &= np.abs(self.points[near, 2] - z) < CLEAR_HEIGHT
        found = []
        for lane in np.unique(self.lane[near[inside]]).tolist():
            here = inside & (self.lane[near] == lane)
            u, way = self.u[near[here]], along[here]
            low, high = float(u.min()), float(u.max())
            enter = offset + max(float(way.min()) - SWEPT, 0.0)
            leave = offset + min(float(way.max()) + SWEPT, length)
            found.append(Crossed(lane, low, high, enter, leave, self._light(lanes, lane, low, high)))
        return tuple(found)

    def _light(self, lanes: LaneTable, lane: int, low: float, high: float) -> int:
        """The light whose stop line lies before the crosswalk on this lane."""
        length = float(lanes.length[lane])
        if lanes.junction[lane] >= 0:
            return int(lanes.light[lane]) if low + high < length else -1
        light, _ = self.lines.get(lane, (-1, 0.0))
        return light if length - high < NEAR_LINE else -1


def crosswalk_spines(town: TownMap, strips: list[Strip], driven: DrivenLanes) -> list[Spine]:
    """Crosswalks that have a sidewalk at either end."""
    if not strips or not town.crosswalks:
        return []
    tree, owner, number = point_tree([Strip(_flat(strip.points), strip.half) for strip in strips])
    found = []
    for polygon in town.crosswalks:
        first, second, half = _crossing_axis(np.asarray(polygon), driven)
        ends = [_sidewalk_at(strips, tree, owner, number, a, b) for a, b in ((first, second), (second, first))]
        if ends[0] is None or ends[1] is None or ends[0] == ends[1]:
            continue
        a, b = (strips[strip].points[point] for strip, point in ends)  # type: ignore[misc]
        if abs(a[2] - b[2]) > CLEAR_HEIGHT:
            continue
        found.append(_spine(driven, (a, b), (first, second), half, (ends[0], ends[1]), True))
    return found


def _flat(points: Floats) -> Floats:
    flat = points.copy()
    flat[:, 2] = 0.0
    return flat


def _crossing_axis(polygon: Floats, driven: DrivenLanes) -> tuple[Floats, Floats, float]:
    """The ends (2,) of a crosswalk at the kerbs and half its width, from its outline."""
    box = shapely.Polygon(polygon[:, :2]).minimum_rotated_rectangle
    corners = np.asarray(shapely.get_coordinates(box))[:4]
    centre = corners.mean(axis=0)
    sides = np.array([corners[1] - corners[0], corners[2] - corners[1]])
    lengths = np.hypot(*sides.T)
    long = int(np.argmax(lengths))
    if lengths[long] < 2.0 * lengths[1 - long]:  # not much longer than wide: the traffic tells
        near = np.array(driven.tree.query_ball_point(centre, float(lengths.min()) / 2.0 + 1.0), np.int64)
        yaw = driven.points[near, 3] if len(near) else np.zeros(0)
        ways = np.abs(forward(yaw) @ (sides / lengths[:, None]).T).sum(axis=0)
        long = int(np.argmin(ways)) if len(near) else long
    half = sides[long] / 2.0
    return centre - half, centre + half, float(lengths[1 - long]) / 2.0


def _sidewalk_at(
    strips: list[Strip], tree: cKDTree, owner: NDArray[np.int64], number: NDArray[np.int64], end: Floats, other: Floats
) -> tuple[int, int] | None:
    """Strip and point on which a crosswalk ends that comes from `other`."""
    out = (end - other) / max(float(np.hypot(*(end - other))), 1e-9)
    near = sorted(tree.query_ball_point([*end, 0.0], REACH))
    best, cost = None, np.inf
    for k in near:
        strip, point = int(owner[k]), int(number[k])
        gap = strips[strip].points[point, :2] - end
        ahead = float(gap @ out)
        aside = abs(float(gap @ np.array([-out[1], out[0]])))
        price = float(np.hypot(*gap)) + aside  # straight on rather than round a corner
        if ahead > -1.5 and aside < max(0.7 * abs(ahead), 1.5) and price < cost:
            best, cost = (strip, point), price
    return best


def _spine(
    driven: DrivenLanes,
    ends: tuple[Floats, Floats],
    kerbs: tuple[Floats, Floats],
    half: float,
    places: tuple[tuple[int, int], tuple[int, int]] | tuple[tuple[int, int] | None, tuple[int, int] | None],
    is_marked: bool,
) -> Spine:
    """The way over two points at the kerbs, with the places to wait off the driven lanes."""
    a, b = ends
    total = float(np.hypot(*(b - a)[:2]))
    z = [a[2] + (b[2] - a[2]) * float(np.hypot(*(k - a[:2]))) / max(total, 1e-9) for k in kerbs]
    points = np.array([a, [*kerbs[0], z[0]], [*kerbs[1], z[1]], b])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))])
    at = np.append(np.arange(0.0, along[-1], SPACING), along[-1])
    line = np.column_stack([np.interp(at, along, points[:, k]) for k in range(3)])
    close = np.flatnonzero(driven.clearance(line) < CLEAR_OF_LANE)
    first, last = (at[close[0]] - SPACING, at[close[-1]] + SPACING) if len(close) else (along[1], along[2])
    low = max(min(along[1] - BEFORE_KERB, first), 0.05)
    high = min(max(along[2] + BEFORE_KERB, last), along[-1] - 0.05)
    place = [np.array([np.interp(u, along, points[:, k]) for k in range(3)]) for u in (low, high)]
    crossed = driven.crossed(place[0], place[1], low, half)
    return Spine(points, half, places, (float(low), float(high)), crossed, is_marked)  # type: ignore[arg-type]


def jaywalk_spines(town: TownMap, strips: list[Strip], driven: DrivenLanes, crosswalks: list[Spine]) -> list[Spine]:
    """Ways straight across the road away from junctions and crosswalks, each once."""
    if not strips:
        return []
    lanes = town.lanes
    tree, owner, number = point_tree(strips)
    marked = [spine.points[1:3, :2].mean(axis=0) for spine in crosswalks]
    crosswalk_tree = cKDTree(np.array(marked).reshape(-1, 2)) if marked else None
    found = []
    for k, strip in enumerate(strips):
        if strip.lane < 0 or lanes.junction[strip.lane] >= 0:
            continue
        count = int((strip.length - 2.0 * JAYWALK_OFF_ENDS) // JAYWALK_EVERY) + 1
        if strip.length < 2.0 * JAYWALK_OFF_ENDS:
            continue
        share = (JAYWALK_OFF_ENDS + JAYWALK_EVERY * np.arange(count)) / strip.length
        for point in np.rint(share * (len(strip.points) - 1)).astype(int).tolist():
            place = strip.points[point]
            if crosswalk_tree is not None and crosswalk_tree.query(place[:2])[0] < JAYWALK_OFF_ENDS:
                continue
            other = _opposite(town, strips, tree, owner, number, k, point)
            if other is not None:
                spine = _straight_across(driven, strips, (k, point), other)
                if _is_crossable(town, spine):
                    found.append(spine)
    return found


def _opposite(
    town: TownMap,
    strips: list[Strip],
    tree: cKDTree,
    owner: NDArray[np.int64],
    number: NDArray[np.int64],
    strip: int,
    point: int,
) -> tuple[int, int] | None:
    """The sidewalk across the road from a place on another; None if there is none of a later number."""
    points = strips[strip].points
    ahead = points[min(point + 1, len(points) - 1), :2] - points[max(point - 1, 0), :2]
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    lane = strips[strip].lane
    keeps_left = (town.lanes.lane_id[lane] > 0) == town.lanes.runs_forward(lane)
    across = right(yaw) * (1.0 if keeps_left else -1.0)
    for distance in np.arange(4.0, JAYWALK_WIDEST, 0.5):
        place = [*(points[point, :2] + across * distance), points[point, 2]]
        gap, hit = tree.query(place)
        other, at = int(owner[hit]), int(number[hit])
        if gap < 0.5 and other != strip:
            line = strips[other].points
            way = line[min(at + 1, len(line) - 1), :2] - line[max(at - 1, 0), :2]
            turned = abs(float(wrap_angle(np.arctan2(way[1], way[0]) - yaw)))
            is_inside = 10 < at < len(line) - 10 and town.lanes.junction[strips[other].lane] < 0
            is_parallel = min(turned, np.pi - turned) < 0.3
            return (other, at) if other > strip and is_inside and is_parallel else None
    return None


def _straight_across(driven: DrivenLanes, strips: list[Strip], start: tuple[int, int], end: tuple[int, int]) -> Spine:
    (k, i), (m, j) = start, end
    a, b = strips[k].points[i], strips[m].points[j]
    axis = (b - a)[:2] / max(float(np.hypot(*(b - a)[:2])), 1e-9)
    kerbs = (a[:2] + axis * float(strips[k].half[i]), b[:2] - axis * float(strips[m].half[j]))
    return _spine(driven, (a, b), kerbs, JAYWALK_HALF, (start, end), False)


def _is_crossable(town: TownMap, spine: Spine) -> bool:
    """Whether people cross there: over some lanes, none of a junction, none fast."""
    lanes = [crossed.lane for crossed in spine.crossed]
    return bool(lanes) and all(
        town.lanes.junction[k] < 0 and town.lanes.speed_limit[k] < JAYWALK_FASTEST for k in lanes
    )
