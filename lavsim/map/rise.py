"""How steep roads are: the rise of lanes along their centres, and the pitch of what stands on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lavsim.map.town_map import LaneHits, TownMap

Floats = NDArray[np.float64]

LEVEL_RISE = 0.005  # lanes that rise less count as level: their heights are known no better


def rise_along(town: TownMap) -> Floats:
    """(P,) rise over run, in the direction of travel, of the lanes at their centre points."""
    lanes = town.lanes
    rise = np.zeros(len(lanes.points))
    for lane in range(len(lanes)):
        rows = lanes.rows(lane)
        if rows.stop - rows.start > 1 and np.ptp(lanes.points[rows, 2]) > 0.0:
            rise[rows] = np.gradient(lanes.points[rows, 2], lanes.step[lane])
    return rise


def pitch_on(town: TownMap, rise: Floats, hits: LaneHits, yaw: Floats) -> Floats:
    """(N,) pitch [rad], nose up, of what stands on the lanes at `hits` and looks along `yaw`; 0 where there is none.

    Args:
        town: The map.
        rise: `rise_along` the town's lanes.
        hits: The nearest lanes of N places.
        yaw: (N,) headings [rad].
    """
    lanes, on = town.lanes, hits.lane >= 0
    lane = np.where(on, hits.lane, 0)
    first, last = lanes.first[lane].astype(np.int64), lanes.first[lane + 1].astype(np.int64) - 1
    at = np.where(on, hits.u, 0.0) / lanes.step[lane]
    low = np.clip(first + np.floor(at).astype(np.int64), first, last)
    high = np.minimum(low + 1, last)
    share = np.clip(at - (low - first), 0.0, 1.0)
    steep = rise[low] + (rise[high] - rise[low]) * share
    steep = np.where(on & (np.abs(steep) > LEVEL_RISE), steep, 0.0)
    pitch: Floats = np.arctan(steep * np.cos(yaw - np.where(on, hits.yaw, 0.0)))
    return pitch
