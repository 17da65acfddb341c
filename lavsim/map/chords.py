"""Projection onto lanes as CARLA does it: onto chords of the lane centres, not onto the curves.

CARLA cuts each lane centre into chords: from where travel enters, 1 m of s at a time, a chord ends as soon as the
heading has turned by more than 1.8 degrees or it is longer than 100 m; a lane on one straight line whose widths and
elevation are linear is one chord. A point is projected onto the nearest chord in 3D, and s is the chord's start plus
the distance along it in plan. In bends this differs from the nearest point of the curve by some decimetres.

Source: LibCarla `Map::CreateRtree`, `GetClosestWaypointOnRoad`, `Lane::IsStraight` (0.9.10 to 0.9.16); reference
`carla.md` 3.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel

if TYPE_CHECKING:
    from lavsim.map.section import SectionShape
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

STEP = 1.0  # [m of s]
MOST_TURN = np.pi / 100.0  # [rad]
LONGEST = 100.0  # [m of s]


@dataclass(frozen=True, eq=False)
class Chords:
    """Chords of all lanes.

    Attributes:
        lane: (C,) int32.
        start, end: (C, 3) world points [m].
        s_start, s_end: (C,) OpenDRIVE s of them [m], in the direction of travel.
    """

    lane: Ints
    start: Floats
    end: Floats
    s_start: Floats
    s_end: Floats

    def nearest(self, wanted: NDArray[np.bool_], points: Floats) -> tuple[Ints, Floats]:
        """Lane (-1 where there is none) and s of `points` (N, 3); `wanted` (L,) tells which lanes count."""
        rows = np.flatnonzero(wanted[self.lane])
        chord, along = np.full(len(points), -1, np.int32), np.zeros(len(points))
        low, high = np.minimum(self.start, self.end)[rows], np.maximum(self.start, self.end)[rows]
        _nearest(np.ascontiguousarray(points), self.start[rows], self.end[rows], low, high, chord, along)
        if not len(rows):
            return np.full(len(points), -1, np.int32), np.full(len(points), np.nan)
        row = rows[np.maximum(chord, 0)]
        length = np.hypot(*(self.end[row, :2] - self.start[row, :2]).T) * along
        first, last = self.s_start[row], self.s_end[row]
        s = np.where(last >= first, np.minimum(first + length, last), np.maximum(first - length, last))
        return np.where(chord >= 0, self.lane[row], -1).astype(np.int32), np.where(chord >= 0, s, np.nan)


@kernel
def _nearest(points: Floats, start: Floats, end: Floats, low: Floats, high: Floats, chord: Ints, along: Floats) -> None:
    for n in range(len(points)):
        best = np.inf
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
            continue
        for k in range(len(start)):
            bx = max(low[k, 0] - x, x - high[k, 0], 0.0)
            by = max(low[k, 1] - y, y - high[k, 1], 0.0)
            if bx * bx + by * by >= best:
                continue
            dx, dy, dz = end[k, 0] - start[k, 0], end[k, 1] - start[k, 1], end[k, 2] - start[k, 2]
            ex, ey, ez = x - start[k, 0], y - start[k, 1], z - start[k, 2]
            norm = dx * dx + dy * dy + dz * dz
            t = min(max((ex * dx + ey * dy + ez * dz) / norm, 0.0), 1.0) if norm > 0.0 else 0.0
            d = (ex - t * dx) ** 2 + (ey - t * dy) ** 2 + (ez - t * dz) ** 2
            if d < best:
                best = d
                plan = dx * dx + dy * dy
                along[n] = min(max((ex * dx + ey * dy) / plan, 0.0), 1.0) if plan > 0.0 else 0.0
                chord[n] = k


@kernel
def _cut(direction: Floats, s: Floats) -> Floats:
    """Indexes at which chords end, given unit headings (n, 3) at `s` (n,)."""
    ends = np.zeros(len(s))
    count, first = 0, 0
    for k in range(1, len(s)):
        dot = 0.0
        for c in range(3):
            dot += direction[first, c] * direction[k, c]
        angle = np.arccos(min(max(dot, -1.0), 1.0))
        if angle > MOST_TURN or abs(s[k] - s[first]) > LONGEST:
            ends[count] = k
            count += 1
            first = k
    if count == 0 or ends[count - 1] != len(s) - 1:
        ends[count] = len(s) - 1
        count += 1
    return ends[:count]


def _is_straight(section: SectionShape, lane_id: int) -> bool:
    """Whether CARLA takes a lane for straight; the lane offset is not looked at."""
    road = section.shape.road
    row = max(int(np.searchsorted(section.shape.line.s, section.start, side="right")) - 1, 0)
    piece = road.geometry[row]
    if piece.curvature != 0.0 or piece.end_curvature is not None or piece.cubic is not None:
        return False
    if section.start < piece.s or section.end > piece.s + piece.length:
        return False
    records = [*road.elevation, *section.lanes[lane_id].widths]
    return not any(record.c or record.d for record in records)


def build_chords(town: TownMap) -> Chords:
    """The chords of a town."""
    lanes = town.lanes
    owner, starts, ends, first_s, last_s = [], [], [], [], []
    for lane in range(len(lanes)):
        section = town.section(int(lanes.road_id[lane]), int(lanes.section[lane]))
        lane_id = int(lanes.lane_id[lane])
        a, b = float(lanes.s_start[lane]), float(lanes.s_end[lane])
        length = abs(b - a)
        straight = _is_straight(section, lane_id)
        steps = np.array([0.0, length]) if straight else np.append(np.arange(0.0, length - 1e-6, STEP), length)
        s = a + np.sign(b - a) * steps
        xyz, heading, pitch = town.poses(lane, s)
        if straight:
            cuts = np.array([0, 1])
        else:
            flat = np.cos(pitch)
            direction = np.stack([flat * np.cos(heading), flat * np.sin(heading), np.sin(pitch)], axis=1)
            cuts = np.concatenate([[0], _cut(direction, s).astype(np.int64)])
        owner.append(np.full(len(cuts) - 1, lane, np.int32))
        starts.append(xyz[cuts[:-1]])
        ends.append(xyz[cuts[1:]])
        first_s.append(s[cuts[:-1]])
        last_s.append(s[cuts[1:]])
    return Chords(
        np.concatenate(owner), np.concatenate(starts), np.concatenate(ends), np.concatenate(first_s),
        np.concatenate(last_s),
    )  # fmt: skip
