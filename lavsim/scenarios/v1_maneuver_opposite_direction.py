"""Barriers block the lane, and cars come towards the ego in the one beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios import place
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import park, wait
from lavsim.scenarios.moves.flow import ActorFlow
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site

_BARRIER = "static.prop.streetbarrier"
_BARRIERS = (50.0, 52.0)  # [m] after the trigger
_SOURCE = 110.0  # [m] after the trigger
_FREE = 40.0  # [m] round the source in which nobody may be when the next car comes
_MOST = 8  # cars in all
_SINK = 10.0  # [m] before the junction behind the trigger
_BEHIND = 150.0  # [m] that they drive beyond the trigger where no junction comes
_END = 220.0  # [m] that the ego drives


@dataclass(frozen=True)
class ManeuverOppositeDirectionConfig:
    """What the original fixes.

    Attributes:
        speed: Of the oncoming cars [m/s].
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    speed: float = 5.56
    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario6"))
class ManeuverOppositeDirection(Scenario):
    """NHTSA pre-crash type: passing an obstacle with oncoming traffic.

    Barriers stand across the lane 50 m after the trigger and, half a lane farther right, 52 m after it. From 110 m
    after the trigger cars come in the lane to the left at 5.56 m/s, one whenever nobody is within 40 m of their source,
    eight in all; each is taken away 10 m before the next junction. It is over when the ego has driven 220 m.

    Barriers and cars collide; the barriers do not give way.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = ManeuverOppositeDirectionConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return "there is no oncoming lane" if place.oncoming(site.anchor) is None else None

    def suits(self, site: Site) -> str | None:
        free = place.to_junction(site.anchor)
        if free < _SOURCE + 10.0:
            return f"a junction lies {free:.0f} m after it"
        if site.changes_lane(_SOURCE):
            return "the route changes lanes or ends"
        alone = place.beside(site.anchor, "left") is None and place.beside(site.anchor, "right") is None
        return self.fits(site) if alone else "there is another lane to go round by"

    def place(self, stage: Stage) -> None:
        for distance, share in zip(_BARRIERS, (0.0, 0.5), strict=True):
            waypoint, _ = place.along_lane(stage.anchor, distance)
            stage.traffic.make_room(waypoint.xy, 4.0)
            park.park(self, stage, _BARRIER, waypoint, share * waypoint.width, np.pi / 2.0)

    def script(self, stage: Stage) -> Script:
        line = self._line(stage)
        flow = ActorFlow(self, stage, line, self.config.speed, Interval(_FREE, _FREE), most=_MOST, keeps_distance=True)
        yield from wait.beside(wait.driven(stage.world.ego, _END), flow.run())

    def _line(self, stage: Stage) -> NDArray[np.float64]:
        start, _ = place.along_lane(stage.anchor, _SOURCE)
        other = place.oncoming(start) or place.oncoming(stage.anchor)
        assert other is not None, "`fits` has seen to it"
        length = min(place.to_junction(other) - _SINK, _SOURCE + _BEHIND)
        return place.line_ahead(other, max(length, 20.0))
