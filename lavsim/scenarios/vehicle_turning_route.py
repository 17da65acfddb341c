"""Someone crosses the road into which the ego turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.cross import cross
from lavsim.scenarios.moves.crossing_way import across, at_kerb
from lavsim.scenarios.moves.flow import BICYCLES
from lavsim.scenarios.moves.junctions import junction_ahead, no_turn
from lavsim.scenarios.moves.models import WALKERS, pick
from lavsim.scenarios.place import Site, kerb
from lavsim.types import RoadOption, Role

_SPEED = 1.8  # [m/s]
_NEAR = 6.0  # [m] of the ego to the place where they would meet
_BEYOND = 1.0  # [m] outside the roadway where it waits
_END = 40.0  # [m] that the ego drives


@dataclass(frozen=True)
class VehicleTurningRouteConfig:
    """Nothing to choose."""


@SCENARIOS.register(("2.x", "VehicleTurningRoute"))
class VehicleTurningRoute(Scenario):
    """NHTSA pre-crash type: cyclist crossing, with prior vehicle manoeuvre (turning).

    A bicycle waits at the right kerb of the road into which the ego turns, 11 m behind the junction. When the ego would
    be on its line within 1.8 s, or is within 6 m, it crosses at 1.8 m/s for twice its distance to the ego's lane. It
    is over when the ego has driven 40 m from then on.

    Parameters: none.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = VehicleTurningRouteConfig
    models: ClassVar[tuple[str, ...]] = BICYCLES
    behind: ClassVar[float] = 11.0  # [m] from the junction
    within: ClassVar[float] = 1.8  # [s] of the ego

    def fits(self, site: Site) -> str | None:
        return "the route leaves no junction behind after it" if junction_ahead(site) is None else None

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_turn(site, RoadOption.LEFT, RoadOption.RIGHT)

    def place(self, stage: Stage) -> None:
        junction = junction_ahead(stage.site)
        assert junction is not None  # `fits` has seen to it
        self._line = junction.way.exit.ahead(self.behind)
        self._way = across(self._line.yaw, "right")
        heading = float(np.arctan2(self._way[1], self._way[0]))
        model = pick(stage.draws, self.models)
        self._other = self.spawn(stage, model, at_kerb(self._line, "right", _BEYOND), heading, Role.SCENARIO)

    def script(self, stage: Stage) -> Script:
        yield from wait.until_arrival(stage.world.ego, self._line.xy, self.within, _NEAR)
        crossing = cross(self._other, self._way, _SPEED, self._length(self._line))
        yield from wait.beside(wait.driven(stage.world.ego, _END), crossing)

    def _length(self, line: Waypoint) -> float:
        """How far it goes [m]."""
        return 2.0 * (kerb(line, "right") + _BEYOND)


@SCENARIOS.register(("2.x", "VehicleTurningRoutePedestrian"))
class VehicleTurningRoutePedestrian(VehicleTurningRoute):
    """NHTSA pre-crash type: pedestrian crossing, with prior vehicle manoeuvre (turning).

    A walker waits at the right kerb right behind the junction. When the ego would be on its line within 2.2 s, or is
    within 6 m, it crosses the whole road at 1.8 m/s. It is over when the ego has driven 40 m from then on. The original
    enters a collision while it runs twice in the record; the score here counts it once.

    Parameters: none.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    models = WALKERS
    behind = 1.0
    within = 2.2

    def _length(self, line: Waypoint) -> float:
        return kerb(line, "right") + kerb(line, "left") + 2.0 * _BEYOND
