"""CARLA's global route planner on our lanes: shortest way, commands at junctions, lane changes.

This reproduces CARLA's `agents/navigation/global_route_planner.py` (0.9.10 to today) as the leaderboard's
`interpolate_trajectory` calls it, its oddities included, because a route's length and commands are part of a score:

- Nodes of the graph are ends of lanes rounded to whole metres, so what lies within a metre may fall together.
- An edge costs its number of path points plus one, while the A* heuristic is in metres between rounded places. With
  points 1 m apart or more it may overestimate, and then the way found is not the shortest: a key point on a route can
  lead the rest of it elsewhere.
- A change of lane costs nothing and is only possible where a lane begins.
- The decision at a crossing is remembered from one pair of key points to the next; a key point inside a junction leaves
  the rest of that crossing, and sometimes the next one, without a command.
- A search starts where the lane of the first key point begins and may take another branch from there.

One thing CARLA leaves to chance: which of the lanes of a junction that run over each other a key point belongs to. Here
it is the one that makes the way from the key point before to the one after it shortest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.errors import RouteError
from lavsim.map.carla_order import followers_in_order, lanes_in_order, single_precision_points
from lavsim.map.lane import CHANGE_LEFT, CHANGE_RIGHT
from lavsim.map.route import Route, polyline_length
from lavsim.map.town_map import TownMap
from lavsim.map.turns import turn_decision
from lavsim.map.waypoint import Waypoint
from lavsim.types import LaneType, RoadOption

Floats = NDArray[np.float64]
Node = int
Place = tuple[float, float, float]

RESOLUTION = 1.0  # [m] hop of the leaderboard's dense routes
MAX_OFF_ROAD = 10.0  # [m] a key point farther from any driving lane is a mistake in the route file
TIE = 5e-4  # [m] lanes of a junction whose distances differ by less are equally near
CHANGE_AHEAD = 5  # points by which a lane change jumps ahead on the neighbouring lane


@dataclass(frozen=True, eq=False)
class _Path:
    """Points: lane (n,), u (n,), and pose (n, 5)."""

    lane: NDArray[np.int32]
    u: Floats
    pose: Floats

    def at(self, rows: slice) -> _Path:
        return _Path(self.lane[rows], self.u[rows], self.pose[rows])

    @staticmethod
    def joined(parts: Sequence[_Path]) -> _Path:
        return _Path(
            np.concatenate([part.lane for part in parts]),
            np.concatenate([part.u for part in parts]),
            np.concatenate([part.pose for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class _Edge:
    """A segment of the graph, or a lane change.

    Attributes:
        option: LANEFOLLOW, or the change.
        lane: Where it is entered; after a change the neighbouring lane.
        path: Its points without entry and exit.
        whole: Entry, path and exit.
        is_junction: The entry lies in a junction.
        leaving: (2,) unit direction of travel at the exit; None: unknown (an end that leads nowhere).
        chord: (2,) unit direction from entry to exit.
    """

    option: RoadOption
    lane: int
    path: _Path
    whole: _Path
    is_junction: bool = False
    leaving: Floats | None = None
    chord: Floats | None = None

    @property
    def is_segment(self) -> bool:
        return self.option == RoadOption.LANEFOLLOW

    @property
    def is_crossing(self) -> bool:
        return self.is_segment and self.is_junction


@dataclass
class TurnMemory:
    """What CARLA's planner carries from one pair of key points to the next."""

    decision: RoadOption = RoadOption.VOID
    crossing_end: Node = -1


class RoutePlanner:
    """Plans on the driving lanes of a town.

    Args:
        town: Where.
        resolution: Spacing of the points along s [m].

    Attributes:
        graph: Its edges have a `length` and their `edge`; its nodes a place `vertex` [m].
    """

    def __init__(self, town: TownMap, resolution: float = RESOLUTION) -> None:
        self.town, self.resolution = town, resolution
        self.graph: nx.DiGraph[Node] = nx.DiGraph()
        self._node_at: dict[Place, Node] = {}
        self._nodes_of: dict[int, tuple[Node, Node]] = {}  # of a lane's edge
        self._sampled: dict[int, tuple[_Path, Floats]] = {}
        self._segments = self._find_segments()
        for lane, following in self._segments:
            self._add_segment(lane, following)
        self._add_loose_ends()
        self._add_changes()

    def _find_segments(self) -> list[tuple[int, int]]:
        """Pairs of a lane and one that follows (-1 at a dead end), in CARLA's order."""
        lanes, place = self.town.lanes, followers_in_order(self.town)
        segments: list[tuple[int, int]] = []
        for lane in lanes_in_order(self.town, lanes.where(int(LaneType.DRIVING)).tolist()):
            following = sorted(lanes.successors(lane).tolist(), key=lambda k: place.get(int(lanes.road_id[k]), 0))
            segments += [(lane, k) for k in following] or [(lane, -1)]
        return segments

    def _border(self, lane: int, following: int) -> tuple[int, float]:
        """Lane and u of the exit: where the next lane begins, or the end of a dead end."""
        return (following, 0.0) if following >= 0 else (lane, float(self.town.lanes.length[lane]))

    def _node(self, lane: int, u: float) -> Node:
        """The node of a lane's end, made when there is none at the same whole metre."""
        vertex = self._vertex(lane, u)
        if vertex not in self._node_at:
            self._node_at[vertex] = len(self._node_at)
            self.graph.add_node(self._node_at[vertex], vertex=vertex)
        return self._node_at[vertex]

    def _vertex(self, lane: int, u: float) -> Place:
        x, y, z = np.round(single_precision_points(self.town, lane, self._s_of(lane, u))[0]).tolist()
        return x, y, z

    def _s_of(self, lane: int, u: float) -> Floats:
        """OpenDRIVE s (1,) where a lane begins or ends."""
        return (self.town.lanes.s_start if u == 0.0 else self.town.lanes.s_end)[lane : lane + 1]

    def _add_segment(self, lane: int, following: int) -> None:
        source, target = self._node(lane, 0.0), self._node(*self._border(lane, following))
        path, end = self._path(lane, following), self._points(*self._border(lane, following))
        whole = _Path.joined([self._points(lane, 0.0), path, end])
        chord = end.pose[0, :2] - whole.pose[0, :2]
        edge = _Edge(
            RoadOption.LANEFOLLOW,
            lane,
            path,
            whole,
            is_junction=bool(self.town.lanes.junction[lane] >= 0),
            leaving=np.array([np.cos(end.pose[0, 3]), np.sin(end.pose[0, 3])]),
            chord=chord / max(float(np.hypot(*chord)), 1e-9),
        )
        self._nodes_of[lane] = (source, target)
        self.graph.add_edge(source, target, length=len(path.u) + 1, edge=edge)

    def _add_loose_ends(self) -> None:
        """Edges along lanes that traffic leads into but that are no driving lanes."""
        count = 0
        for _, lane in self._segments:
            if lane < 0 or lane in self._nodes_of:
                continue
            count += 1
            source = self._node(lane, 0.0)
            self._nodes_of[lane] = (source, -count)
            path = self._samples(lane)[0].at(slice(1, None))
            if len(path.u):
                x, y, z = path.pose[-1, :3].tolist()
                self.graph.add_node(-count, vertex=(x, y, z))
                whole = _Path.joined([self._points(lane, 0.0), path, path.at(slice(-1, None))])
                is_junction = bool(self.town.lanes.junction[lane] >= 0)
                edge = _Edge(RoadOption.LANEFOLLOW, lane, path, whole, is_junction)
                self.graph.add_edge(source, -count, length=len(path.u) + 1, edge=edge)

    def _add_changes(self) -> None:
        """Free edges from where a lane begins to where its neighbours begin, if the marks allow it somewhere."""
        lanes = self.town.lanes
        driving = (lanes.type & int(LaneType.DRIVING)) > 0
        for lane, following in self._segments:
            if lanes.junction[lane] >= 0:
                continue
            path = self._path(lane, following)
            rows = lanes.first[path.lane] + np.rint(path.u / lanes.step[path.lane]).astype(np.int64)
            bits = lanes.change[np.minimum(rows, lanes.first[path.lane + 1] - 1)]
            found = []
            for other, bit, option in (
                (int(lanes.right[lane]), CHANGE_RIGHT, RoadOption.CHANGELANERIGHT),
                (int(lanes.left[lane]), CHANGE_LEFT, RoadOption.CHANGELANELEFT),
            ):
                if other >= 0 and driving[other] and (bits & bit).any():
                    found.append((int(np.argmax((bits & bit) > 0)), other, option))
            for _, other, option in sorted(found, key=lambda change: change[0]):
                source, target = self._nodes_of[lane][0], self._nodes_of[other][0]
                nowhere = self._points(other, 0.0).at(slice(0, 0))
                self.graph.add_edge(source, target, length=0, edge=_Edge(option, other, nowhere, nowhere))

    def _samples(self, lane: int) -> tuple[_Path, Floats]:
        """Points of a lane from its start on, `resolution` apart along s, and their s."""
        if lane not in self._sampled:
            lanes, step = self.town.lanes, self.resolution
            low, high = float(lanes.s_start[lane]), float(lanes.s_end[lane])
            sign = 1.0 if high >= low else -1.0
            hops = np.arange(int(abs(high - low) / step + 1e-9) + 1, dtype=np.float64)
            s = np.asarray(low + sign * step * hops, dtype=np.float64)
            along = lanes.point_s[lanes.rows(lane)]
            u: Floats = np.interp(sign * s, sign * along, np.arange(len(along)) * lanes.step[lane])
            self._sampled[lane] = _Path(np.full(len(u), lane, np.int32), u, self.town.centre(lane, u)), s
        return self._sampled[lane]

    def _path(self, lane: int, following: int) -> _Path:
        """The points between entry and exit: as long as they are farther than a hop from the exit."""
        samples, s = self._samples(lane)
        exit_lane, exit_u = self._border(lane, following)
        end = single_precision_points(self.town, exit_lane, self._s_of(exit_lane, exit_u))
        off = np.sqrt(np.sum((single_precision_points(self.town, lane, s) - end) ** 2, axis=1))
        if off[0] <= self.resolution:  # a lane shorter than a hop: one point, mostly beyond it
            beyond = Waypoint(self.town, lane, 0.0).next(self.resolution)
            return self._points(beyond[0].lane, beyond[0].u) if beyond else samples.at(slice(0, 0))
        near = np.flatnonzero(off[1:] <= self.resolution)
        return samples.at(slice(1, 1 + int(near[0]) if len(near) else None))

    def _points(self, lane: int, u: float) -> _Path:
        """One place as a path."""
        return _Path(np.array([lane], np.int32), np.array([u]), self.town.centre(lane, u))

    def locate(self, points: ArrayLike) -> list[Waypoint]:
        """Driving waypoints nearest to key points (K, 3).

        Raises:
            RouteError: a point is not finite or far from any driving lane.
        """
        points = np.asarray(points, dtype=np.float64)
        hits = self.town.nearest(points)
        found = []
        for k, (x, y, *_) in enumerate(points.tolist()):
            if hits.lane[k] < 0:
                raise RouteError(f"waypoint {k} ({x:.1f}, {y:.1f}) is no place of {self.town.name}.")
            off = float(np.hypot(hits.points[k, 0] - x, hits.points[k, 1] - y))
            if off > MAX_OFF_ROAD:
                raise RouteError(
                    f"waypoint {k} ({x:.1f}, {y:.1f}) is {off:.1f} m off the nearest driving lane of {self.town.name}."
                )
            found.append(Waypoint(self.town, int(hits.lane[k]), float(hits.u[k])))
        return found

    def _settle(self, places: list[Waypoint], keypoints: Floats) -> list[Waypoint]:
        """The places, each that is as near to other lanes of its junction on the lane that makes the way shortest."""
        settled = list(places)
        for k in range(1, len(places) - 1):
            choices = self._equally_near(places[k], keypoints[k]) if places[k].is_junction else []
            if len(choices) > 1:
                settled[k] = min(choices, key=lambda place: self._around(settled[k - 1], place, places[k + 1]))
        return settled

    def _equally_near(self, place: Waypoint, point: Floats) -> list[Waypoint]:
        """`place` and the places on other lanes of its junction that are as near to `point`."""
        found = []
        for lane in self.town.junctions[place.junction].lanes:
            if lane in self._nodes_of:
                line = self.town.lanes.centre_line(lane)[:, :3]
                along = np.diff(line, axis=0)
                share = np.sum((point - line[:-1]) * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-12)
                share = np.clip(share, 0.0, 1.0)
                off = np.sqrt(np.sum((line[:-1] + share[:, None] * along - point) ** 2, axis=1))
                row = int(np.argmin(off))
                u = float((row + share[row]) * self.town.lanes.step[lane])
                on_lane = self.town.centre(lane, u)[0, :3]  # on the curve; the chord may lie some millimetres beside it
                found.append((float(np.linalg.norm(on_lane - point)), Waypoint(self.town, lane, u)))
        nearest = min(off for off, _ in found)
        rivals = [other for off, other in found if off < nearest + TIE and other.lane != place.lane]
        return [place, *rivals]

    def _around(self, before: Waypoint, place: Waypoint, after: Waypoint) -> float:
        """Length of the ways to and from a place, in points."""
        try:
            ways = [self.search(before.lane, place.lane), self.search(place.lane, after.lane)]
        except RouteError:
            return float("inf")
        return sum(float(nx.path_weight(self.graph, way, "length")) for way in ways)

    def search(self, start: int, goal: int) -> list[Node]:
        """Nodes from where lane `start` begins to where lane `goal` ends.

        Raises:
            RouteError: no way leads there.
        """
        lanes = self.town.lanes
        source, (target, end) = self._nodes_of[start][0], self._nodes_of[goal]
        try:
            nodes = shortest_way(self.graph, source, target)
        except nx.NetworkXNoPath:
            raise RouteError(
                f"no way leads from lane {lanes.lane_id[start]} of road {lanes.road_id[start]} "
                f"to lane {lanes.lane_id[goal]} of road {lanes.road_id[goal]} in {self.town.name}."
            ) from None
        return [*nodes, end]

    def _edge(self, source: Node, target: Node) -> _Edge:
        edge: _Edge = self.graph.edges[source, target]["edge"]
        return edge

    def _decide(self, k: int, nodes: Sequence[Node], edges: Sequence[_Edge], memory: TurnMemory) -> RoadOption:
        """Command of edge `k` of a way."""
        edge = edges[k]
        decision = edge.option
        if k > 0:
            if memory.decision != RoadOption.VOID and 0 < memory.crossing_end != nodes[k - 1] and edge.is_crossing:
                decision = memory.decision
            else:
                memory.crossing_end = -1
                if edges[k - 1].is_segment and not edges[k - 1].is_junction and edge.is_crossing:
                    decision = self._turn(k, nodes, edges, memory)
        memory.decision = decision
        return decision

    def _turn(self, k: int, nodes: Sequence[Node], edges: Sequence[_Edge], memory: TurnMemory) -> RoadOption:
        """Command on edge `k`, the first of a crossing."""
        tail = k
        while tail + 1 < len(edges) and edges[tail + 1].is_crossing:
            tail += 1
        memory.crossing_end = nodes[tail + 1]
        current, chosen = edges[k - 1].leaving, edges[tail].leaving
        if current is None or chosen is None:
            return edges[k].option
        branches = [self._edge(nodes[k], node) for node in self.graph.successors(nodes[k]) if node != nodes[k + 1]]
        others = [branch.chord for branch in branches if branch.is_segment and branch.chord is not None]
        return turn_decision(current, chosen, others)

    def _piece(
        self, origin: Waypoint, goal: Waypoint, target: Floats, memory: TurnMemory
    ) -> tuple[_Path, NDArray[np.int8]]:
        """CARLA's `trace_route` between two waypoints; `target` is the key point itself."""
        nodes = self.search(origin.lane, goal.lane)
        edges = [self._edge(a, b) for a, b in pairwise(nodes)]
        parts: list[_Path] = []
        options: list[RoadOption] = []
        current = self._points(origin.lane, origin.u)
        goal_pose = self.town.centre(goal.lane, goal.u)[0, :3]
        for k, edge in enumerate(edges):
            option = self._decide(k, nodes, edges, memory)
            if not edge.is_segment:
                path = self._edge(*self._nodes_of[edge.lane]).path
                parts.append(current)
                if len(path.u):
                    jump = min(_closest(current, path) + CHANGE_AHEAD, len(path.u) - 1)
                    current = path.at(slice(jump, jump + 1))
                else:
                    current = self._edge(*self._nodes_of[edge.lane]).whole.at(slice(-1, None))
                parts.append(current)
                options += [option, option]
                continue
            path = edge.whole
            start, stop = _closest(current, path), len(path.u)
            if k == len(edges) - 1:
                off = np.sqrt(np.sum((path.pose[start:, :3] - target) ** 2, axis=1))
                reached = off < 2.0 * self.resolution
                if start > int(np.argmin(np.sum((path.pose[:, :3] - goal_pose) ** 2, axis=1))):
                    reached |= path.lane[start:] == goal.lane  # the goal lies behind
                if reached.any():
                    stop = start + int(np.argmax(reached)) + 1
            elif edges[k + 1].is_segment and np.allclose(path.pose[-1, :3], edges[k + 1].whole.pose[0, :3], atol=1e-3):
                # The last point is where all branches begin: it belongs to the one that is driven.
                path = _Path.joined([path.at(slice(0, -1)), self._points(edges[k + 1].lane, 0.0)])
            piece = path.at(slice(start, stop))
            parts.append(piece)
            options += [option] * len(piece.u)
            current = piece.at(slice(-1, None))
        return _Path.joined(parts), np.array([int(option) for option in options], np.int8)

    def trace(self, keypoints: ArrayLike, memory: TurnMemory | None = None) -> Route:
        """The dense route through key points (K, 3), K at least 2.

        Args:
            keypoints: Where to pass [m].
            memory: Of a planner that has traced other routes before; a new one by default, as in the leaderboard.

        Raises:
            RouteError: too few points, one far from any driving lane, or no way between two of them.
        """
        keypoints = np.array(keypoints, dtype=np.float64)
        if keypoints.ndim != 2 or keypoints.shape[1] != 3 or len(keypoints) < 2:
            raise RouteError(f"a route needs two or more waypoints (x, y, z), got an array of shape {keypoints.shape}.")
        places = self._settle(self.locate(keypoints), keypoints)
        memory = TurnMemory() if memory is None else memory
        parts, commands = [], []
        for k in range(len(places) - 1):
            try:
                path, options = self._piece(places[k], places[k + 1], keypoints[k + 1], memory)
            except RouteError as error:
                raise RouteError(f"waypoints {k} and {k + 1}: {error}") from None
            parts.append(path)
            commands.append(options)
        whole = _Path.joined(parts)
        points = np.ascontiguousarray(whole.pose[:, :3])
        return Route(
            points=points,
            yaw=whole.pose[:, 3].copy(),
            command=np.concatenate(commands),
            lane=whole.lane,
            u=whole.u,
            distance=polyline_length(points),
            keypoints=keypoints,
        )


def shortest_way(graph: nx.DiGraph[Node], source: Node, target: Node) -> list[Node]:
    """A* over the edges' `length`, estimating by the straight line between the nodes' `vertex`.

    The shortest way if no edge is shorter than its straight line.

    Raises:
        networkx.NetworkXNoPath: there is none.
    """
    places = graph.nodes

    def straight(a: Node, b: Node) -> float:
        return float(np.linalg.norm(np.subtract(places[a]["vertex"], places[b]["vertex"])))

    return list(nx.astar_path(graph, source, target, heuristic=straight, weight="length"))


def _closest(place: _Path, path: _Path) -> int:
    """Index of the point of `path` nearest to `place`, the first of equally near ones."""
    return int(np.argmin(np.sum((path.pose[:, :3] - place.pose[0, :3]) ** 2, axis=1)))


@lru_cache(maxsize=8)
def get_planner(town: TownMap, resolution: float = RESOLUTION) -> RoutePlanner:
    """The planner of a town, made once a process."""
    return RoutePlanner(town, resolution)
