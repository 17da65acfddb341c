"""CARLA's global route planner on our lanes: shortest way, commands at junctions, lane changes.

Source: CARLA's `agents/navigation/global_route_planner.py` (0.9.10 to today) and the leaderboard's
`interpolate_trajectory`, whose output this reproduces, joints and lane-change jumps included. One thing differs: CARLA
makes graph nodes of positions rounded to whole metres, which can split a fork in two or join strangers; here a node is
where lanes with a common predecessor begin.
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
from lavsim.map.lane import CHANGE_LEFT, CHANGE_RIGHT, turn_decision
from lavsim.map.route import Route, polyline_length
from lavsim.map.town_map import TownMap, Waypoint
from lavsim.types import LaneType, RoadOption

Floats = NDArray[np.float64]

RESOLUTION = 1.0  # [m] hop of the leaderboard's dense routes
MAX_OFF_ROAD = 10.0  # [m] a key point farther from any driving lane is a mistake in the route file
CHANGE_AHEAD = 5  # points by which a lane change jumps ahead on the neighbouring lane


@dataclass(frozen=True)
class _Edge:
    """A lane, or (with `change` set) the step to the neighbouring lane from where `lane` begins."""

    lane: int
    following: int  # lane that begins at the end node; -1 at a dead end
    change: RoadOption | None = None


@dataclass(frozen=True, eq=False)
class _Path:
    """Points of one edge: lane, u, and pose (n, 5)."""

    lane: NDArray[np.int32]
    u: Floats
    pose: Floats

    def at(self, rows: slice) -> _Path:
        return _Path(self.lane[rows], self.u[rows], self.pose[rows])


class RoutePlanner:
    """Plans on the driving lanes of a town.

    Args:
        town: Where.
        resolution: Spacing of the points along s [m].
    """

    def __init__(self, town: TownMap, resolution: float = RESOLUTION) -> None:
        self.town, self.resolution = town, resolution
        lanes = town.lanes
        driving = [int(k) for k in lanes.where(int(LaneType.DRIVING))]
        self._is_driving = (lanes.type & int(LaneType.DRIVING)) > 0
        self._paths: dict[int, _Path] = {}
        self._node = self._nodes(driving)
        self._dead_end: dict[int, int] = {}
        self.graph: nx.DiGraph[int] = nx.DiGraph()
        self._where: dict[int, Floats] = {}
        for lane in driving:
            self._where.setdefault(self._node[lane], lanes.points[lanes.first[lane], :3])
        fresh = len(lanes)
        for lane in driving:
            following = [int(k) for k in lanes.successors(lane) if self._is_driving[k]]
            if following:
                end = self._node[following[0]]
            else:
                end = self._dead_end[lane] = fresh
                self._where[end] = lanes.points[lanes.first[lane + 1] - 1, :3]
                fresh += 1
            edge = _Edge(lane, following[0] if following else -1)
            if not self.graph.has_edge(self._node[lane], end):
                points = len(self._path(lane).lane)  # entry and path points; CARLA counts path points + 1
                self.graph.add_edge(self._node[lane], end, length=points, edge=edge)
        self._add_changes(driving)

    def _nodes(self, driving: Sequence[int]) -> dict[int, int]:
        """Node at which each lane begins: one number for all lanes that a lane leads into."""
        parent = {lane: lane for lane in driving}

        def root(lane: int) -> int:
            while parent[lane] != lane:
                parent[lane] = parent[parent[lane]]
                lane = parent[lane]
            return lane

        for lane in driving:
            following = [int(k) for k in self.town.lanes.successors(lane) if self._is_driving[k]]
            for other in following[1:]:
                a, b = root(following[0]), root(other)
                parent[max(a, b)] = min(a, b)
        return {lane: root(lane) for lane in driving}

    def _add_changes(self, driving: Sequence[int]) -> None:
        lanes = self.town.lanes
        for lane in driving:
            if lanes.junction[lane] >= 0:
                continue
            path = self._path(lane)
            rows = lanes.first[lane] + np.rint(path.u[1:] / lanes.step[lane]).astype(np.int64)
            bits = lanes.change[np.minimum(rows, lanes.first[lane + 1] - 1)]
            for other, bit, option in (
                (int(lanes.right[lane]), CHANGE_RIGHT, RoadOption.CHANGELANERIGHT),
                (int(lanes.left[lane]), CHANGE_LEFT, RoadOption.CHANGELANELEFT),
            ):
                if other >= 0 and self._is_driving[other] and (bits & bit).any():
                    source, target = self._node[lane], self._node[other]
                    if source != target:
                        self.graph.add_edge(source, target, length=0, edge=_Edge(lane, other, option))

    def _path(self, lane: int) -> _Path:
        """Entry and path points of a lane, `resolution` apart along s, as CARLA samples a segment."""
        if lane not in self._paths:
            lanes, step = self.town.lanes, self.resolution
            low, high = float(lanes.s_start[lane]), float(lanes.s_end[lane])
            count = int(abs(high - low) / step + 1e-9)
            s = low + np.sign(high - low) * step * np.arange(count + 1)
            u = np.array([lanes.u_of_s(lane, float(v)) for v in s])
            pose = self.town.centre(lane, u)
            end = lanes.points[lanes.first[lane + 1] - 1, :3]
            near = np.sqrt(np.sum((pose[:, :3] - end) ** 2, axis=1)) <= step
            last = int(np.argmax(near)) if near.any() else len(s)
            if last == 0:  # a lane shorter than a hop: CARLA puts one point beyond it
                beyond = Waypoint(self.town, lane, 0.0).next(step)
                number = [lane] + [beyond[0].lane] * bool(beyond)
                along = [0.0] + [beyond[0].u] * bool(beyond)
                self._paths[lane] = self._poses(np.array(number, np.int32), np.array(along))
            else:
                self._paths[lane] = _Path(np.full(last, lane, np.int32), u[:last], pose[:last])
        return self._paths[lane]

    def _poses(self, lane: NDArray[np.int32], u: Floats) -> _Path:
        return _Path(lane, u, self.town.centre(lane, u))

    def _full(self, lane: int, following: int) -> _Path:
        """Entry, path and exit points; the exit is where `following` begins."""
        path = self._path(lane)
        if following >= 0:
            exit_lane, exit_u = following, 0.0
        else:
            exit_lane, exit_u = lane, float(self.town.lanes.length[lane])
        last = self._poses(np.array([exit_lane], np.int32), np.array([exit_u]))
        return _Path(
            np.concatenate([path.lane, last.lane]),
            np.concatenate([path.u, last.u]),
            np.concatenate([path.pose, last.pose]),
        )

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

    def search(self, start: int, goal: int) -> list[int]:
        """Nodes from where lane `start` begins to where lane `goal` ends.

        Raises:
            RouteError: no way leads there.
        """

        def straight(a: int, b: int) -> float:
            return float(np.sqrt(np.sum((self._where[a] - self._where[b]) ** 2)))

        source, target = self._node[start], self._node[goal]
        lanes = self.town.lanes
        prefix: list[int] = []
        if lanes.junction[start] >= 0 and start != goal:
            # CARLA searches from the fork before the junction and may then leave by another branch than the one the
            # vehicle stands on.
            prefix, source = [source], self._end(start)
        try:
            nodes = nx.astar_path(self.graph, source, target, heuristic=straight, weight="length")
        except nx.NetworkXNoPath:
            raise RouteError(
                f"no way leads from lane {lanes.lane_id[start]} of road {lanes.road_id[start]} "
                f"to lane {lanes.lane_id[goal]} of road {lanes.road_id[goal]} in {self.town.name}."
            ) from None
        return [*prefix, *nodes, self._end(goal)]

    def _end(self, lane: int) -> int:
        following = [int(k) for k in self.town.lanes.successors(lane) if self._is_driving[k]]
        return self._node[following[0]] if following else self._dead_end[lane]

    def _turn(self, k: int, edges: Sequence[_Edge], nodes: Sequence[int]) -> RoadOption:
        """Command on edge `k`, which enters a junction."""
        junction = self.town.lanes.junction
        tail = k
        while tail + 1 < len(edges) and edges[tail + 1].change is None and junction[edges[tail + 1].lane] >= 0:
            tail += 1
        others = []
        for node in self.graph.successors(nodes[k]):
            other: _Edge = self.graph.edges[nodes[k], node]["edge"]
            if other.change is None and node != nodes[k + 1]:
                chord = (self._where[node] - self._where[nodes[k]])[:2]
                others.append(chord / max(float(np.hypot(*chord)), 1e-9))
        return turn_decision(self._leaving(edges[k - 1].lane), self._leaving(edges[tail].lane), others)

    def _leaving(self, lane: int) -> Floats:
        yaw = self.town.lanes.points[self.town.lanes.first[lane + 1] - 1, 3]
        return np.array([np.cos(yaw), np.sin(yaw)])

    def _commands(self, edges: Sequence[_Edge], nodes: Sequence[int]) -> list[RoadOption]:
        """Command of each edge. A route that begins inside a junction has no command until it leaves it (CARLA)."""
        junction = self.town.lanes.junction
        commands: list[RoadOption] = []
        for k, edge in enumerate(edges):
            if edge.change is not None:
                commands.append(edge.change)
            elif k == 0 or junction[edge.lane] < 0:
                commands.append(RoadOption.LANEFOLLOW)
            elif edges[k - 1].change is None and junction[edges[k - 1].lane] < 0:
                commands.append(self._turn(k, edges, nodes))
            else:
                commands.append(commands[-1] if commands[-1].is_turn else RoadOption.LANEFOLLOW)
        return commands

    def _piece(self, origin: Waypoint, goal: Waypoint, target: Floats) -> tuple[_Path, NDArray[np.int8]]:
        """CARLA's `trace_route` between two waypoints; `target` is the key point itself."""
        nodes = self.search(origin.lane, goal.lane)
        edges: list[_Edge] = [self.graph.edges[a, b]["edge"] for a, b in pairwise(nodes)]
        commands = self._commands(edges, nodes)
        parts: list[_Path] = []
        options: list[RoadOption] = []
        current = self._poses(np.array([origin.lane], np.int32), np.array([origin.u]))
        goal_pose = self.town.centre(goal.lane, goal.u)[0, :3]
        for k, edge in enumerate(edges):
            if edge.change is not None:
                path = self._path(edge.following)
                inner = slice(1 if len(path.u) > 1 else 0, None)
                jump = min(_closest(current.pose[0, :3], path.pose[inner, :3]) + CHANGE_AHEAD, len(path.u[inner]) - 1)
                parts.append(current)
                current = path.at(slice(inner.start + jump, inner.start + jump + 1))
                parts.append(current)
                options += [edge.change, edge.change]
                continue
            following = edges[k + 1].lane if k + 1 < len(edges) else edge.following
            path = self._full(edge.lane, following)
            start = _closest(current.pose[0, :3], path.pose[:, :3])
            stop = len(path.u)
            if k == len(edges) - 1:
                off = np.sqrt(np.sum((path.pose[start:, :3] - target) ** 2, axis=1))
                near = np.flatnonzero(off < 2.0 * self.resolution)
                if len(near):
                    stop = start + int(near[0]) + 1
                elif start > _closest(goal_pose, path.pose[:, :3]):
                    stop = start + 1
            piece = path.at(slice(start, stop))
            parts.append(piece)
            options += [commands[k]] * len(piece.u)
            current = piece.at(slice(-1, None))
        joined = _Path(
            np.concatenate([p.lane for p in parts]),
            np.concatenate([p.u for p in parts]),
            np.concatenate([p.pose for p in parts]),
        )
        return joined, np.array([int(o) for o in options], np.int8)

    def trace(self, keypoints: ArrayLike) -> Route:
        """The dense route through key points (K, 3), K at least 2.

        Raises:
            RouteError: too few points, one far from any driving lane, or no way between two of them.
        """
        keypoints = np.array(keypoints, dtype=np.float64)
        if keypoints.ndim != 2 or keypoints.shape[1] != 3 or len(keypoints) < 2:
            raise RouteError(f"a route needs two or more waypoints (x, y, z), got an array of shape {keypoints.shape}.")
        places = self.locate(keypoints)
        parts = []
        for k in range(len(places) - 1):
            try:
                parts.append(self._piece(places[k], places[k + 1], keypoints[k + 1]))
            except RouteError as error:
                raise RouteError(f"waypoints {k} and {k + 1}: {error}") from None
        pose = np.concatenate([path.pose for path, _ in parts])
        points = np.ascontiguousarray(pose[:, :3])
        return Route(
            points=points,
            yaw=pose[:, 3].copy(),
            command=np.concatenate([options for _, options in parts]),
            lane=np.concatenate([path.lane for path, _ in parts]),
            u=np.concatenate([path.u for path, _ in parts]),
            distance=polyline_length(points),
            keypoints=keypoints,
        )


def _closest(point: Floats, points: Floats) -> int:
    return int(np.argmin(np.sum((points - point) ** 2, axis=1)))


@lru_cache(maxsize=8)
def get_planner(town: TownMap, resolution: float = RESOLUTION) -> RoutePlanner:
    """The planner of a town, made once a process."""
    return RoutePlanner(town, resolution)
