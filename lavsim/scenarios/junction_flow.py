"""Turning at a junction through or into a stream of vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.enter import clear_line
from lavsim.scenarios.moves.flow import ActorFlow, StreamConfig
from lavsim.scenarios.moves.junctions import (
    LEFT,
    OPPOSITE,
    JunctionAhead,
    Way,
    has_light,
    junction_ahead,
    no_light,
    no_turn,
)
from lavsim.scenarios.moves.meeting import phase_to_meet
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site
from lavsim.types import RoadOption
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_RED = 5.0  # [s] that the ego's light stays red at first
_CROSSED, _JOINED = 12.0, 9.0  # [m/s] of streams that new files lay down: real ones have 8 to 17
_END = 10.0  # [m] behind the junction
_GAP = Interval(25.0, 50.0)  # [m]


@dataclass(frozen=True)
class JunctionFlowConfig(StreamConfig):
    """A faster stream than elsewhere."""

    flow_speed: float = 20.0
    source_dist_interval: Interval = _GAP


class JunctionFlow(Scenario):
    """What the types below share: where the stream comes from and goes to, and who has green when.

    Class attributes:
        turn: What the ego does at the junction.
        side: Where it comes from.
        joins: Whether it leads into the ego's exit.
        reach: Seconds of its way before and behind the junction.
        prefilled: Whether vehicles are on the whole way at once.
        signalized: Whether lights are held.
    """

    Config = JunctionFlowConfig
    appears_at_trigger = True
    turn: ClassVar[RoadOption] = RoadOption.LEFT
    side: ClassVar[str] = OPPOSITE
    joins: ClassVar[bool] = False
    reach: ClassVar[tuple[float, float]] = (4.0, 2.5)
    prefilled: ClassVar[bool] = False
    signalized: ClassVar[bool] = False

    def fits(self, site: Site) -> str | None:
        junction = junction_ahead(site)
        if junction is None:
            return "the route crosses no junction after it"
        if self._way(junction) is None:
            whose = "enters the road that the route takes" if self.joins else "crosses the route"
            return f"at the next junction nobody who comes from the {self.side} {whose}"
        return None

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_turn(site, self.turn) or (no_light(site) if self.signalized else has_light(site))

    @classmethod
    def suggest(cls, site: Site) -> Mapping[str, Any] | None:
        """A speed at which a driver of the town finds a gap; the default is that of a trunk road."""
        speed = _JOINED if cls.joins else _CROSSED
        return {"flow_speed": speed} if cls(JunctionFlowConfig(speed)).suits(site) is None else None

    def place(self, stage: Stage) -> None:
        junction = junction_ahead(stage.site)
        assert junction is not None  # `fits` has seen to it
        way = self._way(junction)
        assert way is not None
        self._junction, self._other = junction, way
        speed = self.config.flow_speed
        line = way.path(self.reach[0] * speed, self.reach[1] * speed)
        clear_line(stage, line)
        gap = self.config.source_dist_interval
        phase = phase_to_meet(stage, line, speed, _RED if self._has_lights else 0.0)
        self._flow = ActorFlow(self, stage, line, speed, gap, prefilled=self.prefilled, phase=phase)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        lights = self._hold_lights(stage) if self._has_lights else wait.seconds(0.0)
        yield from wait.beside(wait.until(wait.left_junction(stage, _END)), lights, self._flow.run())

    @property
    def _has_lights(self) -> bool:
        return self.signalized and self._junction.way.light >= 0

    def _hold_lights(self, stage: Stage) -> Script:
        """Red for the ego and green for the stream, then green for both."""
        own, other = self._junction.way.light, self._other.light
        stage.lights.hold_junction(own, greens=() if other in (-1, own) else (other,))
        yield from wait.seconds(_RED)
        stage.lights.hold_junction(own, greens=(own,) if other < 0 else (own, other))

    def _way(self, junction: JunctionAhead) -> Way | None:
        """The stream's way: into the ego's exit, its own lane first; or the straightest across the route."""
        ways = [way for way in junction.ways(self.side) if junction.crossing(way) is not None]
        if not self.joins:
            return min((way for way in ways if not _same_exit(way, junction.way)), key=_bend, default=None)
        into = [way for way in ways if _same_exit(way, junction.way)]
        return min(into, key=lambda way: (way.after != junction.way.after, _bend(way)), default=None)


@SCENARIOS.register(("2.x", "NonSignalizedJunctionLeftTurn"))
class NonSignalizedJunctionLeftTurn(JunctionFlow):
    """NHTSA pre-crash type: left turn across path, opposite direction, at a junction without signals.

    From the trigger on vehicles come from the opposite approach, straight across the ego's left turn, at `flow_speed`
    and without minding anybody; they appear four seconds before the junction and vanish two and a half behind it. The
    first would meet an ego that keeps its speed. It is over when the ego is 10 m past the junction. It owns a timer of
    240 s.

    Parameters: flow_speed 20 m/s, source_dist_interval 25 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """


@SCENARIOS.register(("2.x", "SignalizedJunctionLeftTurn"))
class SignalizedJunctionLeftTurn(JunctionFlow):
    """NHTSA pre-crash type: left turn across path, opposite direction, at a junction with signals.

    As `NonSignalizedJunctionLeftTurn`; the stream has green all the time, the ego red for 5 s and then green too.

    Parameters: flow_speed 20 m/s, source_dist_interval 25 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    signalized = True


@SCENARIOS.register(("2.x", "NonSignalizedJunctionLeftTurnEnterFlow"))
class NonSignalizedJunctionLeftTurnEnterFlow(JunctionFlow):
    """NHTSA pre-crash type: left turn into path at a junction without signals.

    As `NonSignalizedJunctionLeftTurn`, but the stream from the opposite approach turns into the ego's exit.

    Parameters: flow_speed 20 m/s, source_dist_interval 25 to 50 m.

    Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    joins = True


@SCENARIOS.register(("2.x", "SignalizedJunctionLeftTurnEnterFlow"))
class SignalizedJunctionLeftTurnEnterFlow(JunctionFlow):
    """NHTSA pre-crash type: left turn into path at a junction with signals.

    As `SignalizedJunctionLeftTurn`, but the stream from the opposite approach turns into the ego's exit.

    Parameters: flow_speed 20 m/s, source_dist_interval 25 to 50 m.

    Source: Bench2Drive (reference `leaderboard.md` 6.3).
    """

    joins = True
    signalized = True


@SCENARIOS.register(("2.x", "NonSignalizedJunctionRightTurn"))
class NonSignalizedJunctionRightTurn(JunctionFlow):
    """NHTSA pre-crash type: right turn into path at a junction without signals.

    From the trigger on vehicles come from the left into the ego's exit at `flow_speed`, without minding anybody, from
    five seconds before the junction to three behind it; that way is full of them at once. It is over when the ego is
    10 m past the junction. It owns a timer of 240 s.

    Parameters: flow_speed 20 m/s, source_dist_interval 25 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    turn = RoadOption.RIGHT
    side = LEFT
    joins = True
    reach = (5.0, 3.0)
    prefilled = True


@SCENARIOS.register(("2.x", "SignalizedJunctionRightTurn"))
class SignalizedJunctionRightTurn(NonSignalizedJunctionRightTurn):
    """NHTSA pre-crash type: right turn into path at a junction with signals.

    As `NonSignalizedJunctionRightTurn`; the stream has green all the time, the ego red for 5 s and then green too.

    Parameters: flow_speed 20 m/s, source_dist_interval 25 to 50 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    signalized = True


def _same_exit(one: Way, other: Way) -> bool:
    """Whether two ways leave by the same road, in the same direction."""
    lanes = one.town.lanes
    same_road = lanes.road_id[one.after] == lanes.road_id[other.after]
    return bool(same_road and (lanes.lane_id[one.after] > 0) == (lanes.lane_id[other.after] > 0))


def _bend(way: Way) -> float:
    return abs(way.turn)
