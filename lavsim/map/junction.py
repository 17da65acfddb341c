"""Junctions of a town: their lanes and the ground they cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from lavsim.map.lane import DRIVABLE, LaneTable
from lavsim.map.records import JunctionRecord


@dataclass(frozen=True, eq=False)
class Junction:
    """Where roads meet.

    Attributes:
        index: Its number in `TownMap.junctions`, as in `LaneTable.junction`.
        id: Its id in the file.
        lanes: All its lanes, of every type.
        polygon: (M, 2) convex hull of its driving lanes with their widths [m], counter-clockwise in numbers.
        controllers: Ids of its controllers in file order.
    """

    index: int
    id: int
    lanes: tuple[int, ...]
    polygon: NDArray[np.float64]
    controllers: tuple[int, ...]

    @property
    def centre(self) -> NDArray[np.float64]:
        """Mean of the hull's corners (2,) [m]."""
        return self.polygon.mean(axis=0)


def build_junction(index: int, record: JunctionRecord, lanes: LaneTable) -> Junction:
    """The junction numbered `index` in the lane table."""
    members = np.flatnonzero(lanes.junction == index)
    driving = members[(lanes.type[members] & DRIVABLE) > 0]
    clouds = [np.zeros((0, 2))]
    for lane in driving if len(driving) else members:
        rows = lanes.rows(int(lane))
        points, half = lanes.points[rows], lanes.width[rows, None] / 2.0
        aside = np.stack([-np.sin(points[:, 3]), np.cos(points[:, 3])], axis=1) * half
        clouds += [points[:, :2] + aside, points[:, :2] - aside]
    cloud = np.concatenate(clouds)
    try:
        polygon = cloud[ConvexHull(cloud).vertices] if len(cloud) >= 3 else cloud
    except QhullError:  # a single straight lane of no width
        polygon = cloud
    return Junction(index, record.id, tuple(int(k) for k in members), polygon, record.controllers)
