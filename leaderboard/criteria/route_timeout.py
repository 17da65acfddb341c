"""Taking too long for the route."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place
from leaderboard.progress import PlaneProgress

REASON = "Agent timed out"


@CRITERIA.register("route_timeout")
class RouteTimeout(Criterion):
    """Ends the drive when its time is spent.

    1.0 has a fixed budget of whole seconds, by the length of the dense route. 2.x starts at 300 s and adds what every
    metre of progress takes at a tenth of the speed limit.
    """

    name = "route_timeout"
    order = 0
    charges = (Charge("route_timeout", "Route timeouts", 11, reason=REASON),)

    per_metre, base = 0.8, 5.0  # 1.0: [s/m], [s]
    initial, slowest = 300.0, 0.10  # 2.x: [s], share of the speed limit
    window = 3  # 2.x: points ahead

    budget: float = float("inf")  # [s]

    def start(self, town: TownMap, route: Route) -> None:
        self._first: int | None = None
        self._town, self._route = town, route
        self._progress: PlaneProgress | None = None
        if self.rules.generation == "1.0":
            self.budget = float(int(self.per_metre * float(route.length) + self.base))
        else:
            self.budget = self.initial
            self._progress = PlaneProgress(route, self.window)

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        self._first = snapshot.tick if self._first is None else self._first
        if self._progress is not None:
            self._extend(snapshot, self._progress)
        if (snapshot.tick - self._first) * DT <= self.budget or self.ending:
            return ()
        self.ending = REASON
        return (Infraction("route_timeout", snapshot.tick, place(snapshot), "Route timeout."),)

    def _extend(self, snapshot: Snapshot, progress: PlaneProgress) -> None:
        before = progress.index
        ego = snapshot.ego
        if progress.advance(ego.x, ego.y):
            metres = float(self._route.distance[progress.index] - self._route.distance[before])
            lane = int(self._town.nearest(np.array([[ego.x, ego.y, ego.z]])).lane[0])
            self.budget += metres / (self.slowest * float(self._town.lanes.speed_limit[lane]))
