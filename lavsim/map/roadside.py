"""Where things may stand beside the roads of a town: the outer edges of its streets, and the ground to be kept free."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from lavsim.geometry import right
from lavsim.map.lane import DRIVABLE
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType

Floats = NDArray[np.float64]
Shapes = NDArray[np.object_]

PIECE = 40  # points of a lane in one shape: with short shapes the search tree's boxes stay small


@dataclass(frozen=True)
class Edge:
    """The outer edge of a road, from which everything is set back.

    Attributes:
        points: (n, 2) along the edge [m].
        outward: (n, 2) unit vectors away from the road.
        z: (n,) height [m].
        along: (n,) length along the edge [m].
        urban: Whether the edge is a sidewalk's.
        speed: Limit of the lanes on its side [m/s].
        lanes: Driving lanes on its side.
        key: Road id and side, which name its draws.
    """

    points: Floats
    outward: Floats
    z: Floats
    along: Floats
    urban: bool
    speed: float
    lanes: int
    key: tuple[int, int]

    @property
    def length(self) -> float:
        return float(self.along[-1])

    def at(self, where: float) -> tuple[Floats, Floats, float]:
        """Point, outward normal and height at a length along the edge."""
        row = min(max(int(np.searchsorted(self.along, where)), 0), len(self.along) - 1)
        return self.points[row], self.outward[row], float(self.z[row])

    def strip(self, begin: float, end: float, back: float, thickness: float) -> tuple[Floats, float]:
        """Footprint (4, 2) of a thin thing along the edge, `back` metres behind it, and the height there."""
        (a, out_a, z), (b, out_b, _) = self.at(begin), self.at(end)
        near, far = back, back + thickness
        return np.array([a + out_a * near, b + out_b * near, b + out_b * far, a + out_a * far]), z

    def pieces(self, begin: float, end: float, longest: float) -> list[tuple[float, float]]:
        """Parts of the edge that chords may stand for: at most `longest`, short in bends."""
        low, high = np.searchsorted(self.along, [begin, end])
        yaw = np.unwrap(np.arctan2(self.outward[low:high, 1], self.outward[low:high, 0]))
        turned = float(np.abs(np.diff(yaw)).sum()) if len(yaw) > 1 else 0.0
        count = max(1, int(np.ceil((end - begin) / longest)), int(np.ceil(turned / 0.12)))
        marks = np.linspace(begin, end, count + 1).tolist()
        return list(pairwise(marks))


def quads(corners: Floats) -> Shapes:
    """Polygons of footprints (n, m, 2)."""
    return np.asarray(shapely.polygons(corners), np.object_) if len(corners) else np.zeros(0, np.object_)


def lane_pieces(town: TownMap) -> tuple[Shapes, NDArray[np.int64]]:
    """Every lane of any width as short polygons, and the lane of each."""
    lanes = town.lanes
    half = lanes.width[:, None] / 2.0
    aside = right(lanes.points[:, 3]) * half
    left_edge, right_edge = lanes.points[:, :2] - aside, lanes.points[:, :2] + aside
    widest = np.maximum.reduceat(lanes.width, lanes.first[:-1])
    rings: list[Floats] = []
    owner: list[int] = []
    ring_of: list[NDArray[np.int64]] = []
    for lane in np.flatnonzero(widest >= 0.05).tolist():
        first, last = int(lanes.first[lane]), int(lanes.first[lane + 1]) - 1
        for k in range(first, last, PIECE):
            end = min(k + PIECE, last) + 1
            ring = np.concatenate([left_edge[k:end], right_edge[k:end][::-1]])
            ring_of.append(np.full(len(ring), len(owner)))
            rings.append(ring)
            owner.append(lane)
    shapes = np.asarray(shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=np.concatenate(ring_of))))
    crossed = ~shapely.is_valid(shapes)  # the inner edge of a bend tighter than the lane is wide
    shapes[crossed] = shapely.make_valid(shapes[crossed])
    return shapes, np.array(owner)


class Ground:
    """Where nothing may stand."""

    def __init__(self, town: TownMap) -> None:
        shapes, owner = lane_pieces(town)
        lanes = town.lanes
        self.lanes = shapely.STRtree(shapes)
        self.junctions = shapely.STRtree(shapes[(lanes.junction[owner] >= 0) & ((lanes.type[owner] & DRIVABLE) > 0)])

    def near_lanes(self, shapes: Shapes, distance: float) -> NDArray[np.bool_]:
        """Whether each of `shapes` comes within `distance` of a lane of any kind."""
        return near(self.lanes, shapes, distance)

    def near_junctions(self, shapes: Shapes, distance: float) -> NDArray[np.bool_]:
        """Whether each of `shapes` comes within `distance` of a driven junction lane."""
        return near(self.junctions, shapes, distance)


def near(tree: shapely.STRtree, shapes: Shapes, distance: float) -> NDArray[np.bool_]:
    """Whether each of `shapes` comes within `distance` of anything in `tree`."""
    mask = np.zeros(len(shapes), np.bool_)
    if len(shapes) and len(tree.geometries):
        mask[np.unique(tree.query(shapes, predicate="dwithin", distance=distance)[0])] = True
    return mask


def edges_of(town: TownMap) -> list[Edge]:
    """Outer edges of all roads outside junctions, where traffic passes."""
    lanes = town.lanes
    groups: dict[tuple[int, int], list[int]] = {}
    for lane in np.flatnonzero(lanes.junction < 0).tolist():
        groups.setdefault((int(lanes.road_id[lane]), int(lanes.section[lane])), []).append(lane)
    widest = np.maximum.reduceat(lanes.width, lanes.first[:-1])
    edges = []
    for (road, _), members in groups.items():
        if not (lanes.type[members] & DRIVABLE).any():
            continue
        for side in (-1, 1):
            outer = sorted(
                (k for k in members if np.sign(lanes.lane_id[k]) == side), key=lambda k: abs(int(lanes.lane_id[k]))
            )
            while outer and widest[outer[-1]] < 0.05:
                outer.pop()
            if not outer:
                continue
            lane = outer[-1]
            points, half = lanes.centre_line(lane), lanes.width[lanes.rows(lane), None] / 2.0
            away = right(points[:, 3])  # travel has its outer edge to the right, on either side of the road
            border = points[:, :2] + away * half
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(border, axis=0).T))])
            driving = [k for k in outer if lanes.type[k] == LaneType.DRIVING]
            speed = max((float(lanes.speed_limit[k]) for k in driving), default=0.0)
            urban = bool(lanes.type[lane] & LaneType.SIDEWALK)
            edges.append(Edge(border, away, points[:, 2], along, urban, speed, len(driving), (road, side)))
    return edges
