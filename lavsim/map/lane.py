"""Lanes as one table of arrays, worked out from the records of an OpenDRIVE file.

Here OpenDRIVE's frame (y north, angles counter-clockwise) becomes the world frame (y south, clockwise). Inside a lane
the coordinate is `u`: metres travelled along the lane's centre line in plan, from where traffic enters it.
"""

from __future__ import annotations

import heapq
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import MapError
from lavsim.geometry import wrap_angle
from lavsim.kernel import kernel
from lavsim.map.curve import ReferenceLine
from lavsim.map.links import LaneLinks, Report
from lavsim.map.opendrive import (
    MAX_COORDINATE,
    JunctionRecord,
    LaneRecord,
    Network,
    Polynomial,
    RoadRecord,
    SectionRecord,
    SpeedRecord,
)
from lavsim.portable_math import snapped
from lavsim.types import LaneType, RoadOption

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

STEP = 0.5  # [m] largest spacing of centre points; a chord over it on a 2.7 m radius lies 1.2 cm off the arc
MAX_GAP = 1.0  # [m] between linked lanes that nobody drives on
MOST_POINTS = 2_000_000  # centre points of a town, 1,000 lane-km; more is a broken file
TOO_LONG = f"the map has more than {MOST_POINTS * STEP / 1000.0:.0f} km of lanes; that is no town."
MOST_LIMITS = 50_000  # speed signs times the lanes for which they count
MOST_JUNCTION_POINTS = 20_000  # 10 km of lanes in one junction
MOST_JUNCTION_WORK = 2_000_000_000  # squares of that, over all junctions
LONGEST_FINE = 20_000.0  # [m] longer sections are no roads, and measured less finely
FARTHEST = 2.0 * MAX_COORDINATE
STEEPEST_BANK = 1.4  # [rad]
SHORTEST = 1e-3  # [m] sections below this are slips of the drawing tool and carry no lane
CHANGE_RIGHT, CHANGE_LEFT = 1, 2  # bits of `LaneTable.change`, CARLA's LaneChange
TURN_THRESHOLD = np.radians(35.0)  # CARLA's GlobalRoutePlanner: less is "straight"
SWEPT_HALF_WIDTH = 1.2  # [m] what a car sweeps beside its lane's centre, for conflicts inside junctions
CLEAR_HEIGHT = 3.0  # [m] lanes farther apart in z don't meet (DESIGN section 2)

LANE_TYPES = {
    "none": LaneType.NONE,
    "driving": LaneType.DRIVING,
    "stop": LaneType.STOP,
    "shoulder": LaneType.SHOULDER,
    "biking": LaneType.BIKING,
    "sidewalk": LaneType.SIDEWALK,
    "border": LaneType.BORDER,
    "restricted": LaneType.RESTRICTED,
    "parking": LaneType.PARKING,
    "bidirectional": LaneType.BIDIRECTIONAL,
    "median": LaneType.MEDIAN,
    "special1": LaneType.SPECIAL1,
    "special2": LaneType.SPECIAL2,
    "special3": LaneType.SPECIAL3,
    "roadworks": LaneType.ROADWORKS,
    "roadWorks": LaneType.ROADWORKS,
    "tram": LaneType.TRAM,
    "rail": LaneType.RAIL,
    "entry": LaneType.ENTRY,
    "exit": LaneType.EXIT,
    "offRamp": LaneType.OFF_RAMP,
    "onRamp": LaneType.ON_RAMP,
}
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


class Profile:
    """Polynomial records as a function of s."""

    def __init__(self, records: Sequence[Polynomial]) -> None:
        self.s = np.array([r.s for r in records])
        self.coefficients = np.array([(r.a, r.b, r.c, r.d) for r in records]).reshape(-1, 4)
        self.is_constant = len(records) == 0 or (
            not self.coefficients[:, 1:].any() and bool(np.ptp(self.coefficients[:, 0]) == 0.0)
        )
        self.first = float(self.coefficients[0, 0]) if len(records) else 0.0

    def __call__(self, s: Floats) -> tuple[Floats, Floats]:
        """Values and slopes at `s`; 0 without records."""
        if not len(self.s):
            return np.zeros_like(s), np.zeros_like(s)
        if self.is_constant:
            return np.full_like(s, self.coefficients[0, 0]), np.zeros_like(s)
        row = np.maximum(np.searchsorted(self.s, s, side="right") - 1, 0)
        a, b, c, d = self.coefficients[row].T
        ds = s - self.s[row]
        return a + ds * (b + ds * (c + ds * d)), b + ds * (2.0 * c + ds * 3.0 * d)


class RoadShape:
    """Reference line and profiles of one road, in OpenDRIVE's frame."""

    def __init__(self, road: RoadRecord) -> None:
        self.road = road
        self.line = ReferenceLine(road.geometry)
        self.elevation = Profile(road.elevation)
        self.superelevation = Profile(road.superelevation)
        self.crossfall = {
            side: Profile([p for of, p in road.crossfall if of in (side, "both")]) for side in ("left", "right")
        }
        self.is_level = not (road.superelevation or road.crossfall or road.shapes)
        self.offset = Profile(road.lane_offset)
        self.section_s = np.array([section.s for section in road.sections] + [road.length])

    def pose(self, s: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """x, y, heading and curvature of the reference line at `s`."""
        return self.line.pose(s)[:4]

    def height(self, s: Floats, t: Floats) -> Floats:
        """z of the road's surface at `s` and lateral `t`: elevation, superelevation, crossfall and shapes."""
        z = self.elevation(s)[0]
        if self.is_level:
            return z
        z = z + t * np.tan(np.clip(self.superelevation(s)[0], -STEEPEST_BANK, STEEPEST_BANK))
        for side, wanted in (("left", t > 0.0), ("right", t < 0.0)):
            fall = np.tan(np.clip(self.crossfall[side](s)[0], -STEEPEST_BANK, STEEPEST_BANK))
            z = z - np.where(wanted, np.abs(t) * fall, 0.0)
        return z + self._shape_height(s, t)

    def _shape_height(self, s: Floats, t: Floats) -> Floats:
        """Height of the cross-section profiles, linear in s between them."""
        shapes = self.road.shapes
        if not shapes:
            return np.zeros_like(s)
        stations = np.array([shape.s for shape in shapes])
        low = np.clip(np.searchsorted(stations, s, side="right") - 1, 0, len(shapes) - 1)
        high = np.minimum(low + 1, len(shapes) - 1)
        values = np.zeros((2, len(s)))
        for out, rows in zip(values, (low, high), strict=True):
            for row in np.unique(rows):
                mine = rows == row
                out[mine] = Profile(shapes[row].pieces)(t[mine])[0]
        share = np.clip((s - stations[low]) / np.maximum(stations[high] - stations[low], 1e-9), 0.0, 1.0)
        return np.asarray(values[0] + share * (values[1] - values[0]))

    def place(self, s: float, t: float, use_offset: bool = False) -> tuple[float, float, float, float]:
        """World x, y, z and yaw [m, rad] of the road point (s, t); `t` from the lane offset if `use_offset`."""
        at = np.array([s])
        x, y, heading, _ = (float(v[0]) for v in self.pose(at))
        if use_offset:
            t = t + float(self.offset(at)[0][0])
        z = float(self.height(at, np.array([t]))[0])
        return x - t * np.sin(heading), -(y + t * np.cos(heading)), z, -heading

    def breakpoints(self, low: float, high: float) -> Floats:
        """Values of s in (low, high) where curvature or a record changes."""
        marks = np.concatenate([self.line.s, self.offset.s])
        return marks[(marks > low + SHORTEST) & (marks < high - SHORTEST)]


class SectionShape:
    """Lateral extent of the lanes of one section."""

    def __init__(self, shape: RoadShape, index: int) -> None:
        self.shape = shape
        self.record: SectionRecord = shape.road.sections[index]
        self.start, self.end = float(shape.section_s[index]), float(shape.section_s[index + 1])
        self.lanes = {lane.id: lane for lane in self.record.lanes}
        self.widths = {lane.id: self._profile(lane.widths) for lane in self.record.lanes if lane.id != 0}
        self.borders = {
            lane.id: self._profile(lane.borders) for lane in self.record.lanes if lane.borders and not lane.widths
        }

    def _profile(self, records: Sequence[Polynomial]) -> Profile:
        return Profile([Polynomial(p.s + self.start, p.a, p.b, p.c, p.d) for p in records])

    def forward(self, lane_id: int) -> bool:
        """Whether travel on a lane runs with s."""
        return (lane_id < 0) != self.shape.road.left_hand

    def edge(self, lane_id: int, s: Floats) -> tuple[Floats, Floats]:
        """t and dt/ds of the outer edge of a lane (of lane 0: the centre line)."""
        t, slope = self.shape.offset(s)
        sign = 1 if lane_id > 0 else -1
        for k in range(sign, lane_id + sign, sign):
            if k in self.borders:
                t, slope = self.borders[k](s)
            else:
                profile = self.widths[k]
                if profile.is_constant:
                    t = t + sign * profile.first
                else:
                    width, change = profile(s)
                    t, slope = t + sign * width, slope + sign * change
        return t, slope

    def centre(self, lane_id: int, s: Floats) -> tuple[Floats, Floats, Floats]:
        """t, dt/ds of the centre of a lane, and its width."""
        sign = 1 if lane_id > 0 else -1
        inner, slope = self.edge(lane_id - sign, s)
        if lane_id in self.borders:
            outer, outer_slope = self.borders[lane_id](s)
            width, change = sign * (outer - inner), sign * (outer_slope - slope)
        else:
            width, change = self.widths[lane_id](s)
        return inner + sign * width / 2.0, slope + sign * change / 2.0, width

    def height(self, lane_id: int, s: Floats, t: Floats) -> Floats:
        """z of a lane's surface at `s` and lateral `t`; level lanes keep the height of their inner edge."""
        lane = self.lanes[lane_id]
        if lane.level and not self.shape.is_level:
            sign = 1 if lane_id > 0 else -1
            inner = lane_id
            while inner - sign != 0 and self.lanes[inner - sign].level:
                inner -= sign
            t = self.edge(inner - sign, s)[0]
        z = self.shape.height(s, t)
        if lane.heights:
            starts = np.array([h[0] for h in lane.heights]) + self.start
            kerb = np.array([(h[1] + h[2]) / 2.0 for h in lane.heights])
            row = np.searchsorted(starts, s, side="right") - 1
            z = z + np.where(row < 0, 0.0, kerb[np.maximum(row, 0)])
        return z

    def breakpoints(self) -> Floats:
        marks = [self.shape.breakpoints(self.start, self.end)]
        marks += [p.s for p in (*self.widths.values(), *self.borders.values()) if not p.is_constant]
        along = np.concatenate(marks)
        return along[(along > self.start + SHORTEST) & (along < self.end - SHORTEST)]

    def polyline(self, t_of: tuple[Floats, Floats], s: Floats) -> Floats:
        """World points `(n, 3)` at `s` and lateral offsets `t_of[0]`."""
        x, y, heading, _ = self.shape.pose(s)
        t = t_of[0]
        return np.stack([x - t * np.sin(heading), -(y + t * np.cos(heading)), self.shape.height(s, t)], axis=1)


def change_bits(section: SectionRecord, lane_id: int, along: Floats, left_hand: bool = False) -> NDArray[np.uint8]:
    """Lane changes that the marks allow at distances `along` from the section's start: 1 right, 2 left.

    A missing record counts as both (CARLA). For lanes with positive id the text's "increase" and "decrease" swap
    sides (reference `carla.md` 3.4). A lane's own mark lies on its right where traffic keeps right, else on its left.
    """
    by_id = {lane.id: lane for lane in section.lanes}
    own, inner = by_id[lane_id], by_id[lane_id + (-1 if lane_id > 0 else 1)]
    own_words, inner_words = ("both", "increase"), ("both", "decrease")
    if lane_id > 0:
        own_words, inner_words = inner_words, own_words
    own_bit, inner_bit = (CHANGE_LEFT, CHANGE_RIGHT) if left_hand else (CHANGE_RIGHT, CHANGE_LEFT)

    def allowed(lane: LaneRecord, words: tuple[str, str]) -> NDArray[np.bool_]:
        if not lane.marks:
            return np.ones(len(along), np.bool_)
        yes = np.array([mark.lane_change in words for mark in lane.marks])
        if len(yes) == 1 or yes.all() or not yes.any():
            return np.full(len(along), yes[0])
        row = np.searchsorted([mark.s for mark in lane.marks], along + 1e-9, side="right") - 1
        return np.where(row < 0, True, yes[np.maximum(row, 0)])

    return (allowed(own, own_words) * own_bit + allowed(inner, inner_words) * inner_bit).astype(np.uint8)


@dataclass
class _Piece:
    """A lane piece on its way into the table."""

    road: RoadRecord
    section: int
    lane: LaneRecord
    shape: SectionShape
    points: Floats
    s: Floats
    width: Floats
    length: float
    change: NDArray[np.uint8]

    @property
    def forward(self) -> bool:
        return self.shape.forward(self.lane.id)


def _measure(
    section: SectionShape, index: int, lane: LaneRecord, nodes: Floats, heading: Floats, stretch: Floats
) -> _Piece:
    """Samples the centre line of one lane at equal travelled lengths."""
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    t, slope, _ = section.centre(lane.id, middle)
    speed = np.hypot(stretch - heading * t, slope)  # du/ds; within a piece of line or arc exact at any point
    u = np.concatenate([[0.0], np.cumsum(speed * np.diff(nodes))])
    length = float(u[-1])
    if not length <= MOST_POINTS * STEP:
        road = section.shape.road
        raise MapError(
            f"line {road.line}: lane {lane.id} of road {road.id} would be {length / 1000.0:.3g} km long; "
            "check its widths."
        )
    count = max(1, int(np.ceil(length / STEP - 1e-9)))
    s = np.interp(np.linspace(0.0, length, count + 1), u, nodes)
    forward = section.forward(lane.id)
    if not forward:
        s = s[::-1].copy()
    # Records that begin exactly where the section ends belong to the next one.
    inside = np.minimum(s, section.end - 1e-7)
    t, slope, width = section.centre(lane.id, inside)
    x, y, phi, curvature, stretch = section.shape.line.pose(inside)
    bend = stretch - curvature * t
    yaw = -(phi + np.arctan2(slope, bend))
    turned = -curvature * bend / np.maximum(bend * bend + slope * slope, 1e-9)
    if not forward:
        yaw, turned = yaw + np.pi, -turned
    points = np.empty((count + 1, 5))
    points[:, 0] = x - t * np.sin(phi)
    points[:, 1] = -(y + t * np.cos(phi))
    points[:, 2] = section.height(lane.id, inside, t)
    farthest = float(np.abs(points[:, :3]).max())
    if farthest > FARTHEST:
        road = section.shape.road
        raise MapError(
            f"line {road.line}: lane {lane.id} of road {road.id} lies {farthest / 1000.0:.3g} km off; "
            "check its widths and curves."
        )
    points[:, 3] = np.unwrap(yaw)
    points[:, 4] = turned
    points = snapped(points)
    change = change_bits(section.record, lane.id, inside - section.start, section.shape.road.left_hand)
    return _Piece(section.shape.road, index, lane, section, points, s, np.maximum(width, 0.0), length, change)


def _pieces(network: Network, shapes: dict[int, RoadShape]) -> list[_Piece]:
    pieces = []
    planned = sum(road.length * max(len(section.lanes) for section in road.sections) for road in network.roads) / STEP
    if planned > MOST_POINTS:
        raise MapError(TOO_LONG)
    total = 0
    for road in network.roads:
        shape = shapes[road.id]
        for index in range(len(road.sections)):
            section = SectionShape(shape, index)
            if section.end - section.start < SHORTEST:
                continue
            # On spirals and cubics du/ds varies between nodes.
            is_fine = shape.line.curves and section.end - section.start < LONGEST_FINE
            spacing = STEP / 2.0 if is_fine else 2.0 * STEP
            count = int(np.ceil((section.end - section.start) / spacing))
            nodes = np.linspace(section.start, section.end, count + 1)
            nodes = np.unique(np.concatenate([nodes, section.breakpoints()]))
            nodes = nodes[np.concatenate([[True], np.diff(nodes) > 1e-9])]
            curvature, stretch = shape.line.pose(0.5 * (nodes[1:] + nodes[:-1]))[3:]
            for lane in section.record.lanes:
                if lane.id != 0:
                    piece = _measure(section, index, lane, nodes, curvature, stretch)
                    if piece.length > SHORTEST and np.isfinite(piece.points).all():
                        pieces.append(piece)
                        total += len(piece.points)
                        if total > MOST_POINTS:
                            raise MapError(f"line {road.line}: {TOO_LONG}")
    return pieces


def _compress(pairs: Sequence[tuple[int, int]], count: int) -> tuple[Ints, Ints]:
    """(first, second) pairs as compressed rows; order within a row as given."""
    first = np.zeros(count + 1, np.int32)
    for row, _ in pairs:
        first[row + 1] += 1
    order = sorted(range(len(pairs)), key=lambda k: pairs[k][0])
    return np.cumsum(first).astype(np.int32), np.array([pairs[k][1] for k in order], np.int32)


def _neighbours(
    pieces: list[_Piece], index: dict[tuple[int, int, int], int], types: Ints
) -> tuple[Ints, Ints, NDArray[np.bool_], NDArray[np.bool_]]:
    left, right = np.full(len(pieces), -1, np.int32), np.full(len(pieces), -1, np.int32)
    change_left, change_right = np.zeros(len(pieces), np.bool_), np.zeros(len(pieces), np.bool_)
    for number, piece in enumerate(pieces):
        lane_id = piece.lane.id
        outward = -1 if lane_id < 0 else 1
        outer, inner = (left, right) if piece.road.left_hand else (right, left)
        for side, other_id in ((outer, lane_id + outward), (inner, lane_id - outward)):
            other = index.get((piece.road.id, piece.section, other_id)) if other_id != 0 else None
            if other is not None and types[other] == types[number]:
                side[number] = other
        change_right[number] = right[number] >= 0 and np.mean(piece.change & CHANGE_RIGHT > 0) >= 0.5
        change_left[number] = left[number] >= 0 and np.mean(piece.change & CHANGE_LEFT > 0) >= 0.5
    return left, right, change_left, change_right


def turn_decision(current: Floats, chosen: Floats, others: Sequence[Floats]) -> RoadOption:
    """Command at a junction, from unit vectors in the world frame.

    Args:
        current: (2,) direction at the end of the lane before the junction.
        chosen: (2,) direction at the end of the way through it.
        others: (2,) chords of the first lanes of the other ways.

    Source: CARLA's GlobalRoutePlanner._turn_decision (0.9.10 to today), reference `carla.md` 3.5.
    """
    cross = float(current[0] * chosen[1] - current[1] * chosen[0])
    deviation = float(np.arccos(np.clip(current @ chosen, -1.0, 1.0)))
    if deviation < TURN_THRESHOLD:
        return RoadOption.STRAIGHT
    crosses = [float(current[0] * other[1] - current[1] * other[0]) for other in others] or [0.0]
    if cross < min(crosses):
        return RoadOption.LEFT
    if cross > max(crosses):
        return RoadOption.RIGHT
    return RoadOption.LEFT if cross < 0.0 else RoadOption.RIGHT


def _turns(
    starts: Floats, ends: Floats, junction: Ints, types: Ints, succ: tuple[Ints, Ints], pred: tuple[Ints, Ints]
) -> NDArray[np.int8]:
    """Command of each junction lane: that of the way in which it leads on."""
    turn = np.full(len(junction), int(RoadOption.LANEFOLLOW), np.int8)
    driving = (types & DRIVABLE) > 0

    def direction(yaw: float) -> Floats:
        return np.array([np.cos(yaw), np.sin(yaw)])

    for lane in np.flatnonzero((junction >= 0) & driving):
        before = [p for p in pred[1][pred[0][lane] : pred[0][lane + 1]] if junction[p] < 0 and driving[p]]
        if not before:
            continue
        siblings = [k for k in succ[1][succ[0][before[0]] : succ[0][before[0] + 1]] if k != lane and driving[k]]
        chords = []
        for other in siblings:
            chord = ends[other, :2] - starts[other, :2]
            chords.append(chord / max(float(np.hypot(*chord)), 1e-9))
        way, tail = [int(lane)], int(lane)
        for _ in range(16):  # junctions whose ways are cut into several roads
            ahead = [k for k in succ[1][succ[0][tail] : succ[0][tail + 1]] if junction[k] >= 0 and driving[k]]
            if not ahead or ahead[0] in way:
                break
            tail = int(ahead[0])
            way.append(tail)
        decision = turn_decision(direction(ends[before[0], 3]), direction(ends[tail, 3]), chords)
        for part in way:
            if part == lane or turn[part] == RoadOption.LANEFOLLOW:
                turn[part] = decision
    return turn


@kernel
def _meet(own: Floats, cloud: Floats, owner: Ints, reach: float, near: NDArray[np.bool_]) -> None:
    """Sets `near` (n, lanes) where a point of `own` has one of a lane within `reach` in plan, `CLEAR_HEIGHT` in z."""
    for i in range(len(own)):
        for k in range(len(cloud)):
            dx, dy = own[i, 0] - cloud[k, 0], own[i, 1] - cloud[k, 1]
            if dx**2 + dy**2 < reach**2 and abs(own[i, 2] - cloud[k, 2]) < CLEAR_HEIGHT:
                near[i, owner[k]] = True


def _conflicts(
    first: Ints,
    step: Floats,
    points: Floats,
    junction: Ints,
    types: Ints,
    road_id: Ints,
    pairs: Sequence[tuple[int, int]],
) -> tuple[Ints, Ints, Floats]:
    """Where driving lanes of a junction sweep the same ground."""
    before: dict[int, set[int]] = {}
    chained = set(pairs)
    for source, target in pairs:
        before.setdefault(target, set()).add(source)
    reach = 2.0 * SWEPT_HALF_WIDTH
    found: list[tuple[int, int]] = []
    spans: list[tuple[float, float]] = []
    work = 0
    for number in range(int(junction.max(initial=-1)) + 1):
        lanes = np.flatnonzero((junction == number) & ((types & int(LaneType.DRIVING)) > 0))
        rows = [np.arange(first[k], first[k + 1]) for k in lanes]
        if not rows:
            continue
        if sum(map(len, rows)) > MOST_JUNCTION_POINTS:
            total = sum(map(len, rows)) * STEP / 1000.0
            raise MapError(f"the junction of road {road_id[lanes[0]]} has {total:.3g} km of lanes; check their widths.")
        work += sum(map(len, rows)) ** 2
        if work > MOST_JUNCTION_WORK:
            raise MapError("the map has too many junctions with too many lanes each; that is no town.")
        everything = np.concatenate(rows)
        owner = np.repeat(np.arange(len(lanes), dtype=np.int32), [len(r) for r in rows])
        cloud = points[everything]
        for a, lane in enumerate(lanes):
            low, high = points[rows[a]].min(axis=0) - reach, points[rows[a]].max(axis=0) + reach
            around = ((cloud[:, :2] >= low[:2]) & (cloud[:, :2] <= high[:2])).all(axis=1)
            near = np.zeros((len(rows[a]), len(lanes)), np.bool_)
            _meet(points[rows[a]], cloud[around], owner[around], reach, near)
            for b in np.flatnonzero(near.any(axis=0)):
                other = int(lanes[b])
                if other == lane or (lane, other) in chained or (other, lane) in chained:
                    continue
                if before.get(int(lane), set()) & before.get(other, set()):
                    continue
                at = np.flatnonzero(near[:, b])
                found.append((int(lane), other))
                spans.append((float(at[0] * step[lane]), float(at[-1] * step[lane])))
    order = sorted(range(len(found)), key=lambda k: found[k])
    first_row, other_lane = _compress([found[k] for k in order], len(junction))
    return first_row, other_lane, np.array([spans[k] for k in order], np.float64).reshape(-1, 2)


DEFAULT_LIMIT = 30.0 / 3.6  # [m/s] CARLA's limit before the first sign


def build_lanes(
    network: Network,
    shapes: dict[int, RoadShape],
    junctions: Sequence[JunctionRecord],
    limits: dict[int, list[tuple[float, tuple[tuple[int, int], ...], float]]],
    report: Report,
) -> LaneTable:
    """The lanes of a town.

    Args:
        network: The file's records.
        shapes: Road shapes by road id.
        junctions: Junctions in the order in which the table numbers them.
        limits: Speed signs by road id: (s, lane id ranges, limit [m/s]); empty when the town has none.
        report: Takes up what was wrong with links.

    Raises:
        MapError: no lane has a length.
    """
    pieces = _pieces(network, shapes)
    if not pieces:
        raise MapError("the map has no lane of any length.")
    count = len(pieces)
    index = {(p.road.id, p.section, p.lane.id): k for k, p in enumerate(pieces)}
    number_of = {junction.id: k for k, junction in enumerate(junctions)}
    types = np.array([int(LANE_TYPES.get(p.lane.kind, LaneType.NONE)) for p in pieces], np.int32)
    junction = np.array([number_of.get(p.road.junction, -1) for p in pieces], np.int32)
    sizes = np.array([len(p.points) for p in pieces])
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    points = np.concatenate([p.points for p in pieces])
    length = np.array([p.length for p in pieces])
    step = length / (sizes - 1)
    road_id = np.array([p.road.id for p in pieces], np.int32)
    reach = {i: np.stack(s.pose(np.array([0.0, s.road.length]))[:2], axis=1) for i, s in shapes.items()}
    pairs = [
        (a, b)
        for a, b in LaneLinks(network, pieces, index, reach, report).pairs()
        if (types[a] & DRIVABLE and types[b] & DRIVABLE)
        # Sidewalks and shoulders have no direction of travel; a link that only fits the other way is no link.
        or (types[a] == types[b] and np.hypot(*(pieces[a].points[-1, :2] - pieces[b].points[0, :2])) < MAX_GAP)
    ]
    succ = _compress(pairs, count)
    pred = _compress([(b, a) for a, b in pairs], count)
    left, right, change_left, change_right = _neighbours(pieces, index, types)
    starts, ends = points[first[:-1]], points[first[1:] - 1]
    speed_limit, limit_first, limit_u, limit = _speed_limits(pieces, pred, length, limits)
    conflict_first, conflict, conflict_u = _conflicts(first, step, points, junction, types, road_id, pairs)
    forward = np.array([p.forward for p in pieces])
    low, high = np.array([p.shape.start for p in pieces]), np.array([p.shape.end for p in pieces])
    return LaneTable(
        road_id=road_id,
        section=np.array([p.section for p in pieces], np.int32),
        lane_id=np.array([p.lane.id for p in pieces], np.int32),
        type=types,
        junction=junction,
        length=length,
        s_start=np.where(forward, low, high),
        s_end=np.where(forward, high, low),
        first=first,
        step=step,
        points=points,
        point_s=np.concatenate([p.s for p in pieces]),
        width=np.concatenate([p.width for p in pieces]),
        change=np.concatenate([p.change for p in pieces]),
        succ_first=succ[0],
        succ=succ[1],
        pred_first=pred[0],
        pred=pred[1],
        left=left,
        right=right,
        change_left=change_left,
        change_right=change_right,
        speed_limit=speed_limit,
        limit_first=limit_first,
        limit_u=limit_u,
        limit=limit,
        light=np.full(count, -1, np.int32),  # filled in once the lights are known
        sign=np.full(count, -1, np.int32),
        conflict_first=conflict_first,
        conflict=conflict,
        conflict_u=conflict_u,
        turn=_turns(starts, ends, junction, types, succ, pred),
    )


def _at(sign: tuple[float, tuple[tuple[int, int], ...], float]) -> float:
    return sign[0]


def _limit_steps(speeds: Sequence[SpeedRecord], low: float, high: float, forward: bool) -> list[tuple[float, float]]:
    """(share of the lane travelled, limit [m/s] from there on) between s `low` and `high`."""
    inside = [speed for speed in speeds if speed.s < high]
    before = [speed for speed in inside if speed.s <= low]
    inside = [*before[-1:], *(speed for speed in inside if speed.s > low)]
    if not inside:
        return []
    starts = [low, *(speed.s for speed in inside[1:]), high]
    if forward:
        return [((a - low) / (high - low), speed.limit) for a, speed in zip(starts, inside, strict=False)]
    return [((high - b) / (high - low), speed.limit) for b, speed in zip(starts[1:], inside, strict=True)][::-1]


def _speed_limits(
    pieces: list[_Piece],
    pred: tuple[Ints, Ints],
    length: Floats,
    limits: dict[int, list[tuple[float, tuple[tuple[int, int], ...], float]]],
) -> tuple[Floats, Ints, Floats, Floats]:
    """One limit a lane piece, which holds over the longest part of it; and all its limits as compressed rows.

    Signs hold from where they stand until the next one, across lane links (CARLA's sticky signs); where several ways
    lead in, the lowest limit counts. A town without signs goes by its roads' speed records. Lanes that neither
    reaches have 30 km/h; junction roads without a record take the limit of what leads in.
    """
    count = len(pieces)
    own = np.full(count, np.nan)  # over the longest part of the lane
    leaving = np.full(count, np.nan)  # at its end
    along_lane: list[list[tuple[float, float]]] = []
    standing = {road: sorted(signs, key=_at) for road, signs in limits.items()}
    told = 0
    for k, piece in enumerate(pieces):
        records: list[tuple[float, float]] = []  # (share of the lane travelled, limit)
        low, high = piece.shape.start, piece.shape.end
        signs = standing.get(piece.road.id, [])
        for s, ranges, limit in signs[bisect_left(signs, low, key=_at) : bisect_right(signs, high, key=_at)]:
            if any(a <= piece.lane.id <= b for a, b in ranges):
                share = (s - low) / (high - low)
                records.append((share if piece.forward else 1.0 - share, limit))
        told += len(records)
        if told > MOST_LIMITS:
            raise MapError(f"line {piece.road.line}: too many speed signs over too many lanes; that is no town.")
        if not limits:
            own_speeds = [SpeedRecord(low + speed.s, speed.limit) for speed in piece.lane.speeds]
            records = _limit_steps(own_speeds or piece.road.speeds, low, high, piece.forward)
        records.sort()
        along_lane.append(records)
        if records:
            marks = [r[0] for r in records] + [1.0]
            shares: dict[float, float] = {}
            for (at, limit), end in zip(records, marks[1:], strict=True):
                shares[limit] = shares.get(limit, 0.0) + end - at
            best = max(shares, key=lambda limit: (shares[limit], -limit))
            leaving[k] = records[-1][1]
            if shares[best] >= marks[0]:
                own[k] = best
    known = ~np.isnan(leaving)
    arriving = np.full(count, np.nan)
    follow: dict[int, list[int]] = {}
    for k in range(count):
        for p in pred[1][pred[0][k] : pred[0][k + 1]]:
            follow.setdefault(int(p), []).append(k)
    # The lowest limit that any way brings: lanes are settled in rising order of it.
    rising = [(float(leaving[k]), int(k)) for k in np.flatnonzero(known)]
    heapq.heapify(rising)
    while rising:
        limit, k = heapq.heappop(rising)
        for following in follow.get(k, ()):
            if np.isnan(arriving[following]):
                arriving[following] = limit
                if not known[following]:
                    heapq.heappush(rising, (limit, following))
    limit_of = np.where(np.isnan(own), arriving, own)
    first, along, values = [0], [], []
    for k in range(count):
        steps = [(0.0, DEFAULT_LIMIT if np.isnan(arriving[k]) else float(arriving[k])), *along_lane[k]]
        if len(steps) > 1 and steps[1][0] <= 0.0:
            steps = steps[1:]
        along += [share * float(length[k]) for share, _ in steps]
        values += [limit for _, limit in steps]
        first.append(len(along))
    return (
        np.where(np.isnan(limit_of), DEFAULT_LIMIT, limit_of),
        np.array(first, np.int32),
        np.array(along),
        np.array(values),
    )


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
