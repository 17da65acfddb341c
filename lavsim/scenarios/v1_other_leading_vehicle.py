"""The car ahead slows down, and a second one holds the lane beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lavsim.scenarios import place
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.lead import distance_to_ego, lead
from lavsim.scenarios.place import Site

_AHEAD, _BESIDE = 35.0, 36.0  # [m] of the two cars after the trigger
_NEAR = 55.0  # [m] of the ego from the first one, which slows it down
_END = 140.0  # [m] that the ego drives
_LENGTH = 600.0  # [m] of their way


@dataclass(frozen=True)
class OtherLeadingVehicleConfig:
    """What the original fixes.

    Attributes:
        speed: The first car would like [m/s]; the original's number, which looks like km/h.
        speed_beside: The car in the left lane would like [m/s].
        slow_share: Divides `speed` once the ego is near.
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    speed: float = 55.0
    speed_beside: float = 45.0
    slow_share: float = 3.2
    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario5"))
class OtherLeadingVehicle(Scenario):
    """NHTSA pre-crash type: lead vehicle moving at lower constant speed, evaded by a lane change.

    A car starts 35 m ahead and would like 55 m/s, another 36 m ahead in the left lane and would like 45 m/s; both brake
    for what is ahead of them and in bends. As soon as the ego is less than 55 m from the first (so at once), that one
    would like 55 / 3.2 = 17.2 m/s. It is over when the ego has driven 140 m.

    Under the rules "corrected" the numbers are what they look like, km/h: 15.3, 12.5 and then 4.8 m/s. Both cars
    collide; background vehicles in their places are taken out.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = OtherLeadingVehicleConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return "there is no lane to the left" if place.beside(site.anchor, "left") is None else None

    def suits(self, site: Site) -> str | None:
        free = place.to_junction(site.anchor)
        if free < _END:
            return f"a junction lies {free:.0f} m after it"
        return "the route changes lanes or ends" if site.changes_lane(_END) else self.fits(site)

    def place(self, stage: Stage) -> None:
        unit = 1.0 / 3.6 if stage.rules == "corrected" else 1.0
        left = place.beside(stage.anchor, "left")
        assert left is not None, "`fits` has seen to it"
        config, models = self.config, ("vehicle.tesla.model3", "vehicle.audi.tt")
        starts = place.along_lane(stage.anchor, _AHEAD)[0], place.along_lane(left, _BESIDE)[0]
        self.ahead, self.beside = (
            lead(self, stage, model, start, unit * speed, _LENGTH, keeps_distance=True)
            for model, start, speed in zip(models, starts, (config.speed, config.speed_beside), strict=True)
        )

    def script(self, stage: Stage) -> Script:
        slows = wait.in_turn(wait.until(lambda: distance_to_ego(stage, self.ahead) < _NEAR), self._slow_down())
        drive = wait.together(self.ahead.run(), self.beside.run())
        yield from wait.beside(wait.driven(stage.world.ego, _END), slows, drive)

    def _slow_down(self) -> Script:
        self.ahead.speed /= self.config.slow_share
        yield
