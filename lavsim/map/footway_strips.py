"""Strips of ground to walk on: sidewalk lanes as the map draws them, and what joins their ends by geometry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lavsim.geometry import right
from lavsim.map.lane import DRIVABLE
from lavsim.map.roadside import lane_pieces
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType

Floats = NDArray[np.float64]

NARROWEST = 0.8  # [m] of a sidewalk that is walked on
SHORTEST = 0.6  # [m] shorter strips are slips of the drawing tool
JOIN = 1.0  # [m] ends of strips nearer than this are one place
LEVEL = 1.5  # [m] strips farther apart in z don't join
SAME = 0.5  # [m] a strip within this of others all along is drawn twice
LONGEST_LINK = 14.0  # [m] round a corner where the map has no sidewalk


@dataclass(frozen=True)
class Strip:
    """A band to walk on.

    Attributes:
        points: (n, 3) its middle [m]; sidewalks about 0.5 m apart.
        half: (n,) half its width [m].
        lane: The lane it was made from, -1 for a link.
    """

    points: Floats
    half: Floats
    lane: int = -1

    @property
    def length(self) -> float:
        return float(np.hypot(*np.diff(self.points[:, :2], axis=0).T).sum())

    def outward(self, end: int) -> Floats:
        """Unit vector (2,) that leads out of the strip at its start (0) or end (1)."""
        a, b = (self.points[0], self.points[min(2, len(self.points) - 1)]) if end == 0 else (
            self.points[-1], self.points[max(-3, -len(self.points))])  # fmt: skip
        away = a[:2] - b[:2]
        return np.asarray(away / max(float(np.hypot(*away)), 1e-9))


def sidewalk_strips(town: TownMap) -> list[Strip]:
    """Sidewalk lanes of a town; those side by side as one strip, those drawn twice once."""
    lanes = town.lanes
    found = []
    for lane in lanes.where(LaneType.SIDEWALK).tolist():
        if lanes.left[lane] >= 0:
            continue  # taken up with the lane to its left
        row = [lane]
        while lanes.right[row[-1]] >= 0 and lanes.right[row[-1]] not in row:
            row.append(int(lanes.right[row[-1]]))
        strip = _wide_part(_side_by_side(town, row))
        if strip is not None and strip.length >= SHORTEST:
            found.append(strip)
    return _without_doubles(found)


def _side_by_side(town: TownMap, row: list[int]) -> Strip:
    """Lanes from left to right as one strip."""
    lanes = town.lanes
    first, last = row[0], row[-1]
    points, half = lanes.centre_line(first), lanes.width[lanes.rows(first)] / 2.0
    if len(row) == 1:
        return Strip(points[:, :3], half, first)
    other, other_half = lanes.centre_line(last), lanes.width[lanes.rows(last)] / 2.0
    left_edge = points[:, :3].copy()
    left_edge[:, :2] -= right(points[:, 3]) * half[:, None]
    right_edge = other[:, :3].copy()
    right_edge[:, :2] += right(other[:, 3]) * other_half[:, None]
    share = np.linspace(0.0, 1.0, len(points))
    along = np.linspace(0.0, 1.0, len(other))
    matched = np.column_stack([np.interp(share, along, right_edge[:, k]) for k in range(3)])
    width = np.hypot(*(matched - left_edge)[:, :2].T)
    return Strip((left_edge + matched) / 2.0, width / 2.0, first)


def _wide_part(strip: Strip) -> Strip | None:
    """The longest part that is wide enough; sidewalks taper where they begin and end."""
    wide = np.concatenate([[False], 2.0 * strip.half >= NARROWEST, [False]])
    marks = np.flatnonzero(np.diff(wide.astype(np.int8)))
    if not len(marks):
        return None
    spans = marks.reshape(-1, 2)
    begin, end = spans[np.argmax(spans[:, 1] - spans[:, 0])].tolist()
    return Strip(strip.points[begin:end], strip.half[begin:end], strip.lane) if end - begin >= 2 else None


def _without_doubles(strips: list[Strip]) -> list[Strip]:
    """Strips that do not lie on longer ones."""
    if not strips:
        return []
    order = sorted(range(len(strips)), key=lambda k: (-strips[k].length, k))
    tree, owner, _ = point_tree(strips)
    rank = np.empty(len(strips), np.int64)
    rank[order] = np.arange(len(strips))
    dropped: set[int] = set()
    for k in order[::-1]:
        near: Sequence[list[int]] = tree.query_ball_point(strips[k].points, SAME)  # type: ignore[assignment]
        covered = [any(rank[owner[p]] < rank[k] and owner[p] not in dropped for p in hit) for hit in near]
        if np.mean(covered) > 0.9:
            dropped.add(k)
    return [strip for k, strip in enumerate(strips) if k not in dropped]


def point_tree(strips: list[Strip]) -> tuple[cKDTree, NDArray[np.int64], NDArray[np.int64]]:
    """All points of `strips` (x, y, z) in a search tree, the strip of each, and its number in it."""
    points = np.concatenate([strip.points for strip in strips])
    owner = np.repeat(np.arange(len(strips)), [len(strip.points) for strip in strips])
    number = np.concatenate([np.arange(len(strip.points)) for strip in strips])
    return cKDTree(points), owner, number


class Roadway:
    """The ground of vehicles."""

    def __init__(self, town: TownMap) -> None:
        shapes, owner = lane_pieces(town)
        lanes = town.lanes
        driven = (lanes.type[owner] & DRIVABLE) > 0
        self._tree = shapely.STRtree(shapes[driven])
        self._z = lanes.points[lanes.first[owner[driven]], 2]

    def meets(self, line: Floats) -> bool:
        """Whether a line (n, 3) comes onto a driven lane of about its height."""
        hits = self._tree.query(shapely.linestrings(line[:, :2]), predicate="intersects")
        return bool(np.any(np.abs(self._z[hits] - line[:, 2].mean()) < 3.0))


def links(strips: list[Strip], town: TownMap) -> Iterator[tuple[tuple[int, int], tuple[int, int], Strip]]:
    """Ways round corners that the map leaves out: between loose ends near each other, off the roadway.

    Yields:
        (strip, end) of both, and the strip between them.
    """
    ends = np.array([strip.points[-end] for strip in strips for end in (0, 1)]).reshape(-1, 3)
    if not len(ends):
        return
    tree = cKDTree(ends)
    loose = [k for k, near in enumerate(tree.query_ball_point(ends, JOIN)) if len(near) == 1]
    pairs = []
    for place, k in enumerate(loose):
        for other in loose[place + 1 :]:
            apart = float(np.hypot(*(ends[k] - ends[other])[:2]))
            if k // 2 != other // 2 and apart < LONGEST_LINK and abs(ends[k, 2] - ends[other, 2]) < LEVEL:
                pairs.append((apart, k, other))
    if not pairs:
        return
    roadway, taken = Roadway(town), set()
    for _, k, other in sorted(pairs):
        if k in taken or other in taken:
            continue
        strip = _link(strips[k // 2], k % 2, strips[other // 2], other % 2)
        if strip is not None and not roadway.meets(strip.points):
            taken |= {k, other}
            yield (k // 2, k % 2), (other // 2, other % 2), strip


def _link(first: Strip, first_end: int, second: Strip, second_end: int) -> Strip | None:
    """A smooth way from one end to another; None if it would lead back along either strip."""
    a, b = first.points[-first_end], second.points[-second_end]
    gap = b - a
    apart = max(float(np.hypot(*gap[:2])), 1e-9)
    out_a, out_b = first.outward(first_end), second.outward(second_end)
    if out_a @ gap[:2] < -0.2 * apart or out_b @ gap[:2] > 0.2 * apart:
        return None
    if out_a @ out_b > 0.5:
        return None  # round the end of a road rather than round a corner
    t = np.linspace(0.0, 1.0, max(3, int(np.ceil(apart / 0.5)) + 1))[:, None]
    pull = 0.45 * apart
    control = np.array([a[:2], a[:2] + pull * out_a, b[:2] + pull * out_b, b[:2]])
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    half = min(float(first.half[-first_end]), float(second.half[-second_end]))
    return Strip(np.column_stack([weights @ control, a[2] + t * gap[2]]), np.full(len(t), half))
