"""A place on a lane, with CARLA's waypoint semantics."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lavsim.map.landmark import Landmark, landmarks_ahead
from lavsim.types import LaneType

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]

MOST_STEPS = 50_000  # lanes passed in one search ahead or behind; rings of tiny lanes have no end


@dataclass(frozen=True)
class Waypoint:
    """A place on a lane: `u` metres after where traffic enters it. CARLA's waypoint semantics."""

    town: TownMap = field(repr=False, compare=False)
    lane: int
    u: float

    @cached_property
    def s(self) -> float:
        """OpenDRIVE s [m]."""
        return self.town.lanes.s_of_u(self.lane, self.u)

    @cached_property
    def _pose(self) -> tuple[float, float, float, float, float]:
        return self.town.exact(self.lane, self.s)

    @property
    def x(self) -> float:
        return self._pose[0]

    @property
    def y(self) -> float:
        return self._pose[1]

    @property
    def z(self) -> float:
        return self._pose[2]

    @property
    def yaw(self) -> float:
        """Direction of travel [rad], not wrapped."""
        return self._pose[3]

    @property
    def width(self) -> float:
        return self._pose[4]

    @property
    def xy(self) -> Floats:
        return np.array(self._pose[:2])

    @property
    def xyz(self) -> Floats:
        return np.array(self._pose[:3])

    @property
    def curvature(self) -> float:
        """[1/m], positive to the right."""
        return float(self.town.centre(self.lane, self.u)[0, 4])

    @property
    def road_id(self) -> int:
        return int(self.town.lanes.road_id[self.lane])

    @property
    def section_id(self) -> int:
        return int(self.town.lanes.section[self.lane])

    @property
    def lane_id(self) -> int:
        return int(self.town.lanes.lane_id[self.lane])

    @property
    def lane_type(self) -> LaneType:
        return LaneType(int(self.town.lanes.type[self.lane]))

    @property
    def junction(self) -> int:
        """Index of its junction, or -1."""
        return int(self.town.lanes.junction[self.lane])

    @property
    def is_junction(self) -> bool:
        return self.junction >= 0

    @property
    def speed_limit(self) -> float:
        """[m/s]"""
        return float(self.town.lanes.speed_limit[self.lane])

    @property
    def lane_change(self) -> int:
        """Lane changes that the marks allow here: 1 right, 2 left, 3 both (CARLA's `LaneChange`)."""
        lanes = self.town.lanes
        row = round(self.u / float(lanes.step[self.lane]))
        return int(lanes.change[lanes.rows(self.lane)][row])

    def next(self, distance: float) -> list[Waypoint]:
        """Waypoints `distance` metres of s ahead, one for each branch; none past a dead end."""
        return self._step(distance, ahead=True)

    def previous(self, distance: float) -> list[Waypoint]:
        """Waypoints `distance` metres of s behind, one for each branch."""
        return self._step(distance, ahead=False)

    def _step(self, distance: float, ahead: bool) -> list[Waypoint]:
        if not distance > 0.0:
            raise ValueError(f"distance must be positive [m], got {distance}.")
        lanes = self.town.lanes
        found: list[Waypoint] = []
        open_ends = [(self.lane, self.s, distance)]
        steps = 0
        while open_ends and steps < MOST_STEPS:
            steps += 1
            lane, s, rest = open_ends.pop(0)
            border = float(lanes.s_end[lane] if ahead else lanes.s_start[lane])
            left = abs(border - s)
            if rest <= left + 1e-6:
                at = s + np.sign(border - s) * rest
                found.append(Waypoint(self.town, lane, lanes.u_of_s(lane, float(at))))
                continue
            for branch in lanes.successors(lane) if ahead else lanes.predecessors(lane):
                start = float(lanes.s_start[branch] if ahead else lanes.s_end[branch])
                if len(found) + len(open_ends) < 512:  # a web of tiny lanes must not grow without bound
                    open_ends.append((int(branch), start, rest - left))
        return found

    def ahead(self, distance: float) -> Waypoint:
        """`distance` metres ahead along first branches; the end of the lane at a dead end; itself for 0."""
        if distance <= 0.0:
            return self
        lanes, lane, u = self.town.lanes, self.lane, self.u + distance
        for _ in range(MOST_STEPS):
            if u <= lanes.length[lane]:
                break
            following = lanes.successors(lane)
            if not len(following):
                return Waypoint(self.town, lane, float(lanes.length[lane]))
            u -= float(lanes.length[lane])
            lane = int(following[0])
        return Waypoint(self.town, lane, float(min(u, lanes.length[lane])))

    def landmarks(self, distance: float, stop_at_junction: bool = False) -> list[Landmark]:
        """Landmarks that count for its lane within `distance` metres of s ahead, over all branches, each once.

        With `stop_at_junction` the search ends where a junction begins (CARLA's `get_landmarks`).
        """
        return landmarks_ahead(self.town, self, distance, stop_at_junction)

    def left(self) -> Waypoint | None:
        """The lane to the left at the same s, of any type or direction; None at the edge."""
        return self._beside(outward=self._keeps_left)

    def right(self) -> Waypoint | None:
        """The lane to the right at the same s, of any type or direction; None at the edge."""
        return self._beside(outward=not self._keeps_left)

    @property
    def _keeps_left(self) -> bool:
        return (self.lane_id > 0) == self.town.lanes.runs_forward(self.lane)

    def _beside(self, outward: bool) -> Waypoint | None:
        away = 1 if self.lane_id > 0 else -1
        lane_id = self.lane_id + (away if outward else -away)
        if lane_id == 0:
            lane_id = -self.lane_id
        lane = self.town._lane_of.get((self.road_id, self.section_id, lane_id))
        return None if lane is None else Waypoint(self.town, lane, self.town.lanes.u_of_s(lane, self.s))
