"""Merging into a stream of vehicles, or crossing one, that a route file lays down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, LavsimError
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.enter import clear_line
from lavsim.scenarios.moves.flow import ActorFlow, StreamConfig
from lavsim.scenarios.moves.junctions import (
    LEFT,
    OPPOSITE,
    RIGHT,
    SAME,
    JunctionAhead,
    Way,
    has_light,
    junction_ahead,
    no_turn,
)
from lavsim.scenarios.moves.meeting import phase_to_meet
from lavsim.scenarios.moves.route_lines import line_beside, line_between, oncoming_between
from lavsim.scenarios.parameters import Location
from lavsim.scenarios.place import Site
from lavsim.types import RoadOption
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

Line = NDArray[np.float64]

_BEFORE, _AFTER = 80.0, 80.0  # [m] of a stream that no file lays down, before and behind the junction
_STRAIGHT = np.radians(40.0)  # that a stream to merge into turns at most
_FRONT = 10.0  # [m] before the end of the last stream


@dataclass(frozen=True)
class ActorFlowConfig(StreamConfig):
    """The stream and its way.

    Attributes:
        start_actor_flow: Where it begins [m]; None: `_BEFORE` metres before the ego's next junction.
        end_actor_flow: Where it ends [m]; None: `_AFTER` metres behind that junction.
    """

    start_actor_flow: Location | None = None
    end_actor_flow: Location | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.start_actor_flow is None) != (self.end_actor_flow is None):
            raise ConfigError("start_actor_flow and end_actor_flow go together: give both or none.")


class FlowScenario(Scenario):
    """What the types below share: streams along lines, until the ego has passed them.

    Class attributes:
        every_lane: Whether all lanes beside the laid-down one carry a stream.
        turns: What the ego may do at the junction; empty: anything.
        prefilled: Whether vehicles are on the whole way at once.
    """

    Config: ClassVar[type[Any]] = ActorFlowConfig
    appears_at_trigger = True
    every_lane: ClassVar[bool] = False
    turns: ClassVar[tuple[RoadOption, ...]] = ()
    prefilled: ClassVar[bool] = True

    def fits(self, site: Site) -> str | None:
        try:
            lines = self._lines(site)
        except LavsimError as error:
            return str(error).rstrip(".")
        return None if lines else "nobody's way meets that of the route"

    def suits(self, site: Site) -> str | None:
        return no_turn(site, *self.turns) or has_light(site) or self.fits(site)  # what is quick to tell first

    def place(self, stage: Stage) -> None:
        self._ways = self._lines(stage.site)
        self._flows = []
        for line in self._ways:
            clear_line(stage, line)
            speed, gap = self.config.flow_speed, self.config.source_dist_interval
            phase = phase_to_meet(stage, line, speed)
            self._flows.append(ActorFlow(self, stage, line, speed, gap, prefilled=self.prefilled, phase=phase))

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        yield from wait.beside(self._end(stage), *(flow.run() for flow in self._flows))

    def _end(self, stage: Stage) -> Script:
        """Until the ego has passed: it comes to the end of the streams, or has left the junction for good."""
        ends = [stage.site.distance_along(line[-1]) for line in self._ways]
        if stage.site.junction is not None:
            ends = [max(end, stage.site.to_junction) for end in ends]
        yield from wait.until(wait.ego_past(stage, min(ends)))

    def _lines(self, site: Site) -> list[Line]:
        """The streams' ways from source to sink (N, 2) [m]; empty: there are none."""
        start, end = self.config.start_actor_flow, self.config.end_actor_flow
        if start is not None and end is not None:
            return line_between(site, start, end, self.every_lane)
        junction = junction_ahead(site)
        return [] if junction is None else [way.path(_BEFORE, _AFTER) for way in self._ways_of(junction)]

    def _ways_of(self, junction: JunctionAhead) -> list[Way]:
        """Ways of others that a stream takes where no file lays it down: from elsewhere into the ego's exit."""
        own = junction.way
        lanes = own.town.lanes
        roads = {int(lanes.road_id[own.before])}
        into = [
            way
            for way in junction.ways(LEFT, SAME, OPPOSITE, RIGHT)
            if lanes.road_id[way.after] == lanes.road_id[own.after]
            and int(lanes.road_id[way.before]) not in roads
            and abs(way.turn) < _STRAIGHT
        ]
        straight = sorted(into, key=lambda way: (abs(way.turn), way.after != own.after))
        return straight if self.every_lane else straight[:1]


@SCENARIOS.register(("2.x", "EnterActorFlow"))
class EnterActorFlow(FlowScenario):
    """NHTSA pre-crash type: merging into fast traffic (changing lanes, same direction).

    Vehicles drive from `start_actor_flow` to `end_actor_flow` at `flow_speed` without minding anybody; their way is
    full of them at once, one of which would meet an ego that keeps its speed. It is over when the ego is at the end of
    that way. It owns a timer of 240 s.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """


@SCENARIOS.register(("2.x", "EnterActorFlowV2"))
class EnterActorFlowV2(EnterActorFlow):
    """NHTSA pre-crash type: merging into fast traffic (changing lanes, same direction).

    As `EnterActorFlow`, with a stream on every lane of that direction.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    every_lane = True


@SCENARIOS.register(("2.x", "MergerIntoSlowTraffic"))
class MergerIntoSlowTraffic(FlowScenario):
    """NHTSA pre-crash type: merging into slow traffic (changing lanes, same direction).

    As `EnterActorFlow`: the same script, at places and speeds where the stream is slow.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """


@SCENARIOS.register(("2.x", "MergerIntoSlowTrafficV2"))
class MergerIntoSlowTrafficV2(MergerIntoSlowTraffic):
    """NHTSA pre-crash type: merging into slow traffic (changing lanes, same direction).

    As `MergerIntoSlowTraffic`, with a stream on every lane of that direction.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    every_lane = True


@SCENARIOS.register(("2.x", "HighwayExit"))
class HighwayExit(FlowScenario):
    """NHTSA pre-crash type: changing lanes, same direction, to leave the road.

    Vehicles drive from `start_actor_flow` to `end_actor_flow` in the lane that the ego has to cross to get off, at
    `flow_speed` and without minding anybody; their way is full of them at once. Without these two places the stream is
    in the lane to the right of the trigger. It is over when the ego has left that junction. It owns a timer of 240 s.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    def suits(self, site: Site) -> str | None:
        if (reason := no_turn(site, near=40.0, far=250.0)) is not None:
            return reason
        end = site.index if site.junction is None else site.junction[0]
        changes = site.route.command[site.index : end] == int(RoadOption.CHANGELANERIGHT)
        if not changes.any():
            return "the route should change to the right lane before the junction"
        return self.fits(site)

    def _lines(self, site: Site) -> list[Line]:
        if self.config.start_actor_flow is not None:
            return super()._lines(site)
        reach = min(site.to_junction, 3.0 * _BEFORE) + _AFTER
        return [line for line in (line_beside(site, "right", _BEFORE / 2.0, reach),) if line is not None]

    def _end(self, stage: Stage) -> Script:
        return _left(stage, super()._end(stage))


@SCENARIOS.register(("2.x", "InterurbanActorFlow"))
class InterurbanActorFlow(FlowScenario):
    """NHTSA pre-crash type: left turn across path, opposite direction, off an interurban road.

    Vehicles drive from `start_actor_flow` to `end_actor_flow`, across the ego's left turn, at `flow_speed` and without
    minding anybody. Without these two places they come straight from the opposite approach. It is over when the ego has
    left the junction. It owns a timer of 240 s.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    turns = (RoadOption.LEFT,)

    def _ways_of(self, junction: JunctionAhead) -> list[Way]:
        return _crossing(junction, OPPOSITE)

    def _end(self, stage: Stage) -> Script:
        return _left(stage, super()._end(stage))


@SCENARIOS.register(("2.x", "InterurbanAdvancedActorFlow"))
class InterurbanAdvancedActorFlow(FlowScenario):
    """NHTSA pre-crash type: straight crossing paths, turning into an interurban road.

    Vehicles drive from `start_actor_flow` to `end_actor_flow` at `flow_speed` without minding anybody, and a second
    stream the other way on the lane beside. Without these two places they come from the left and from the right. It is
    over when the ego is 10 m before the end of the stream that it has joined. It owns a timer of 240 s.

    Parameters: start_actor_flow, end_actor_flow (places), flow_speed 10 m/s, source_dist_interval 20 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    turns = (RoadOption.LEFT,)

    def _lines(self, site: Site) -> list[Line]:
        start, end = self.config.start_actor_flow, self.config.end_actor_flow
        given = [] if start is None or end is None else oncoming_between(site, start, end)
        return super()._lines(site) + given

    def _ways_of(self, junction: JunctionAhead) -> list[Way]:
        return [way for side in (LEFT, RIGHT) for way in _crossing(junction, side)]

    def _end(self, stage: Stage) -> Script:
        own = stage.route.xy
        joined = [line[-1] for line in self._ways if np.hypot(*(own - line[-1]).T).min() < 5.0]
        if not joined:
            return _left(stage, super()._end(stage))
        return wait.until(wait.ego_past(stage, stage.site.distance_along(joined[-1]) - _FRONT))


def _crossing(junction: JunctionAhead, side: str) -> list[Way]:
    """The straightest way from `side` that meets the route's."""
    ways = [way for way in junction.ways(side) if junction.crossing(way) is not None]
    return sorted(ways, key=lambda way: abs(way.turn))[:1]


def _left(stage: Stage, otherwise: Script) -> Script:
    """Until the ego has left its next junction; `otherwise` where there is none."""
    return otherwise if stage.site.junction is None else wait.until(wait.left_junction(stage))
