"""Places on the ego's lane and beside it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lavsim.map.waypoint import MOST_STEPS, Waypoint
from lavsim.scenarios.place import Site, beside, line_ahead
from lavsim.types import LaneType

NARROWEST_SLOT = 1.9  # [m] a parking lane where a car can stand


def sign_of(direction: str) -> float:
    """+1 for "right", -1 for "left": offsets count to the right."""
    return 1.0 if direction == "right" else -1.0


def lane_ahead(site: Site, distance: float) -> Waypoint | None:
    """The lane centre `distance` metres after the trigger, by the route's branches; None beyond the end of the road."""
    lanes = site.town.lanes
    own = set(site.route.lane[site.index :].tolist())
    lane, u = site.anchor.lane, site.anchor.u + distance
    for _ in range(MOST_STEPS):
        length = float(lanes.length[lane])
        if u <= length:
            return Waypoint(site.town, lane, u)
        following = [int(k) for k in lanes.successors(lane)]
        if not following:
            return None
        lane, u = next((k for k in following if k in own), following[0]), u - length
    return None


def must_be_ahead(site: Site, distance: float) -> Waypoint:
    """`lane_ahead` of a place that `fits` has seen to be there."""
    place = lane_ahead(site, distance)
    assert place is not None
    return place


def own_line(site: Site, start: Waypoint, length: float) -> NDArray[np.float64]:
    """Lane centres (N, 2) from `start` on for `length` metres, by the route's branches [m]."""
    own = set(site.route.lane[site.index :].tolist())
    return line_ahead(start, length, lambda _, lanes: next((lane for lane in lanes if lane in own), lanes[0]))


def parking_beside(waypoint: Waypoint, side: str) -> Waypoint | None:
    """The parking lane beside the outermost lane on `side`, wide enough for a car; None where there is none."""
    step: Callable[[Waypoint], Waypoint | None] = Waypoint.right if side == "right" else Waypoint.left
    lane = waypoint
    while (other := beside(lane, side)) is not None:
        lane = other
    found = step(lane)
    if found is None or not found.lane_type & LaneType.PARKING or found.width < NARROWEST_SLOT:
        return None
    return found
