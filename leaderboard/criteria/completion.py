"""How much of the route is done, and its end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import COMPLETED, CRITERIA, Criterion, Infraction
from leaderboard.progress import PlaneProgress


@CRITERIA.register("completion")
class Completion(Criterion):
    """Percent of the route's length behind the ego; ends the drive at the target.

    The end is said one tick late: infractions of that extra tick still count, as in the original. `corrected` says it
    at once.

    Attributes:
        percent: Route completed, 0 to 100; exactly 100 only once the target is reached.
        reached: Whether the target was reached.
    """

    name = "completion"
    order = 10

    window = 2  # points ahead
    enough = 99.0  # [percent], strictly more
    radius = 10.0  # [m] from the last point, 3D, strictly less
    late = {"1.0": True, "2.x": True, "corrected": False}  # noqa: RUF012 - whether the end is said a tick late

    percent: float = 0.0
    reached: bool = False

    def start(self, town: TownMap, route: Route) -> None:
        self.percent, self.reached = 0.0, False
        self._progress = PlaneProgress(route, self.window)
        self._distance = np.asarray(route.distance, np.float64)
        self._target = np.asarray(route.points[-1], np.float64)

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        if self.reached:
            self.ending = COMPLETED
            return ()
        ego = snapshot.ego
        if self._progress.advance(ego.x, ego.y):
            self.percent = float(100.0 * self._distance[self._progress.index] / self._distance[-1])
            if self.rules.rounds:
                self.percent = round(self.percent, 2)
        if self.percent > self.enough and float(np.linalg.norm(ego.xyz - self._target)) < self.radius:
            self.percent, self.reached = 100.0, True
            self.ending = None if self.rules.require(self.late) else COMPLETED
        return ()
