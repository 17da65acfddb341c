"""The car ahead brakes hard before a junction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lavsim.scenarios import place
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.lead import distance_to_ego, lead
from lavsim.scenarios.place import Site
from lavsim.types import DT

_MODEL = "vehicle.nissan.patrol"
_BRAKES_BEFORE = 20.0  # [m] the junction
_NEAR = 20.0  # [m] of the lead from the ego
_STILL, _STILL_FOR = 0.001, 1.0  # [m/s], [s]
_PASSED = 40.0  # [m] that an ego which went round it is beyond it


@dataclass(frozen=True)
class FollowLeadingVehicleConfig:
    """What the original fixes.

    Attributes:
        distance: From the trigger to the lead [m].
        speed: Of the lead [m/s].
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    distance: float = 25.0
    speed: float = 10.0
    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario2"))
class FollowLeadingVehicle(Scenario):
    """NHTSA pre-crash type: lead vehicle decelerating, then stopped.

    A car 25 m ahead follows the lane at 10 m/s and brakes as hard as it can to standstill when it is 20 m before the
    next junction. It is taken away when it is within 20 m of the ego and the ego has stood for more than 1 s.

    Beyond the original: it does not run into traffic ahead, background vehicles in its place are taken out, and
    it is taken away, too, when the ego is 40 m beyond where it stands. The car collides.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = FollowLeadingVehicleConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return None

    def suits(self, site: Site) -> str | None:
        free = place.to_junction(site.anchor)
        if free < self.config.distance + 2.0 * _BRAKES_BEFORE:
            return f"a junction lies {free:.0f} m after it"
        if site.junction is None or site.to_junction > 300.0:
            return "no junction follows"
        return "the route changes lanes" if site.changes_lane(site.to_junction) else None

    def place(self, stage: Stage) -> None:
        start, _ = place.along_lane(stage.anchor, self.config.distance)
        length = min(place.to_junction(start), 500.0)
        self.lead = lead(self, stage, _MODEL, start, self.config.speed, max(length, 5.0), keeps_distance=True)

    def script(self, stage: Stage) -> Script:
        yield from wait.first_of(wait.beside(self._ego_stands(stage), self._drive()), self._ego_passes(stage))

    def _drive(self) -> Script:
        while self.lead.left > _BRAKES_BEFORE:
            self.lead.step()
            yield
        yield from self.lead.stop()

    def _ego_stands(self, stage: Stage) -> Script:
        still = 0.0
        while still <= _STILL_FOR:
            near = distance_to_ego(stage, self.lead) < _NEAR
            still = still + DT if near and stage.world.ego.speed < _STILL else 0.0
            yield

    def _ego_passes(self, stage: Stage) -> Script:
        end = stage.site.distance_along(self.lead.line.xy[-1]) + _PASSED
        return wait.until(wait.ego_past(stage, end))
