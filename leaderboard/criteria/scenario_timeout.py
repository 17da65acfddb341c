"""Not getting past a hazard within its time (2.x)."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT
from lavsim.world.snapshot import HAZARD_OWNS_TIMER, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place


@CRITERIA.register("scenario_timeout")
class ScenarioTimeout(Criterion):
    """Fires once for a hazard with a timer of its own that is active for 240 s; the route goes on.

    The hazard is taken away then, so it is shown in as many snapshots as 240 s have and the last of them fires.
    """

    name = "scenario_timeout"
    order = 90
    applies = ("2.x",)
    charges = (Charge("scenario_timeouts", "Scenario timeouts", 14, {"2.0": 0.70, "2.1": 0.40}),)

    longest = 240.0  # [s]

    def start(self, town: TownMap, route: Route) -> None:
        self._since: dict[int, int] = {}
        self._fired: set[int] = set()

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        if not len(snapshot.hazards) and not self._since:
            return ()
        active = {int(h["index"]) for h in snapshot.hazards if h["flags"] & HAZARD_OWNS_TIMER}
        self._since = {index: self._since.get(index, snapshot.tick) for index in active}
        found = []
        for index, since in self._since.items():
            if index not in self._fired and (snapshot.tick - since + 1) * DT >= self.longest:
                self._fired.add(index)
                text = f"Agent timed out a scenario: hazard {index} of the route"
                found.append(Infraction("scenario_timeouts", snapshot.tick, place(snapshot), text))
        return found
