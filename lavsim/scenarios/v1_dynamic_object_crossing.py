"""A walker runs out from behind a vending machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lavsim.errors import ScenarioError
from lavsim.geometry import right
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios import place
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import cross, wait
from lavsim.scenarios.place import Site
from lavsim.types import Role

_WALKER, _BLOCKER = "walker.pedestrian.0001", "static.prop.vendingmachine"
_DISTANCE, _DISTANCE_PER_LANE = 12.0, 1.5  # [m]
_BLOCKER_SHARE = 0.9  # of the line from the trigger to the walker
_FARTHER, _TRIES = 0.4, 20  # [m] and how often the place is tried farther on when it is taken
_SPEED, _SPEED_PER_LANE = 3.0, 0.4  # [m/s]
_ON = 5.0  # [m] that the ego drives on while the walker crosses
_END = 40.0  # [m]
_RUN_UP, _BEND = (
    45.0,
    0.25,
)  # [m] of straight road before the trigger, [rad]: who comes slowly passes in front of nobody


@dataclass(frozen=True)
class DynamicObjectCrossingConfig:
    """What the original fixes.

    Attributes:
        distance: From the trigger to the walker along the lane, with one lane [m].
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    distance: float = _DISTANCE
    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario3"))
class DynamicObjectCrossing(Scenario):
    """NHTSA pre-crash type: pedestrian crossing without prior vehicle manoeuvre, occluded.

    With n lanes from the ego's to the right-most one, a walker waits 12 m + 1.5 m for every lane to the right after the
    trigger, one lane width right of that lane, and a vending machine stands at 90 % of the line from the trigger to it.
    When the ego is less than 12 + n m from it along the route it starts across at 3 + 0.4 n m/s. With
    W = lane width * (1 + 1.25 n) it goes 0.5 W, then W more or until the ego has driven 5 m. Both are taken away then,
    and it is over when the ego has driven 40 m. Where the place is taken, or a parked car stands in the walker's way,
    both stand farther on, 0.4 m at a time.

    Walker and vending machine collide; the machine does not give way.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = DynamicObjectCrossingConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return None

    def suits(self, site: Site) -> str | None:
        lane, steps = place.past_parking(site.anchor)
        distance = self.config.distance + _DISTANCE_PER_LANE * steps
        if place.to_junction(site.anchor) < distance + 5.0:
            return f"a junction lies less than {distance + 5.0:.0f} m after it"
        if site.at < _RUN_UP or site.bends(-_RUN_UP, distance) > _BEND:
            return "the ego would come slowly, round a bend or from its start"
        if site.changes_lane(distance + 10.0):
            return "the route changes lanes or ends"
        if place.kerb(site.anchor, "right") > lane.width + abs(_offset(site.anchor, lane)) - 0.3:
            return "the walker would wait on the road"
        return None

    def place(self, stage: Stage) -> None:
        lane, steps = place.past_parking(stage.anchor)
        self.lanes = steps + 1
        for number in range(_TRIES):
            distance = self.config.distance + _DISTANCE_PER_LANE * steps + _FARTHER * number
            try:
                self._stand(stage, place.along_lane(lane, distance)[0])
                return
            except ScenarioError:
                self.clear()
        raise ScenarioError("there is no room for the walker and the vending machine.")

    def script(self, stage: Stage) -> Script:
        ego, n = stage.world.ego, self.lanes
        yield from wait.until(wait.ego_past(stage, self._at - (_DISTANCE + n)))
        width, speed = self._width * (1.0 + 1.25 * n), _SPEED + _SPEED_PER_LANE * n
        yield from cross.walk(self.walker, self._way, speed, 0.5 * width)
        yield from wait.first_of(cross.walk(self.walker, self._way, speed, width), wait.driven(ego, _ON))
        self.clear()
        yield from wait.driven(ego, _END)

    def _stand(self, stage: Stage, waypoint: Waypoint) -> None:
        self._width, self._way = waypoint.width, -right(waypoint.yaw)
        spot = place.aside(waypoint, waypoint.width)
        if cross.meets_parked(stage.world, spot[:2], self._way, 1.5 * self._width * (1.0 + 1.25 * self.lanes)):
            raise ScenarioError("a parked car stands in the walker's way.")
        self._at = stage.site.distance_along(spot)
        line = spot - stage.anchor.xyz
        hidden = stage.anchor.xyz + _BLOCKER_SHARE * line
        stage.traffic.make_room(spot[:2], 3.0)
        self.spawn(stage, _BLOCKER, hidden, waypoint.yaw, Role.PROP)
        self.walker = self.spawn(stage, _WALKER, spot, waypoint.yaw - np.pi / 2.0, Role.SCENARIO)


def _offset(anchor: Waypoint, lane: Waypoint) -> float:
    """Distance from the anchor's lane to another one beside it [m]."""
    return float((lane.xy - anchor.xy) @ right(anchor.yaw))
