"""Three walkers cross right before the junction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.geometry import right
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.cross import walk
from lavsim.scenarios.moves.junctions import has_light, junction_ahead, no_turn
from lavsim.scenarios.moves.models import WALKERS, pick
from lavsim.scenarios.place import Site, aside, kerb
from lavsim.types import Role

_PLACES = ((0.4, 1.5), (1.0, 2.5), (1.6, 0.5))  # [m] ahead of the last lane point and beyond the kerb
_SPEEDS = (1.3, 2.0)  # [m/s]
_DELAYS = (0.0, 1.5)  # [s]
_LENGTH = 2.3  # times their distance to the middle of the lane
_WITHIN, _NEAR = 3.5, 12.0  # [s], [m] of the ego to that middle
_END = 40.0  # [m] that the ego drives


@dataclass(frozen=True)
class PedestrianCrossingConfig:
    """Nothing to choose."""


@SCENARIOS.register(("2.x", "PedestrianCrossing"))
class PedestrianCrossing(Scenario):
    """NHTSA pre-crash type: pedestrian crossing at a junction.

    Three walkers wait at the right kerb where the ego's lane enters the junction. When the ego would be there within
    3.5 s, or is within 12 m, each starts after a delay of 0 to 1.5 s at 1.3 to 2.0 m/s and walks 2.3 times its distance
    to the middle of the lane. It is over when all have arrived and the ego has driven 40 m.

    Parameters: none.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = PedestrianCrossingConfig

    def fits(self, site: Site) -> str | None:
        return "the route enters no junction after it" if junction_ahead(site) is None else None

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_turn(site) or has_light(site)  # who waits at a red light is in nobody's way

    def place(self, stage: Stage) -> None:
        self._line = _line(stage.site)
        reach = kerb(self._line, "right")
        heading = self._line.yaw - np.pi / 2.0
        for k, (along, beyond) in enumerate(_PLACES):
            position = aside(self._line, reach + beyond, along)
            self.spawn(stage, pick(stage.draws, WALKERS, k), position, heading, Role.SCENARIO)

    def script(self, stage: Stage) -> Script:
        target = self._line.xy
        yield from wait.until_arrival(stage.world.ego, target, _WITHIN, _NEAR)
        speeds = stage.draws.stream("speed").uniform(0, len(_PLACES), *_SPEEDS)
        delays = stage.draws.stream("delay").uniform(0, len(_PLACES), *_DELAYS)
        walks = [
            wait.in_turn(
                wait.seconds(float(delay)),
                walk(walker, -right(self._line.yaw), float(speed), _LENGTH * wait.gap_to(walker, target)),
            )
            for walker, speed, delay in zip(self.actors, speeds, delays, strict=True)
        ]
        yield from wait.together(*walks, wait.driven(stage.world.ego, _END))


def _line(site: Site) -> Waypoint:
    """The last lane centre before the junction."""
    junction = junction_ahead(site)
    assert junction is not None  # `fits` has seen to it
    return junction.way.entry
