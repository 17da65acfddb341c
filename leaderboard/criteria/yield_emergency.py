"""Not letting an emergency vehicle pass (2.x)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lavsim.geometry import forward
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import ActorIds
from lavsim.world.snapshot import HAZARD_EMERGENCY_TEST, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place


@CRITERIA.register("yield_emergency")
class YieldEmergency(Criterion):
    """Fires when the hazard ends with the ego still ahead of the emergency vehicle, the hazard's first actor."""

    name = "yield_emergency"
    order = 100
    applies = ("2.x",)
    charges = (
        Charge(
            "yield_emergency_vehicle_infractions",
            "Yield emergency vehicles infractions",
            13,
            {"2.0": 0.70, "2.1": 0.40},
        ),
    )

    def start(self, town: TownMap, route: Route) -> None:
        self._failing: dict[int, bool] = {}
        self._where: tuple[int, tuple[float, float, float]] = (0, (0.0, 0.0, 0.0))

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        if not len(snapshot.hazards) and not self._failing:
            return ()
        self._where = snapshot.tick, place(snapshot)
        active = {int(h["index"]) for h in snapshot.hazards if h["flags"] & HAZARD_EMERGENCY_TEST}
        for index in active:
            self._failing[index] = self._is_ahead(snapshot, index, self._failing.get(index, False))
        return self._close([index for index in self._failing if index not in active])

    def finish(self) -> Sequence[Infraction]:
        return self._close(list(self._failing))

    def _close(self, ended: list[int]) -> list[Infraction]:
        tick, where = self._where
        text = "Agent failed to yield to an emergency vehicle"
        return [
            Infraction("yield_emergency_vehicle_infractions", tick, where, text)
            for index in ended
            if self._failing.pop(index)
        ]

    @staticmethod
    def _is_ahead(snapshot: Snapshot, hazard: int, before: bool) -> bool:
        first = ActorIds.of_scenario(hazard)
        rows = np.flatnonzero((snapshot.ids >= first) & (snapshot.ids < ActorIds.of_scenario(hazard + 1)))
        rows = rows[snapshot.is_vehicle[rows]]
        if not len(rows):
            return before
        other = int(rows[0])
        return bool(forward(snapshot.yaw[other]) @ (snapshot.ego.xy - snapshot.xy[other]) > 0.0)
