"""Road works block a lane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.passing import no_place, no_room, oncoming_traffic, passage, slowed_traffic
from lavsim.scenarios.moves.roadside import must_be_ahead, sign_of
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site

_LENGTH = 17.0  # [m] from the sign to the last cones
_CONES_ALONG = (3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0)  # [m] behind the sign, at the lane's edge
_CONES_ACROSS = (-0.5, 0.2, 0.9)  # shares of half a lane, at the end
_DEBRIS = 7.0  # [m] behind the sign
_INSIDE = 0.35  # [m] of the cones from the lane's edge
_NEAR = 30.0  # [m] of the ego from the sign


@dataclass(frozen=True)
class ConstructionObstacleConfig:
    """Where the road works are.

    Attributes:
        distance: From the trigger to the sign along the lane [m].
        direction: Side on which they are; the way round is on the other.
        speed: Most that traffic beside drives 5 s after the ego has come near [km/h].
    """

    distance: float = 100.0
    direction: str = "right"
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "distance", "speed")
        check_direction(self)


@dataclass(frozen=True)
class ConstructionObstacleTwoWaysConfig(ConstructionObstacleConfig):
    """The same, and who comes against the ego; `speed` says nothing here, as in the original.

    Attributes:
        frequency: Gap between oncoming vehicles [m].
    """

    frequency: Interval = Interval(20.0, 100.0)  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "frequency")


@SCENARIOS.register(("2.x", "ConstructionObstacle"))
class ConstructionObstacle(Scenario):
    """NHTSA pre-crash type: object in the lane; evade by changing lanes.

    A warning sign, debris and a row of cones fill the lane over 17 m. 5 s after the ego has come within 30 m traffic
    in the lane beside slows to `speed`. It is over when the ego is 50 m past the last cone. It owns a timer of 240 s.
    Sign and cones collide (the cones give way), debris does not.

    Parameters: distance 100 m, direction right, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config: ClassVar[type[ConstructionObstacleConfig]] = ConstructionObstacleConfig
    against_traffic: ClassVar[bool] = False  # whether the way round is the oncoming lane

    def fits(self, site: Site) -> str | None:
        return no_place(
            site, self.config.distance, self.config.distance + _LENGTH, self.config.direction, self.against_traffic
        )

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_room(site, self.config.distance, self.config.distance + _LENGTH)

    def place(self, stage: Stage) -> None:
        self._place = must_be_ahead(stage.site, self.config.distance)
        side = sign_of(self.config.direction)
        park(self, stage, "static.prop.trafficwarning", self._place, turn=math.pi)
        at = must_be_ahead(stage.site, self.config.distance + _DEBRIS)
        park(self, stage, "static.prop.dirtdebris02", at)
        for along in _CONES_ALONG:
            at = must_be_ahead(stage.site, self.config.distance + along)
            park(self, stage, "static.prop.constructioncone", at, -side * (at.width / 2.0 - _INSIDE))
        at = must_be_ahead(stage.site, self.config.distance + _LENGTH)
        for across in _CONES_ACROSS:
            park(self, stage, "static.prop.constructioncone", at, side * across * (at.width / 2.0 - _INSIDE))

    def script(self, stage: Stage) -> Script:
        length = self.config.distance + _LENGTH
        yield from passage(stage, self.actors[0].xy, _NEAR, length, self._traffic(stage))

    def _traffic(self, stage: Stage) -> Script:
        """Traffic that the ego has to mind while it passes."""
        return slowed_traffic(stage, self.config.speed / 3.6)


@SCENARIOS.register(("2.x", "ConstructionObstacleTwoWays"))
class ConstructionObstacleTwoWays(ConstructionObstacle):
    """NHTSA pre-crash type: object in the lane; passing with oncoming traffic.

    As `ConstructionObstacle`, but the way round is the oncoming lane: 5 s after the ego has come within 30 m vehicles
    come against it at the speed limit, and driving in the wrong lane is not charged until the hazard is over.

    Parameters: distance 100 m, direction right, frequency 20 to 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ConstructionObstacleTwoWaysConfig
    against_traffic = True

    def _traffic(self, stage: Stage) -> Script:
        return oncoming_traffic(self, stage, self._place, self.config.frequency)
