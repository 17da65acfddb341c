"""Road works block a lane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from lavsim.scenarios.base import SCENARIOS, Stage
from lavsim.scenarios.moves.obstacle import Obstacle, ObstacleConfig, TwoWaysConfig
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import sign_of

_LENGTH = 17.0  # [m] from the sign to the last cones
_CONES_ALONG = (3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0)  # [m] behind the sign, at the lane's edge
_CONES_ACROSS = (-0.5, 0.2, 0.9)  # shares of half a lane, at the end
_DEBRIS = 7.0  # [m] behind the sign
_INSIDE = 0.35  # [m] of the cones from the lane's edge
_CONE = "static.prop.constructioncone"


@dataclass(frozen=True)
class ConstructionConfig(ObstacleConfig):
    """Nearer than other obstacles."""

    distance: float = 100.0


@dataclass(frozen=True)
class ConstructionTwoWaysConfig(TwoWaysConfig):
    """Nearer than other obstacles."""

    distance: float = 100.0


@SCENARIOS.register(("2.x", "ConstructionObstacle"))
class ConstructionObstacle(Obstacle):
    """NHTSA pre-crash type: object in the lane; evade by changing lanes.

    A warning sign, debris and a row of cones fill the lane over 17 m. 5 s after the ego has come within 30 m traffic
    in the lane beside slows to `speed`. It is over when the ego is 50 m past the last cone. It owns a timer of 240 s.
    Sign and cones collide (the cones give way), debris does not.

    Parameters: distance 100 m, direction right, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config: ClassVar[type[ObstacleConfig]] = ConstructionConfig
    near = 30.0
    length = _LENGTH

    def place(self, stage: Stage) -> None:
        side = sign_of(self.config.direction)
        park(self, stage, "static.prop.trafficwarning", self.at(stage.site), turn=math.pi)
        park(self, stage, "static.prop.dirtdebris02", self.at(stage.site, _DEBRIS))
        for along in _CONES_ALONG:
            at = self.at(stage.site, along)
            park(self, stage, _CONE, at, -side * (at.width / 2.0 - _INSIDE))
        at = self.at(stage.site, _LENGTH)
        for across in _CONES_ACROSS:
            park(self, stage, _CONE, at, side * across * (at.width / 2.0 - _INSIDE))


@SCENARIOS.register(("2.x", "ConstructionObstacleTwoWays"))
class ConstructionObstacleTwoWays(ConstructionObstacle):
    """NHTSA pre-crash type: object in the lane; passing with oncoming traffic.

    As `ConstructionObstacle`, but the way round is the oncoming lane: 5 s after the ego has come within 30 m vehicles
    come against it at the speed limit, and driving in the wrong lane is not charged until the hazard is over.

    Parameters: distance 100 m, direction right, frequency 20 to 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ConstructionTwoWaysConfig
    against_traffic = True
