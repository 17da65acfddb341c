"""At a traffic light, the ego and crossing traffic get green together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.place import Site
from lavsim.types import LightState, RoadOption

_YELLOW_AT = 10.0  # [m] before the junction
_BACK = 1.0  # [m] farther from the junction than at first: the ego goes elsewhere
_YELLOW = 2.0  # [s]
_PAUSE, _PAUSE_PER_METRE = 1.5, 0.04  # [s], [s/m] of the lights' distance, until the ego gets green
_END = 20.0  # [m] behind the junction
_WAYS = {"left": RoadOption.LEFT, "right": RoadOption.RIGHT, "opposite": RoadOption.STRAIGHT}


@dataclass(frozen=True)
class SignalJunctionConfig:
    """What the original fixes.

    Attributes:
        way: "left", "right" or "opposite" (straight on), what the route does at the junction; read off it if empty.
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    way: str = ""
    other_actors: Mapping[str, Any] = field(default_factory=dict)


class SignalJunctionCrossing(Scenario):
    """Lights of the next junction are set so that opponents and ego enter together.

    The ego's light is held green and all others red. When the ego is less than 10 m from the junction its light turns
    yellow, 2 s later red, and the opponents' green; 1.5 s and 0.04 s for every metre between the two lights later
    the ego's is green, too. Lights go on where they were when the ego has left the junction, and it is over 20 m
    behind. It ends at once without a light or opponents, or when the ego moves away from the junction.

    There are no actors: without background traffic nothing happens.

    Class attributes:
        sides: Where opponents may come from, by what the route does; the first side that there is counts.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1, 6.2).
    """

    Config = SignalJunctionConfig
    appears_at_trigger = True
    sides: ClassVar[Mapping[RoadOption, tuple[str, ...]]] = {}

    def fits(self, site: Site) -> str | None:
        return None

    def suits(self, site: Site) -> str | None:
        if site.turn not in self.sides:
            return "the route does not turn as it asks"
        if site.to_junction > 60.0 or site.exit is None:
            return "no junction follows within 60 m"
        return None if self._opponents(site) else "no lights for the ego and for opponents"

    def place(self, stage: Stage) -> None:
        """It has no actors."""

    def script(self, stage: Stage) -> Script:
        opponents = self._opponents(stage.site)
        if not opponents:
            return
        passed = wait.until(wait.left_junction(stage))
        yield from wait.first_of(passed, self._play(stage, opponents))
        stage.lights.release()
        yield from wait.until(wait.left_junction(stage, _END))

    def _play(self, stage: Stage, opponents: list[int]) -> Script:
        own, lights = stage.site.light, stage.lights
        lights.hold_junction(own, [own])
        first = self._distance(stage)
        while (left := self._distance(stage)) >= _YELLOW_AT:
            if left > first + _BACK:
                return
            yield
        lights.hold(own, LightState.YELLOW)
        yield from wait.seconds(_YELLOW)
        lights.hold(own, LightState.RED)
        for opponent in opponents:
            lights.hold(opponent, LightState.GREEN)
        yield from wait.seconds(_PAUSE + _PAUSE_PER_METRE * self._apart(stage, own, opponents[0]))
        lights.hold(own, LightState.GREEN)
        yield from wait.until(lambda: False)

    def _opponents(self, site: Site) -> list[int]:
        """Lights of the first side from which opponents may come."""
        if site.light < 0:
            return []
        turn = _WAYS.get(self.config.way, site.turn)
        for side in self.sides.get(turn, ()):
            lights = sorted({int(site.town.lanes.light[lane]) for lane in site.approaches(side)} - {-1, site.light})
            if lights:
                return lights
        return []

    @staticmethod
    def _distance(stage: Stage) -> float:
        """Of the ego from the junction, straight [m]."""
        assert stage.site.junction is not None, "there is a light"
        return wait.gap_to(stage.world.ego, stage.route.xy[stage.site.junction[0]])

    @staticmethod
    def _apart(stage: Stage, first: int, second: int) -> float:
        a, b = stage.town.lights[first], stage.town.lights[second]
        return float(np.hypot(a.x - b.x, a.y - b.y))


@SCENARIOS.register(("1.0", "Scenario7"))
class CrossingTraffic(SignalJunctionCrossing):
    """NHTSA pre-crash type: crossing traffic runs a red light.

    Lights are set so that ego and opponents enter together; see `SignalJunctionCrossing`. Opponents: for a left turn
    from the left, the opposite side, the right; for a right turn from the left, the opposite side; straight on from the
    right, the left, the opposite side.
    """

    sides = {  # noqa: RUF012 - a constant
        RoadOption.LEFT: ("left", "opposite", "right"),
        RoadOption.RIGHT: ("left", "opposite"),
        RoadOption.STRAIGHT: ("right", "left", "opposite"),
    }


@SCENARIOS.register(("1.0", "Scenario8"))
class UnprotectedLeftTurn(SignalJunctionCrossing):
    """NHTSA pre-crash type: unprotected left turn across traffic of the opposite direction.

    Lights are set so that ego and opponents enter together; see `SignalJunctionCrossing`. Opponents come from the
    opposite side.
    """

    sides = {RoadOption.LEFT: ("opposite",)}  # noqa: RUF012 - a constant


@SCENARIOS.register(("1.0", "Scenario9"))
class RightTurn(SignalJunctionCrossing):
    """NHTSA pre-crash type: right turn with crossing traffic.

    Lights are set so that ego and opponents enter together; see `SignalJunctionCrossing`. Opponents come from the left,
    or from the opposite side.
    """

    sides = {RoadOption.RIGHT: ("left", "opposite")}  # noqa: RUF012 - a constant
