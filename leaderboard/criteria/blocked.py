"""Standing still too long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import DT
from lavsim.world.snapshot import HAZARD_OWNS_TIMER, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place, place_text

REASON = "Agent got blocked"


@CRITERIA.register("blocked")
class Blocked(Criterion):
    """Ends the drive when the ego has been slower than 0.1 m/s for more than 180 s.

    In 1.0 waiting at a red light counts; 2.x stops the clock while a hazard with a timer of its own runs, and starts
    it again at both switches.
    """

    name = "blocked"
    order = 80
    charges = (Charge("vehicle_blocked", "Agent blocked", 12, reason=REASON),)

    slow = 0.1  # [m/s], strictly below
    longest = {"1.0": 180.0, "2.x": 180.0, "bench2drive": 60.0}  # noqa: RUF012 - [s], strictly more

    def start(self, town: TownMap, route: Route) -> None:
        self._moved: int | None = None  # last tick that moved, or the first
        self._limit = self.rules.require(self.longest)
        self._suspended = False

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        suspended = self._is_excused(snapshot)
        if suspended != self._suspended:
            self._suspended, self._moved = suspended, snapshot.tick
        if suspended:
            return ()
        if snapshot.ego.speed >= self.slow or self._moved is None:
            self._moved = snapshot.tick
            return ()
        # Whole ticks times dt: no rounding of two times decides.
        if (snapshot.tick - self._moved) * DT <= self._limit or self.ending:
            return ()
        self.ending = REASON
        here = place(snapshot)
        return (Infraction("vehicle_blocked", snapshot.tick, here, f"Agent got blocked at {place_text(here)}"),)

    def _is_excused(self, snapshot: Snapshot) -> bool:
        """Whether standing doesn't count now."""
        return self.rules.generation != "1.0" and self._owns_timer(snapshot)

    @staticmethod
    def _owns_timer(snapshot: Snapshot) -> bool:
        return len(snapshot.hazards) > 0 and bool(np.any(snapshot.hazards["flags"] & HAZARD_OWNS_TIMER))
