"""Where people walk: the sidewalks of a town, round its corners and across its roads, as a graph.

From the map alone. Towns without sidewalks give a graph without nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lavsim.map.footway_crossings import Crossed, DrivenLanes, Spine, crosswalk_spines, jaywalk_spines
from lavsim.map.footway_strips import JOIN, LEVEL, Strip, links, point_tree, sidewalk_strips
from lavsim.map.town_map import TownMap
from lavsim.portable_math import snapped

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

STEP = 1.0  # [m] most between points of a sidewalk
CROSSING_STEP = 0.5  # [m] the same on ways across
SNAP = 1.2  # [m] places nearer than this along a sidewalk are one node
NO_LANES = np.zeros(0, np.int32)


class FootwayKind(IntEnum):
    """What an edge is."""

    SIDEWALK = 0
    CROSSING = 1
    JAYWALK = 2  # straight across the road where there is no crosswalk


@dataclass(frozen=True, eq=False)
class Footways:
    """The walkable network of a town: N nodes, E edges, P points of edges, K lanes crossed.

    Attributes:
        nodes: (N, 3) x, y, z [m].
        node_first, node_edge: compressed rows: edges at node n are node_edge[node_first[n]:node_first[n+1]].
        ends: (E, 2) int32, node where an edge begins and where it ends.
        kind: (E,) int8, `FootwayKind`.
        length: (E,) [m].
        first: (E+1,) int32; points of edge e are rows first[e] … first[e+1]-1.
        step: (E,) their spacing [m], uniform within an edge.
        points: (P, 5) x, y, z [m], yaw [rad, unwrapped within an edge], half width [m].
        kerb: (E, 2) along an edge that crosses a road: where to wait on either side [m]; 0 and length of sidewalks.
        crossed_first: (E+1,) int32; lanes that edge e crosses are rows crossed_first[e] … of the next four.
        crossed_lane: (K,) int32, driving lane.
        crossed_u: (K, 2) travelled length on the lane between which its vehicles meet the walkers [m].
        crossed_way: (K, 2) along the edge, between which walkers are in the vehicles' way [m].
        crossed_light: (K,) int32, light that stops the lane's traffic right before the crosswalk, or -1.
        part: (N,) int32, connected part by crosswalks and sidewalks; part 0 has the most sidewalk.
    """

    nodes: Floats
    node_first: Ints
    node_edge: Ints
    ends: Ints
    kind: NDArray[np.int8]
    length: Floats
    first: Ints
    step: Floats
    points: Floats
    kerb: Floats
    crossed_first: Ints
    crossed_lane: Ints
    crossed_u: Floats
    crossed_way: Floats
    crossed_light: Ints
    part: Ints

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.flags.writeable = False

    def __len__(self) -> int:
        return len(self.kind)

    def line(self, edge: int) -> Floats:
        """Points (n, 5) of an edge."""
        return self.points[self.first[edge] : self.first[edge + 1]]

    def edges_at(self, node: int) -> Ints:
        """Edges that begin or end at a node; a loop twice."""
        return self.node_edge[self.node_first[node] : self.node_first[node + 1]]

    def lights(self, edge: int) -> list[int]:
        """Lights for whose traffic an edge is the crosswalk before the junction."""
        rows = slice(self.crossed_first[edge], self.crossed_first[edge + 1])
        return sorted({int(light) for light in self.crossed_light[rows] if light >= 0})

    def where(self, kind: FootwayKind) -> NDArray[np.int64]:
        """Edges of a kind."""
        return np.flatnonzero(self.kind == kind)

    @property
    def reachable(self) -> float:
        """Share of the sidewalks' length in the largest connected part."""
        sidewalks = self.where(FootwayKind.SIDEWALK)
        total = float(self.length[sidewalks].sum())
        largest = self.part[self.ends[sidewalks, 0]] == 0
        return float(self.length[sidewalks][largest].sum()) / total if total > 0.0 else 1.0


@lru_cache(maxsize=16)
def get_footways(town: TownMap) -> Footways:
    """The walkable network of a town, made once a process."""
    strips = sidewalk_strips(town)
    strips += [strip for _, _, strip in links(strips, town)]
    graph = _Graph(strips)
    if strips:
        driven = DrivenLanes(town)
        crosswalks = crosswalk_spines(town, strips, driven)
        for spine in crosswalks + jaywalk_spines(town, strips, driven, crosswalks):
            graph.spines.append(spine)
    return graph.build()


class _Graph:
    """Cuts strips where others meet them, and numbers what comes of it."""

    def __init__(self, strips: list[Strip]) -> None:
        self.strips = strips
        self.spines: list[Spine] = []
        self.edges: list[tuple[int, int, FootwayKind, Floats, tuple[float, float], tuple[Crossed, ...]]] = []

    def build(self) -> Footways:
        cuts: list[dict[int, int]] = [{} for _ in self.strips]
        places: list[Floats] = []
        self._cut_ends(cuts, places)
        self._cut_meetings(cuts, places)
        attached = [
            tuple(self._cut(cuts[strip], strip, point, places) for strip, point in spine.ends) for spine in self.spines
        ]
        for strip, cut in zip(self.strips, cuts, strict=True):
            for low, high in pairwise(sorted(cut)):
                line = np.column_stack([strip.points[low : high + 1], strip.half[low : high + 1]])
                self._add(cut[low], cut[high], FootwayKind.SIDEWALK, line, places)
        for spine, (a, b) in zip(self.spines, attached, strict=True):
            if a != b:
                kind = FootwayKind.CROSSING if spine.is_marked else FootwayKind.JAYWALK
                line = np.column_stack([spine.points, np.full(4, spine.half)])
                self._add(a, b, kind, line, places, spine)
        return self._pack(np.array(places).reshape(-1, 3))

    def _cut_ends(self, cuts: list[dict[int, int]], places: list[Floats]) -> None:
        """Makes nodes of the strips' ends; those near each other are one."""
        ends = np.array([strip.points[-end] for strip in self.strips for end in (0, 1)]).reshape(-1, 3)
        if not len(ends):
            return
        pairs = cKDTree(ends).query_pairs(JOIN, output_type="ndarray")
        pairs = pairs[np.abs(ends[pairs[:, 0], 2] - ends[pairs[:, 1], 2]) < LEVEL]
        matrix = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(ends), len(ends)))
        count, label = connected_components(matrix, directed=False)
        places += [ends[label == k].mean(axis=0) for k in range(count)]
        for k, strip in enumerate(self.strips):
            cuts[k][0], cuts[k][len(strip.points) - 1] = int(label[2 * k]), int(label[2 * k + 1])

    def _cut_meetings(self, cuts: list[dict[int, int]], places: list[Floats]) -> None:
        """Joins loose ends to the strip on which they lie."""
        if not self.strips:
            return
        uses = np.bincount([node for cut in cuts for node in cut.values()], minlength=len(places))
        tree, owner, number = point_tree(self.strips)
        widest = max(float(strip.half.max()) for strip in self.strips)
        for k in range(len(self.strips)):
            for end in (0, 1):
                strip = self.strips[k]
                node = cuts[k][0 if end == 0 else len(strip.points) - 1]
                if uses[node] > 1:
                    continue
                near = np.array(sorted(tree.query_ball_point(strip.points[-end], widest + 1.0)), np.int64)
                near = near[owner[near] != k]
                gaps = np.hypot(*(self._points(owner, number, near) - strip.points[-end, :2]).T)
                reach = np.array([self.strips[owner[p]].half[number[p]] for p in near]) + 0.5
                near, gaps = near[gaps < reach], gaps[gaps < reach]
                if len(near):
                    hit = near[int(np.argmin(gaps))]
                    self._meet(cuts, places, node, (int(owner[hit]), int(number[hit])), float(strip.half[-end]))

    def _points(self, owner: NDArray[np.int64], number: NDArray[np.int64], near: NDArray[np.int64]) -> Floats:
        return np.array([self.strips[owner[p]].points[number[p], :2] for p in near]).reshape(-1, 2)

    def _meet(
        self, cuts: list[dict[int, int]], places: list[Floats], node: int, hit: tuple[int, int], half: float
    ) -> None:
        other = self._cut(cuts[hit[0]], hit[0], hit[1], places)
        if other == node:
            return
        line = np.column_stack([np.array([places[node], places[other]]), np.full(2, half)])
        if float(np.hypot(*(line[1] - line[0])[:2])) > 0.05:
            self._add(node, other, FootwayKind.SIDEWALK, line, places)

    def _cut(self, cut: dict[int, int], strip: int, point: int, places: list[Floats]) -> int:
        """The node at a point of a strip; one that is there already if it is near."""
        points = self.strips[strip].points
        nearest = min(cut, key=lambda k: (abs(k - point), k))
        low, high = min(nearest, point), max(nearest, point)
        if float(np.hypot(*np.diff(points[low : high + 1, :2], axis=0).T).sum()) < SNAP:
            return cut[nearest]
        cut[point] = len(places)
        places.append(points[point].copy())
        return cut[point]

    def _add(
        self, a: int, b: int, kind: FootwayKind, line: Floats, places: list[Floats], spine: Spine | None = None
    ) -> None:
        line = line.copy()
        line[0, :3], line[-1, :3] = places[a], places[b]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
        step = STEP if kind == FootwayKind.SIDEWALK else CROSSING_STEP
        at = np.linspace(0.0, along[-1], max(1, int(np.ceil(along[-1] / step - 1e-9))) + 1)
        even = np.column_stack([np.interp(at, along, line[:, k]) for k in range(4)])
        chords = np.diff(even[:, :2], axis=0)
        if along[-1] < 1e-3:
            return
        yaw = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
        middle = np.concatenate([yaw[:1], (yaw[1:] + yaw[:-1]) / 2.0, yaw[-1:]])
        points = np.column_stack([even[:, :3], middle, even[:, 3]])
        kerb = spine.kerb if spine else (0.0, float(along[-1]))
        self.edges.append((a, b, kind, points, kerb, spine.crossed if spine else ()))

    def _pack(self, nodes: Floats) -> Footways:
        edges = self.edges
        ends = np.array([edge[:2] for edge in edges], np.int32).reshape(-1, 2)
        sizes = np.array([len(edge[3]) for edge in edges], np.int64)
        first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
        points = snapped(np.concatenate([edge[3] for edge in edges])) if edges else np.zeros((0, 5))
        length = snapped(np.array([np.hypot(*np.diff(edge[3][:, :2], axis=0).T).sum() for edge in edges]))
        at = np.argsort(ends.ravel(), kind="stable")
        crossed = [lane for edge in edges for lane in edge[5]]
        kind = np.array([edge[2] for edge in edges], np.int8)
        return Footways(
            nodes=snapped(nodes),
            node_first=np.searchsorted(ends.ravel()[at], np.arange(len(nodes) + 1)).astype(np.int32),
            node_edge=(at // 2).astype(np.int32),
            ends=ends,
            kind=kind,
            length=length,
            first=first,
            step=length / np.maximum(sizes - 1, 1),
            points=points,
            kerb=snapped(np.array([edge[4] for edge in edges]).reshape(-1, 2)),
            crossed_first=np.cumsum([0, *(len(edge[5]) for edge in edges)]).astype(np.int32),
            crossed_lane=np.array([lane.lane for lane in crossed], np.int32),
            crossed_u=snapped(np.array([(lane.low, lane.high) for lane in crossed]).reshape(-1, 2)),
            crossed_way=snapped(np.array([(lane.enter, lane.leave) for lane in crossed]).reshape(-1, 2)),
            crossed_light=np.array([lane.light for lane in crossed], np.int32),
            part=_parts(len(nodes), ends, kind, length),
        )


def _parts(count: int, ends: Ints, kind: NDArray[np.int8], length: Floats) -> Ints:
    """Connected parts, numbered by falling length of their sidewalks."""
    if not count:
        return NO_LANES
    open_to_all = ends[kind != FootwayKind.JAYWALK]
    matrix = coo_array((np.ones(len(open_to_all)), open_to_all.T), shape=(count, count))
    parts, label = connected_components(matrix, directed=False)
    sidewalk = kind == FootwayKind.SIDEWALK
    weight = np.bincount(label[ends[sidewalk, 0]], length[sidewalk], minlength=parts)
    rank = np.empty(parts, np.int32)
    rank[np.argsort(-weight, kind="stable")] = np.arange(parts)
    return rank[label]
