"""Leaving the route for good."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place, place_text

REASON = "Agent deviated from the route"


@CRITERIA.register("route_deviation")
class RouteDeviation(Criterion):
    """Ends the drive 30 m off the route, or after 30 % of its length were passed 15 m or more off.

    The route point it measures to slides at most 5 points ahead and never back, so leaving the route and joining it
    again farther along is measured to the old place.
    """

    name = "route_deviation"
    order = 70
    charges = (Charge("route_dev", "Route deviations", 10, reason=REASON),)

    farthest = 30.0  # [m] and beyond: fails at once
    safe = 15.0  # [m] below: costs nothing
    share = 30.0  # [percent] of the route's length that may be passed less safely, at most
    window = 5  # points ahead

    def start(self, town: TownMap, route: Route) -> None:
        self._points = [(float(x), float(y)) for x, y in route.points[:, :2]]
        self._distance = [float(d) for d in route.distance]
        self._index = 0
        self._out = 0.0

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        ego = snapshot.ego
        nearest, closest = float("inf"), self._index
        for index in range(self._index, min(self._index + self.window + 1, len(self._points))):
            x, y = self._points[index]
            squared = (ego.x - x) ** 2 + (ego.y - y) ** 2
            if squared <= nearest:  # later points win ties
                nearest, closest = squared, index
        deviated = nearest >= self.farthest**2
        if closest != self._index:
            if nearest >= self.safe**2:
                self._out += self._distance[closest] - self._distance[self._index]
                deviated = deviated or 100.0 * self._out / self._distance[-1] > self.share
            self._index = closest
        if not deviated or self.ending:
            return ()
        self.ending = REASON
        here = place(snapshot)
        return (Infraction("route_dev", snapshot.tick, here, f"Agent deviated from the route at {place_text(here)}"),)
