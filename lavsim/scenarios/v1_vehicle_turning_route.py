"""A cyclist crosses the road into which the ego turns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lavsim.scenarios import place
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import cross, wait
from lavsim.scenarios.place import Site
from lavsim.types import RoadOption, Role

_MODEL = "vehicle.diamondback.century"
_AFTER = 8.0  # [m] behind the junction
_SPEED = 10.0  # [m/s] that it would like
_ACCELERATION = 1.0  # [m/s²] of a cyclist who sets off
_START = 13.0  # [m] of the ego before the width it crosses
_STAYS = 5.0  # [s]
_TURNS = {RoadOption.LEFT: "left", RoadOption.RIGHT: "right"}


@dataclass(frozen=True)
class VehicleTurningRouteConfig:
    """What the original fixes.

    Attributes:
        way: "left" or "right", what the route does at the junction; as the scenario file was matched.
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    way: str = ""
    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario4"))
class VehicleTurningRoute(Scenario):
    """NHTSA pre-crash type: cyclist or object ahead with a prior (turning) manoeuvre.

    Behind the exit of the next junction of the route, 8 m on, a bicycle waits one lane width right of the right-most
    lane, n m farther with n lanes to it. With D = lane width * (1 + 1.1 n) it starts across when the ego is less than
    13 + D m from it along the route, goes 0.3 D and 0.7 D more, and is taken away 5 s later. It would like to drive
    10 m/s and sets off with 1 m/s², as what the original's full throttle gives a bicycle is not known.

    The bicycle collides (as a vehicle).

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = VehicleTurningRouteConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return "the route leaves no junction after it" if site.exit is None else None

    def suits(self, site: Site) -> str | None:
        if site.exit is None or site.turn not in _TURNS or site.to_junction > 60.0:
            return "the route does not turn after it"
        rest = place.to_junction(site.exit)
        return f"the next junction follows after {rest:.0f} m" if rest < _AFTER + 8.0 else None

    def place(self, stage: Stage) -> None:
        assert stage.site.exit is not None, "`fits` has seen to it"
        behind, _ = place.along_lane(stage.site.exit, _AFTER)
        lane, steps = place.past_parking(behind)
        lanes = steps + 1
        waypoint, _ = place.along_lane(lane, float(lanes))
        spot = place.aside(waypoint, waypoint.width)
        self._at = stage.site.distance_along(spot)
        self._length = waypoint.width * (1.0 + 1.1 * lanes)
        stage.traffic.make_room(spot[:2], 3.0)
        self.bicycle = self.spawn(stage, _MODEL, spot, waypoint.yaw - np.pi / 2.0, Role.SCENARIO)

    def script(self, stage: Stage) -> Script:
        yield from wait.until(wait.ego_past(stage, self._at - (_START + self._length)))
        yield from cross.ride(self.bicycle, _SPEED, self._length, _ACCELERATION)
        yield from wait.seconds(_STAYS)
