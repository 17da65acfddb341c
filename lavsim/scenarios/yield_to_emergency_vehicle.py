"""An emergency vehicle comes from behind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_positive
from lavsim.scenarios.moves.enter import clear_line, enter
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.moves.models import BLUE_LIGHTS, EMERGENCY, pick
from lavsim.scenarios.moves.roadside import own_line
from lavsim.scenarios.place import Site, beside, join, line_behind
from lavsim.world.snapshot import HAZARD_EMERGENCY_TEST

_FASTER = 25.0  # [m/s] than the ego
_NEAR, _PATIENCE = 50.0, 10.0  # [m] behind the ego, and [s] from then on
_PAST = 50.0  # [m] that it drives once it is ahead
_ROAD = 600.0  # [m] of its way after the trigger


@dataclass(frozen=True)
class YieldToEmergencyVehicleConfig:
    """Where it starts.

    Attributes:
        distance: Behind the trigger along the lane [m].
    """

    distance: float = 140.0

    def __post_init__(self) -> None:
        check_positive(self, "distance")


@SCENARIOS.register(("2.x", "YieldToEmergencyVehicle"))
class YieldToEmergencyVehicle(Scenario):
    """NHTSA pre-crash type: lead vehicle in the way of an emergency vehicle (following vehicle making way).

    An emergency vehicle with its lights on appears `distance` behind the trigger and drives 25 m/s faster than the ego,
    but keeps its distance. It is over 10 s after it has come within 50 m, or 50 m after it has got ahead. An ego still
    ahead at the end has failed to yield.

    Parameters: distance 140 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = YieldToEmergencyVehicleConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        line = line_behind(site.anchor, self.config.distance)
        length = float(np.hypot(*np.diff(line, axis=0).T).sum()) if len(line) > 1 else 0.0
        if length < 0.9 * self.config.distance:
            return f"the road begins {length:.0f} m before the trigger, {self.config.distance:g} m are asked for"
        return None

    def suits(self, site: Site) -> str | None:
        alone = beside(site.anchor, "right") is None and beside(site.anchor, "left") is None
        return self.fits(site) or ("there is no lane beside to make way" if alone else None)

    def place(self, stage: Stage) -> None:
        line = self._line(stage.site)
        clear_line(stage, line_behind(stage.anchor, self.config.distance))
        self._car = enter(self, stage, pick(stage.draws, EMERGENCY), line, _FASTER, keeps_distance=True)
        self._car.actor.switch_on(BLUE_LIGHTS)
        self._car.actor.launch(stage.world.ego.speed)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_EMERGENCY_TEST)
        ego, car = stage.world.ego, self._car.actor

        def is_ahead() -> bool:
            way = np.array([np.cos(ego.yaw), np.sin(ego.yaw)])
            return float(way @ (car.xy - ego.xy)) > 0.0

        waited = wait.in_turn(wait.until(lambda: wait.gap_to(car, ego.xy) < _NEAR), wait.seconds(_PATIENCE))
        passed = wait.in_turn(wait.until(is_ahead), wait.driven(car, _PAST))
        yield from wait.first_of(waited, passed, _chase(stage, self._car))

    def _line(self, site: Site) -> NDArray[np.float64]:
        return join(line_behind(site.anchor, self.config.distance), own_line(site, site.anchor, _ROAD))


def _chase(stage: Stage, car: LaneFollower) -> Script:
    """Drives faster than the ego without end."""
    while True:
        car.speed = stage.world.ego.speed + _FASTER
        car.step()
        yield
