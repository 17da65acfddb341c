"""The dense route about the ego: its next points, its limit, and the next light and stop sign on it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.columns import ROUTE_POINTS
from lavsim.geometry import to_local
from lavsim.map.route import Route, RouteTracker
from lavsim.map.stop_lines import StopLine
from lavsim.map.town_map import TownMap
from lavsim.types import LightState
from lavsim.world.snapshot import Snapshot

SIGHT = 100.0  # [m] lights and signs farther ahead are not told
_BEHIND = 2.0  # [m] a line stays the next one until the ego's front is that far over it
_WINDOW = 5  # route points ahead that may become the nearest one

Lines = tuple[NDArray[np.float64], NDArray[np.int64]]  # places along the route [m], ascending, and whose they are


class RouteView:
    """Follows the ego along its route, tick by tick.

    Args:
        route: The dense route.
        town: Its town.

    Attributes:
        lights: Where the route crosses the stop lines of lights, and whose.
        stop_signs: The same of stop signs.
    """

    def __init__(self, route: Route, town: TownMap) -> None:
        self._route, self._town = route, town
        self._tracker = RouteTracker(route, _WINDOW)
        self.lights = _lines(route, ((light.index, line) for light in town.lights for line in light.stop_lines))
        self.stop_signs = _lines(
            route,
            ((sign.index, line) for sign in town.signs if sign.kind == "stop" for line in sign.stop_lines),
        )

    def update(self, snapshot: Snapshot) -> None:
        """Moves on to a tick."""
        self._tracker.update(snapshot.xy[0])

    def columns(self, snapshot: Snapshot) -> dict[str, Any]:
        """Fields of the frame at the tick of the last update."""
        route, index, ego = self._route, self._tracker.index, snapshot.ego
        points = route.points[np.minimum(np.arange(index, index + ROUTE_POINTS), len(route) - 1), :2]
        lane = int(route.lane[index])
        # The nearest point is up to half a metre off; what the ego is past it counts.
        along = float(route.distance[index]) + float(
            (ego.xy - route.points[index, :2]) @ (np.cos(route.yaw[index]), np.sin(route.yaw[index]))
        )
        front = along + ego.length / 2.0
        light, light_distance = _next(self.lights, front)
        sign, sign_distance = _next(self.stop_signs, front)
        return {
            "route": to_local(points, ego.xy, ego.yaw),
            "route_index": index,
            "route_distance": route.distance[index],
            "speed_limit": self._town.lanes.speed_limit[lane],
            "in_junction": self._town.lanes.junction[lane] >= 0,
            "lights": snapshot.lights,
            "light": light,
            "light_state": snapshot.lights[light] if light >= 0 else LightState.UNKNOWN,
            "light_distance": light_distance,
            "stop_sign": sign,
            "stop_sign_distance": sign_distance,
        }


def _lines(route: Route, lines: Iterable[tuple[int, StopLine]]) -> Lines:
    """Where the route crosses stop lines; one that it passes twice is there twice."""
    by_lane: dict[int, list[tuple[int, StopLine]]] = {}
    for number, line in lines:
        by_lane.setdefault(line.lane, []).append((number, line))
    found: list[tuple[float, int]] = []
    starts = np.flatnonzero(np.diff(route.lane, prepend=-1))
    for first, end in zip(starts.tolist(), [*starts[1:].tolist(), len(route)], strict=True):
        if end == len(route) or int(route.lane[first]) not in by_lane:
            continue  # nothing is crossed on the last lane, or by one that a lane change leaves before its end
        last = end - 1
        for number, line in by_lane[int(route.lane[first])]:
            if line.u - float(route.u[last]) < 2.5:
                found.append((float(route.distance[last]) + line.u - float(route.u[last]), number))
    found.sort()
    places, whose = zip(*found, strict=True) if found else ((), ())
    return np.array(places, np.float64), np.array(whose, np.int64)


def _next(lines: Lines, front: float) -> tuple[int, float]:
    """Whose line is next ahead of the ego's front, and how far it is; -1 and NaN if none is in sight."""
    places, whose = lines
    at = int(np.searchsorted(places, front - _BEHIND))
    if at == len(places) or places[at] - front > SIGHT:
        return -1, float("nan")
    return int(whose[at]), float(places[at] - front)
