"""A car stands right behind the junction."""

from __future__ import annotations

from dataclasses import dataclass

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.enter import clear_line
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.junctions import junction_ahead, no_turn
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.place import Site
from lavsim.types import RoadOption, VehicleLight
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_BEHIND = 5.0  # [m] of its middle from where the route leaves the junction
_NEAR = 13.0  # [m] of the ego
_STANDS = 10.0  # [s] from then on
_LONGEST = 60.0  # [s] that it stands in all


@dataclass(frozen=True)
class BlockedIntersectionConfig:
    """Nothing to choose."""


@SCENARIOS.register(("2.x", "BlockedIntersection"))
class BlockedIntersection(Scenario):
    """NHTSA pre-crash type: lead vehicle stopped, out of sight until the turn.

    A car stands 5 m behind the junction on the ego's way. 10 s after the ego has come within 13 m it drives off: it is
    taken away, and the hazard is over, as it is after 60 s at most: traffic that waits behind the car may keep the ego
    from ever coming. It owns a timer of 240 s.

    Parameters: none.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = BlockedIntersectionConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        return "the route leaves no junction behind after it" if junction_ahead(site) is None else None

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_turn(site, RoadOption.LEFT, RoadOption.RIGHT)

    def place(self, stage: Stage) -> None:
        junction = junction_ahead(stage.site)
        assert junction is not None  # `fits` has seen to it
        clear_line(stage, junction.way.path(0.0, 2.0 * _BEHIND))
        place = junction.way.exit.ahead(_BEHIND)
        park(self, stage, pick(stage.draws, CARS), place, moves=True).switch_on(VehicleLight.BRAKE)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        car = self.actors[0]
        comes = wait.until(lambda: wait.gap_to(car, stage.world.ego.xy) < _NEAR)
        yield from wait.first_of(wait.in_turn(comes, wait.seconds(_STANDS)), wait.seconds(_LONGEST))
