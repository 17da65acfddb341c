"""Standing still too long for no reason: `--rules corrected`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lavsim.geometry import forward
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import LightState
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Infraction
from leaderboard.criteria.blocked import Blocked


@CRITERIA.register("corrected_blocked")
class CorrectedBlocked(Blocked):
    """As the original, but the clock is held while the ego stands before the stop line of a light that isn't green.

    A hazard with a timer of its own suspends the test, as in 2.x.
    """

    name = "corrected_blocked"
    applies = ("corrected",)
    instead_of = "blocked"

    ahead = (-2.5, 12.0)  # [m] from the ego's centre to the line, along the ego's heading
    aside = 0.5  # of the lane's width, between the line's middle and the ego's centre, at most

    def start(self, town: TownMap, route: Route) -> None:
        super().start(town, route)
        lines = [(k, stop) for k, light in enumerate(town.lights) for stop in light.stop_lines]
        self._light = np.array([k for k, _ in lines], np.int64)
        self._middle = np.array([(stop.x, stop.y) for _, stop in lines], np.float64).reshape(-1, 2)
        self._yaw = np.array([stop.yaw for _, stop in lines], np.float64)
        self._half = np.array([self.aside * stop.width for _, stop in lines], np.float64)

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        if self._moved is not None and self._is_at_light(snapshot):
            self._moved += 1  # held, not started again: who never moves at green is blocked in the end
        return super().update(snapshot)

    def _is_excused(self, snapshot: Snapshot) -> bool:
        return self._owns_timer(snapshot)

    def _is_at_light(self, snapshot: Snapshot) -> bool:
        ego = snapshot.ego
        if ego.speed >= self.slow or not len(self._light):
            return False
        states = np.asarray(snapshot.lights)[self._light]
        delta, course = self._middle - ego.xy, forward(ego.yaw)
        along = delta @ course
        beside = np.abs(delta @ np.array([-course[1], course[0]]))
        waits = (states == LightState.RED) | (states == LightState.YELLOW)
        waits &= (along > self.ahead[0]) & (along < self.ahead[1]) & (beside <= self._half)
        return bool(np.any(waits & (np.cos(self._yaw - ego.yaw) > 0.0)))
