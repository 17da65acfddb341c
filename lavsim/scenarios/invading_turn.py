"""Oncoming vehicles cut the bend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.errors import ConfigError
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_positive
from lavsim.scenarios.moves.enter import clear_line
from lavsim.scenarios.moves.flow import ActorFlow
from lavsim.scenarios.moves.opposing import oncoming_line
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import lane_ahead, must_be_ahead
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, oncoming
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_BEND = np.radians(30.0)  # that the road should turn at least where a new file puts it
_ROUTE_LEFT = 15.0  # [m] of route behind where it is over
_GAP = Interval(40.0, 40.0)  # [m] between one and the next
_CONES = 15.0  # [m] between cones


@dataclass(frozen=True)
class InvadingTurnConfig:
    """How far off they begin and how far they come over.

    Attributes:
        distance: From the trigger to where they appear, along the lane [m].
        offset: Of their middle beyond the line between the lanes, on the ego's side [m].
    """

    distance: float = 100.0
    offset: float = 0.25

    def __post_init__(self) -> None:
        check_positive(self, "distance")
        if not -1.0 <= self.offset <= 1.5:
            raise ConfigError(f"offset must lie in -1 to 1.5 [m], got {self.offset:g}.")


@SCENARIOS.register(("2.x", "InvadingTurn"))
class InvadingTurn(Scenario):
    """NHTSA pre-crash type: opposite direction, vehicle in the wrong lane without prior manoeuvre.

    From the trigger on vehicles come against the ego 40 m apart at the speed limit, on a bend, round cones on their
    side of the road: their middle is `offset` beyond the line between the lanes. They appear `distance` ahead and
    vanish at the trigger. It is over when the ego has passed where they appear. It owns a timer of 240 s. The cones
    collide, and give way.

    Parameters: distance 100 m, offset 0.25 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = InvadingTurnConfig

    def fits(self, site: Site) -> str | None:
        place = lane_ahead(site, self.config.distance)
        if place is None:
            return f"the road ends within {self.config.distance:g} m of the trigger"
        if oncoming(place) is None or oncoming(site.anchor) is None:
            return "there is no oncoming lane"
        return None

    def suits(self, site: Site) -> str | None:
        reason = self.fits(site)
        last = site.ahead(self.config.distance + _ROUTE_LEFT)
        if reason is not None or last is None:
            return reason or "the route ends before"
        turned = float(np.ptp(np.unwrap(site.route.yaw[site.index : last])))
        crosses = (site.town.lanes.junction[site.route.lane[site.index : last]] >= 0).any()
        return None if turned > _BEND and not crosses else "the road should bend there, without a junction"

    def place(self, stage: Stage) -> None:
        for k in range(1, int(self.config.distance / _CONES)):
            lane = oncoming(must_be_ahead(stage.site, k * _CONES))
            if lane is not None:
                park(self, stage, "static.prop.constructioncone", lane)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        place = must_be_ahead(stage.site, self.config.distance)
        line = oncoming_line(place, 0.0, self.config.distance)
        assert line is not None  # `fits` has seen to it
        clear_line(stage, line)
        offset = -(self.config.offset + place.width / 2.0)
        flow = ActorFlow(self, stage, line, place.speed_limit, _GAP, offset=offset)
        yield from wait.beside(wait.until(wait.ego_past(stage, self.config.distance)), flow.run())
