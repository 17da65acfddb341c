"""Paint and kerbs of a town as lines: lane marks of the file, and stop lines drawn as objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from lavsim.map.records import RoadMark
from lavsim.map.section import SectionShape

Floats = NDArray[np.float64]

SPACING = 1.0  # [m] between the points of a line
DOUBLE_GAP = 0.12  # [m] from the middle of a double line to each of its lines
USUAL_WIDTH = 0.12  # [m] where the file gives none
SHORTEST = 1e-3  # [m] of a mark that is drawn
_INSIDE = 1e-7  # [m] before a section's end, which belongs to the next one
_UNSEEN = ("none", "", "grass")


@dataclass(frozen=True, eq=False)
class MarkLine:
    """Paint or kerb along a road.

    Attributes:
        points: (M, 2) polyline in the middle of the paint [m].
        width: [m].
        colour: "white" or "yellow" (others as the file says).
        kind: "solid", "broken" (one polyline; dashes are the drawer's), "curb", "stop" …
        z: (M,) heights of the points [m]; None where the map gives none.
    """

    points: Floats
    width: float
    colour: str
    kind: str
    z: Floats | None = None


def mark_lines(section: SectionShape, lane_id: int, marks: Sequence[RoadMark]) -> Iterator[MarkLine]:
    """The lines at a lane's outer edge; a double mark gives two.

    Args:
        section: Of the lane.
        lane_id: Its OpenDRIVE id.
        marks: Its marks, by where they begin.
    """
    for low, high, mark in _stretches(section, marks):
        if mark.kind in _UNSEEN:
            continue
        s = np.linspace(low, min(high, section.end - _INSIDE), max(2, int(np.ceil((high - low) / SPACING)) + 1))
        t, slope = section.edge(lane_id, s)
        colour = "white" if mark.colour == "standard" else mark.colour
        for kind, aside in _kinds(mark):
            points = section.polyline((t + aside, slope), s)
            yield MarkLine(points[:, :2], mark.width or USUAL_WIDTH, colour, kind, points[:, 2])


def _stretches(section: SectionShape, marks: Sequence[RoadMark]) -> list[tuple[float, float, RoadMark]]:
    """(s of its start, s of its end, mark); equal neighbours are one, or dashes would begin anew between them."""
    stretches: list[tuple[float, float, RoadMark]] = []
    for mark, following in zip_longest(marks, marks[1:]):  # the last one has none, and there may be no mark at all
        low = section.start + mark.s
        high = section.end if following is None else min(section.start + following.s, section.end)
        if high - low < SHORTEST:
            continue
        before = stretches[-1] if stretches else None
        goes_on = before is not None and abs(before[1] - low) < 1e-6
        if before is not None and goes_on and replace(before[2], s=0.0) == replace(mark, s=0.0):
            stretches[-1] = (before[0], high, before[2])
        else:
            stretches.append((low, high, mark))
    return stretches


def _kinds(mark: RoadMark) -> list[tuple[str, float]]:
    """Kind and place across [m] of each line: "solid broken" is two."""
    words = mark.kind.split()
    return [(words[0], 0.0)] if len(words) == 1 else [(words[0], DOUBLE_GAP), (words[1], -DOUBLE_GAP)]


def stop_mark(corners: Floats) -> MarkLine:
    """A painted bar of (N, 2) corners as a line along its long side."""
    centre = corners.mean(axis=0)
    _, _, axes = np.linalg.svd(corners - centre)
    local = (corners - centre) @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    ends = np.stack([centre + axes[0] * low[0], centre + axes[0] * high[0]])
    return MarkLine(ends, float(max(high[1] - low[1], 0.1)), "white", "stop")
