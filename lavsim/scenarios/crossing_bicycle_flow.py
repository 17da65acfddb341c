"""Bicycles cross the road into which the ego turns, one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.flow import BICYCLES, ActorFlow, StreamConfig
from lavsim.scenarios.moves.junctions import LEFT, OPPOSITE, RIGHT, junction_ahead, no_light, no_turn, side_of
from lavsim.scenarios.moves.meeting import phase_to_meet
from lavsim.scenarios.parameters import Location
from lavsim.scenarios.place import Site, line_ahead
from lavsim.types import LaneType, RoadOption
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_RED = 5.0  # [s] that the ego's light stays red at first
_BEFORE, _AFTER = 40.0, 40.0  # [m] of a stream that no file lays down, before and behind the junction
_EDGE = 1.2  # [m] that bicycles keep to the right of the middle of a driving lane
_LONG = 150.0  # [m] of a stream from where a file says
_RIDDEN = LaneType.BIKING | LaneType.DRIVING


@dataclass(frozen=True)
class CrossingBicycleFlowConfig(StreamConfig):
    """The stream and its source.

    Attributes:
        start_actor_flow: Where it begins [m]; None: 40 m before the ego's next junction.
    """

    start_actor_flow: Location | None = None


@SCENARIOS.register(("2.x", "CrossingBicycleFlow"))
class CrossingBicycleFlow(Scenario):
    """NHTSA pre-crash type: cyclist crossing, with prior vehicle manoeuvre (turning).

    From the trigger on bicycles ride from `start_actor_flow` straight through the junction, across the ego's turn, at
    `flow_speed` and without minding anybody; their way is full of them at once, and one would meet an ego that keeps
    its speed. Without that place they ride along the right edge of a lane whose way meets the ego's: from the left
    where it turns right, against it where it turns left. The ego's light is red for 5 s, then green. It is over when
    the ego has left the junction. It owns a timer of 240 s.

    Parameters: start_actor_flow (a place), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = CrossingBicycleFlowConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        if junction_ahead(site) is None:
            return "the route crosses no junction after it"
        return None if len(self._line(site)) > 1 else "at the next junction nobody's way meets that of the route"

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_light(site) or no_turn(site, RoadOption.LEFT, RoadOption.RIGHT)

    def place(self, stage: Stage) -> None:
        line, speed, gap = self._line(stage.site), self.config.flow_speed, self.config.source_dist_interval
        offset = _EDGE if self._rides_on_road(stage.site) else 0.0
        phase = phase_to_meet(stage, line, speed, _RED if stage.site.light >= 0 else 0.0)
        self._flow = ActorFlow(self, stage, line, speed, gap, BICYCLES, prefilled=True, offset=offset, phase=phase)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        lights = _hold_lights(stage) if stage.site.light >= 0 else wait.seconds(0.0)
        yield from wait.beside(wait.until(wait.left_junction(stage)), lights, self._flow.run())

    def _rides_on_road(self, site: Site) -> bool:
        start = self.config.start_actor_flow
        if start is None:
            return True
        return bool(site.town.waypoint(np.array(start[:3]), _RIDDEN).lane_type & LaneType.DRIVING)

    def _line(self, site: Site) -> NDArray[np.float64]:
        """The stream's way (N, 2) [m]; empty where there is none."""
        start = self.config.start_actor_flow
        if start is not None:
            return line_ahead(site.town.waypoint(np.array(start[:3]), _RIDDEN), _LONG)
        junction = junction_ahead(site)
        assert junction is not None  # `fits` has seen to it
        sides = (LEFT, RIGHT, OPPOSITE) if junction.way.turn > 0.0 else (OPPOSITE, RIGHT, LEFT)
        ways = [
            way
            for way in junction.ways(*sides)
            if way.inside != junction.way.inside and junction.crossing(way) is not None
        ]
        if not ways:
            return np.zeros((0, 2))
        first = [way for way in ways if side_of(junction.way.entry.yaw, way.entry.yaw) == sides[0]] or ways
        return min(first, key=lambda way: abs(way.turn)).path(_BEFORE, _AFTER)


def _hold_lights(stage: Stage) -> Script:
    """Red for the ego, then green; red for all others but the bicycles, which mind no light."""
    light = stage.site.light
    stage.lights.hold_junction(light)
    yield from wait.seconds(_RED)
    stage.lights.hold_junction(light, greens=(light,))
