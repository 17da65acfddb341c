"""What the town says about the path: speed limits, stop lines and junctions on it, and where others' lanes lead."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from agents.behavior.path import STEP, ReferencePath
from lavsim.geometry import wrap_angle
from lavsim.map.town_map import TownMap
from lavsim.types import RoadOption

Floats = NDArray[np.float64]

LINE_REACH = 1.8  # [m] a stop line whose middle is that near to the path is the path's own
TRACK_STEP = 1.0  # [m]
TRACK_BEYOND = 70.0  # [m] of road behind a lane's end that another driver may use within the horizon
MAX_TRACKS = 6  # ways on from one lane that are looked at


@dataclass(frozen=True)
class StopPoint:
    """Where a red light or a stop sign holds the path.

    Attributes:
        s: End of the approach lane, which the rear must not cross at red [m along the path].
        light: The light that governs it; -1 at a stop sign.
        before: How far before it the stop line is painted, a crosswalk in between [m].
    """

    s: float
    light: int
    before: float = 0.0


def limits_along(path: ReferencePath, town: TownMap) -> Floats:
    """Speed limit (S,) [m/s] of the lanes under the path."""
    lanes = town.nearest(path.xy).lane
    return town.lanes.speed_limit[np.maximum(lanes, 0)]


def stop_points(path: ReferencePath, town: TownMap) -> list[StopPoint]:
    """Stop lines that the path crosses, in order; one that is passed twice is there twice."""
    lines = [(line, light.index) for light in town.lights for line in light.stop_lines]
    lines += [(line, -1) for sign in town.signs if sign.kind == "stop" for line in sign.stop_lines]
    found: list[StopPoint] = []
    for line, light in lines:
        distance = np.hypot(path.xy[:, 0] - line.x, path.xy[:, 1] - line.y)
        aligned = np.abs(wrap_angle(path.yaw - line.yaw)) < 0.8
        near = np.flatnonzero((distance < LINE_REACH) & aligned)
        for visit in np.split(near, np.flatnonzero(np.diff(near) > 10) + 1):
            if len(visit):
                nearest = int(visit[np.argmin(distance[visit])])
                dx, dy = line.x - path.xy[nearest, 0], line.y - path.xy[nearest, 1]
                yaw = path.yaw[nearest]
                s = nearest * STEP + float(dx * np.cos(yaw) + dy * np.sin(yaw))
                found.append(StopPoint(s, light, line.u - line.paint_u))
    return sorted(found, key=lambda point: point.s)


@dataclass(frozen=True)
class Track:
    """One way a vehicle on a lane can go on.

    Attributes:
        poses: (M, 3) x, y [m], yaw [rad] every `TRACK_STEP` from the lane's start.
        turn: What it does at the first junction ahead.
        gates: (place along the track [m], light) of each governed junction lane on it.
        is_inside: Whether the lane itself lies in a junction.
    """

    poses: Floats
    turn: RoadOption
    gates: tuple[tuple[float, int], ...]
    is_inside: bool


@dataclass
class TrackBook:
    """Tracks of a town's lanes, worked out when first needed."""

    town: TownMap
    _tracks: dict[int, tuple[Track, ...]] = field(default_factory=dict)

    def of_lane(self, lane: int) -> tuple[Track, ...]:
        """All ways on from `lane`."""
        tracks = self._tracks.get(lane)
        if tracks is None:
            tracks = self._tracks[lane] = tuple(self._follow(lane))
        return tracks

    def _follow(self, lane: int) -> list[Track]:
        table = self.town.lanes
        done: list[tuple[int, ...]] = []
        waiting: list[tuple[tuple[int, ...], float]] = [((lane,), 0.0)]
        while waiting and len(done) < MAX_TRACKS:
            chain, beyond = waiting.pop(0)
            following = [int(k) for k in table.successors(chain[-1]) if int(k) not in chain]
            if beyond >= TRACK_BEYOND or not following or len(chain) > 24:
                done.append(chain)
                continue
            has_branched = sum(len(table.successors(k)) > 1 for k in chain[:-1]) >= 1
            for branch in following[:1] if has_branched else following:
                waiting.append(((*chain, branch), beyond + float(table.length[branch])))
        return [self._track(chain) for chain in done]

    def _track(self, chain: tuple[int, ...]) -> Track:
        table = self.town.lanes
        parts: list[Floats] = []
        gates: list[tuple[float, int]] = []
        turn = RoadOption.LANEFOLLOW
        start, carry = 0.0, 0.0
        for lane in chain:
            length = float(table.length[lane])
            if table.light[lane] >= 0:
                gates.append((start, int(table.light[lane])))
            if turn == RoadOption.LANEFOLLOW and table.junction[lane] >= 0:
                turn = RoadOption(int(table.turn[lane]))
            u = np.arange(carry, length, TRACK_STEP)
            parts.append(self.town.centre(np.full(len(u), lane), u)[:, [0, 1, 3]])
            carry = carry + len(u) * TRACK_STEP - length
            start += length
        poses = np.concatenate(parts) if parts else np.zeros((0, 3))
        if len(poses) < 2:  # a stub of a lane that leads nowhere
            end = self.town.centre(np.array([chain[0]]), np.array([0.0]))[:, [0, 1, 3]]
            ahead = np.array([np.cos(end[0, 2]), np.sin(end[0, 2]), 0.0]) * TRACK_STEP
            poses = np.concatenate([end, end + ahead])
        return Track(np.ascontiguousarray(poses), turn, tuple(gates), bool(table.junction[chain[0]] >= 0))
