"""The lanes of a town as one table of arrays.

The frame is the world's (y south, angles clockwise). Inside a lane the coordinate is `u`: metres travelled along the
lane's centre line in plan, from where traffic enters it. `lavsim.map.lane_build` makes the table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import wrap_angle
from lavsim.types import LaneType

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

CLEAR_HEIGHT = 3.0  # [m] lanes farther apart in z don't meet (DESIGN section 2)
CHANGE_RIGHT, CHANGE_LEFT = 1, 2  # bits of `LaneTable.change`, CARLA's LaneChange
DRIVABLE = int(
    LaneType.DRIVING
    | LaneType.BIDIRECTIONAL
    | LaneType.ENTRY
    | LaneType.EXIT
    | LaneType.OFF_RAMP
    | LaneType.ON_RAMP
    | LaneType.PARKING
)  # types that a vehicle may pass between


class Side(Enum):
    """A side of a lane, seen in its direction of travel."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True, eq=False)
class LaneTable:
    """Every lane piece (road, section, lane id) but the centre lanes 0, one row each; P centre points in all.

    Attributes:
        road_id: (L,) int32.
        section: (L,) int32, index of the section on its road.
        lane_id: (L,) int32.
        type: (L,) int32, `LaneType` bits.
        junction: (L,) int32, index into `TownMap.junctions`, or -1.
        length: (L,) length of the centre line in plan [m].
        s_start: (L,) OpenDRIVE s where travel enters [m].
        s_end: (L,) s where it leaves; below `s_start` where travel runs against s: on lanes with positive id where
            traffic keeps right, on those with negative id where it keeps left.
        first: (L+1,) int32; points of lane i are rows first[i] … first[i+1]-1, in the direction of travel.
        step: (L,) their spacing in u [m], uniform within a lane, at most 0.5.
        points: (P, 5) x, y, z [m], yaw [rad, unwrapped within a lane], curvature [1/m, positive to the right].
        point_s: (P,) s of each point.
        width: (P,) lane width [m].
        change: (P,) uint8, lane changes the marks allow there: 1 right, 2 left.
        succ_first, succ: lanes that follow in travel, compressed rows: succ[succ_first[i]:succ_first[i+1]].
        pred_first, pred: lanes that lead in.
        left, right: (L,) int32, neighbour of the same type and direction, or -1.
        change_left, change_right: (L,) bool, marks allow the change over at least half of the lane.
        speed_limit: (L,) [m/s], what holds over the longest part of the lane.
        limit_first, limit_u, limit: (K,) limits [m/s] along lane i in rows limit_first[i] … limit_first[i+1]-1,
            each from its `limit_u` [m] on; the first from 0.
        light: (L,) int32, traffic light that governs this junction lane, or -1.
        sign: (L,) int32, stop or yield sign in `TownMap.signs` that governs this junction lane, or -1.
        conflict_first, conflict: lanes of the same junction whose swept areas meet this one's (compressed rows);
            lanes that diverge from one predecessor are left out, merging ones are in.
        conflict_u: (E, 2) where they meet, as an interval of u on this lane [m].
        turn: (L,) int8, `RoadOption` of a junction lane by CARLA's 35 degree rule, LANEFOLLOW elsewhere.
    """

    road_id: Ints
    section: Ints
    lane_id: Ints
    type: Ints
    junction: Ints
    length: Floats
    s_start: Floats
    s_end: Floats
    first: Ints
    step: Floats
    points: Floats
    point_s: Floats
    width: Floats
    change: NDArray[np.uint8]
    succ_first: Ints
    succ: Ints
    pred_first: Ints
    pred: Ints
    left: Ints
    right: Ints
    change_left: NDArray[np.bool_]
    change_right: NDArray[np.bool_]
    speed_limit: Floats
    limit_first: Ints
    limit_u: Floats
    limit: Floats
    light: Ints
    sign: Ints
    conflict_first: Ints
    conflict: Ints
    conflict_u: Floats
    turn: NDArray[np.int8]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.flags.writeable = False

    def __len__(self) -> int:
        return len(self.road_id)

    def successors(self, lane: int) -> Ints:
        """Lanes that follow `lane`."""
        return self.succ[self.succ_first[lane] : self.succ_first[lane + 1]]

    def predecessors(self, lane: int) -> Ints:
        """Lanes that lead into `lane`."""
        return self.pred[self.pred_first[lane] : self.pred_first[lane + 1]]

    def conflicts(self, lane: int) -> Ints:
        """Lanes that `lane` meets inside its junction."""
        return self.conflict[self.conflict_first[lane] : self.conflict_first[lane + 1]]

    def rows(self, lane: int) -> slice:
        """Rows of the centre points of `lane`."""
        return slice(int(self.first[lane]), int(self.first[lane + 1]))

    def centre_line(self, lane: int) -> Floats:
        """Centre points `(n, 5)` of `lane`."""
        return self.points[self.rows(lane)]

    def where(self, types: int) -> NDArray[np.int64]:
        """Lanes of any of `types`."""
        return np.flatnonzero(self.type & types)

    def runs_forward(self, lane: int) -> bool:
        """Whether travel on `lane` runs with s."""
        return bool(self.s_start[lane] <= self.s_end[lane])

    def u_of_s(self, lane: int, s: float) -> float:
        """Travelled length on `lane` at OpenDRIVE `s`, clamped to the lane."""
        along = self.point_s[self.rows(lane)]
        u = np.arange(len(along)) * self.step[lane]
        if not self.runs_forward(lane):
            return float(np.interp(-s, -along, u))
        return float(np.interp(s, along, u))

    def s_of_u(self, lane: int, u: float) -> float:
        """OpenDRIVE s on `lane` after travelling `u`."""
        along = self.point_s[self.rows(lane)]
        position = min(max(u / self.step[lane], 0.0), len(along) - 1.0)
        index = min(int(position), len(along) - 2)
        return float(along[index] + (position - index) * (along[index + 1] - along[index]))


def gaps(lanes: LaneTable) -> Floats:
    """Distance in plan between the end of each lane and the start of each lane that follows it [m], as `succ`."""
    source = np.repeat(np.arange(len(lanes)), np.diff(lanes.succ_first))
    ends, starts = lanes.points[lanes.first[1:] - 1], lanes.points[lanes.first[:-1]]
    return np.hypot(*(ends[source, :2] - starts[lanes.succ, :2]).T)


def kinks(lanes: LaneTable) -> Floats:
    """Change of heading between each lane and each lane that follows it [rad], as `succ`."""
    source = np.repeat(np.arange(len(lanes)), np.diff(lanes.succ_first))
    ends, starts = lanes.points[lanes.first[1:] - 1], lanes.points[lanes.first[:-1]]
    return np.abs(wrap_angle(ends[source, 3] - starts[lanes.succ, 3]))


def count_types(lanes: LaneTable) -> Counter[str]:
    """Lane pieces by type name."""
    return Counter(LaneType(int(t)).name or str(int(t)) for t in lanes.type)


def compressed(pairs: Sequence[tuple[int, int]], count: int) -> tuple[Ints, Ints]:
    """(first, second) pairs as compressed rows; order within a row as given."""
    first = np.zeros(count + 1, np.int32)
    for row, _ in pairs:
        first[row + 1] += 1
    order = sorted(range(len(pairs)), key=lambda k: pairs[k][0])
    return np.cumsum(first).astype(np.int32), np.array([pairs[k][1] for k in order], np.int32)
