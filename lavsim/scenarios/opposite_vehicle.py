"""An emergency vehicle crosses the junction without minding anybody."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.enter import drive_through, enter, within
from lavsim.scenarios.moves.junctions import JunctionAhead, Way, has_light, junction_ahead, no_light, no_turn
from lavsim.scenarios.moves.models import BLUE_LIGHTS, EMERGENCY, pick
from lavsim.scenarios.moves.pursuit import STEP
from lavsim.scenarios.place import Site

_SIDES = ("right", "left", "opposite")
_BEFORE, _AFTER = 30.0, 100.0  # [m] of its way before and behind the junction
_SPEED = 60.0 / 3.6  # [m/s]
_NEAR = 12.0  # [m] of the ego to the place where the ways meet
_STRAIGHT = np.radians(35.0)  # that its way turns at most where a new file puts it
_NOMINAL = 2.0  # times the time its way takes, after which it no longer matters


@dataclass(frozen=True)
class OppositeVehicleConfig:
    """Where it comes from.

    Attributes:
        direction: "right", "left" or "opposite", as the ego sees the junction.
    """

    direction: str = "right"

    def __post_init__(self) -> None:
        if self.direction not in _SIDES:
            raise ConfigError(f"direction must be 'right', 'left' or 'opposite', got {self.direction!r}.")


@SCENARIOS.register(("2.x", "OppositeVehicleTakingPriority"))
class OppositeVehicleTakingPriority(Scenario):
    """NHTSA pre-crash type: straight crossing paths at a junction without signals.

    An emergency vehicle with its lights on waits 30 m before the junction on the approach that `direction` names. When
    the ego would be at the place where their ways meet in as much time as it needs itself (2.2 s, the original's fixed
    number, at a junction of usual size), or is within 12 m of it, it crosses at 60 km/h. It is over when it has passed
    (or should have) and the ego has left the junction.

    Parameters: direction right.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = OppositeVehicleConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        junction = junction_ahead(site)
        if junction is None:
            return "the route crosses no junction after it"
        if self._way(junction) is None:
            return f"at the next junction nobody who comes from the {self.config.direction} crosses the route"
        return None

    def suits(self, site: Site) -> str | None:
        return no_turn(site) or has_light(site) or self._no_straight_way(site)

    def _no_straight_way(self, site: Site) -> str | None:
        """What to say where nobody comes fast: who has to turn brakes for the bend."""
        if (reason := self.fits(site)) is not None:
            return reason
        junction = junction_ahead(site)
        way = None if junction is None else self._way(junction)
        is_straight = way is not None and abs(way.turn) < _STRAIGHT
        return None if is_straight else f"nobody goes straight on who comes from the {self.config.direction}"

    def place(self, stage: Stage) -> None:
        junction = junction_ahead(stage.site)
        assert junction is not None  # `fits` has seen to it
        way = self._way(junction)
        assert way is not None
        meeting = junction.crossing(way)
        assert meeting is not None
        self._junction, self._meeting = junction, meeting
        self._car = enter(self, stage, pick(stage.draws, EMERGENCY), way.path(_BEFORE, _AFTER), _SPEED)
        self._car.actor.switch_on(BLUE_LIGHTS)

    def script(self, stage: Stage) -> Script:
        yield from wait.until_arrival(stage.world.ego, self._meeting, self._time_to(self._meeting), _NEAR)
        crossing = within(_NOMINAL * self._car.left / _SPEED, drive_through(self._car))
        yield from wait.together(crossing, wait.until(wait.left_junction(stage)))

    def _time_to(self, place: NDArray[np.float64]) -> float:
        """How long it drives to the point of its way nearest to `place` [s]; bends slow it down."""
        line = self._car.line
        nearest = int(np.argmin(np.hypot(*(line.xy - place).T)))
        return float((STEP / np.minimum(_SPEED, line.pace[:nearest])).sum())

    def _way(self, junction: JunctionAhead) -> Way | None:
        """The straightest way from its side that meets the route."""
        ways = [way for way in junction.ways(self.config.direction) if junction.crossing(way) is not None]
        return min(ways, key=lambda way: abs(way.turn), default=None)


@SCENARIOS.register(("2.x", "OppositeVehicleRunningRedLight"))
class OppositeVehicleRunningRedLight(OppositeVehicleTakingPriority):
    """NHTSA pre-crash type: running a red light (the other vehicle does).

    As `OppositeVehicleTakingPriority`, at a junction with lights: that of the ego is green and all others are red until
    the hazard is over. Where the map has no light for the route it runs without.

    Parameters: direction right.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    def suits(self, site: Site) -> str | None:
        return no_turn(site) or no_light(site) or self._no_straight_way(site)

    def script(self, stage: Stage) -> Script:
        light = self._junction.way.light
        if light >= 0:
            stage.lights.hold_junction(light, greens=(light,))
        yield from super().script(stage)
