"""Roads and their lane sections as functions of OpenDRIVE's s: where they lie, how high, how wide."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.map.curve import ReferenceLine
from lavsim.map.lane import CHANGE_LEFT, CHANGE_RIGHT
from lavsim.map.records import LaneRecord, Polynomial, RoadRecord, SectionRecord

Floats = NDArray[np.float64]

STEEPEST_BANK = 1.4  # [rad]
SHORTEST = 1e-3  # [m] sections below this are slips of the drawing tool and carry no lane


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
