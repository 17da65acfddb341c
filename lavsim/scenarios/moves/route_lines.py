"""Lines of streams: between places that a route file names, or beside the ego's lane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.planner import get_planner
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.parameters import Location
from lavsim.scenarios.place import Site, beside, join, line_ahead, line_behind, oncoming, outermost

Line = NDArray[np.float64]


def line_between(site: Site, start: Location, end: Location, every_lane: bool = False) -> list[Line]:
    """The shortest way from `start` to `end`; with `every_lane` those of all lanes of that direction at its ends.

    Raises:
        RouteError: a place is off the road, or no way leads there.
    """
    first, last = _waypoint(site, start), _waypoint(site, end)
    pairs = [(first, last)]
    if every_lane:
        ends = _lanes(last)
        pairs = [(lane, ends[min(k, len(ends) - 1)]) for k, lane in enumerate(_lanes(first))]
    return [_line(site, a, b) for a, b in pairs]


def oncoming_between(site: Site, start: Location, end: Location) -> list[Line]:
    """The way back on the lanes of the other direction; empty where the road has none.

    Raises:
        RouteError: no way leads there.
    """
    first, last = oncoming(_waypoint(site, end)), oncoming(_waypoint(site, start))
    return [] if first is None or last is None else [_line(site, first, last)]


def line_beside(site: Site, side: str, behind: float, ahead: float) -> Line | None:
    """The lane beside the trigger from `behind` metres before to `ahead` metres after it; None at the edge."""
    lane = beside(site.anchor, side)
    return None if lane is None else join(line_behind(lane, behind), line_ahead(lane, ahead))


def _waypoint(site: Site, place: Location) -> Waypoint:
    return get_planner(site.town).locate(np.array([place[:3]]))[0]


def _lanes(waypoint: Waypoint) -> list[Waypoint]:
    """All lanes of its direction, from the right."""
    lane: Waypoint | None = outermost(waypoint, "right")[0]
    found = []
    while lane is not None:
        found.append(lane)
        lane = beside(lane, "left")
    return found


def _line(site: Site, start: Waypoint, end: Waypoint) -> Line:
    route = get_planner(site.town).trace(np.array([start.xyz, end.xyz]))
    return join(route.xy)
