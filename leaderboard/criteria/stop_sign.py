"""Running a stop sign."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction


@CRITERIA.register("stop_sign")
class StopSign(Criterion):
    """Its key, place and cost; fires never while towns hold no stop signs."""

    name = "stop_sign"
    order = 50
    charges = (Charge("stop_infraction", "Stop sign infractions", 8, {"1.0": 0.80, "2.0": 0.80, "2.1": 0.25}),)

    def start(self, town: TownMap, route: Route) -> None:
        pass

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        return ()
