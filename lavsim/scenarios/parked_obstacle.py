"""A parked car blocks a lane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.models import HAZARD_LIGHTS, pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.passing import no_place, no_room, oncoming_traffic, passage, slowed_traffic
from lavsim.scenarios.moves.roadside import must_be_ahead, sign_of
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site

_SHIFT = 0.7  # of half a lane, to the side
_NEAR = 50.0  # [m] of the ego from the car


@dataclass(frozen=True)
class ParkedObstacleConfig:
    """Where the car stands.

    Attributes:
        distance: From the trigger along the lane [m].
        direction: Side of the lane, "right" or "left".
        speed: Most that traffic beside it drives 5 s after the ego has come near [km/h].
    """

    distance: float = 120.0
    direction: str = "right"
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "distance", "speed")
        check_direction(self)


@dataclass(frozen=True)
class ParkedObstacleTwoWaysConfig(ParkedObstacleConfig):
    """The same, and who comes against the ego; `speed` says nothing here, as in the original.

    Attributes:
        frequency: Gap between oncoming vehicles [m].
    """

    frequency: Interval = Interval(20.0, 100.0)  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "frequency")


@SCENARIOS.register(("2.x", "ParkedObstacle"))
class ParkedObstacle(Scenario):
    """NHTSA pre-crash type: vehicle(s) parked in the lane; evade by changing lanes.

    A car with its hazard lights on stands in the lane, shifted to the side. 5 s after the ego has come within 50 m
    traffic in the lane beside slows to `speed`. It is over when the ego is 50 m past the car. It owns a timer of 240 s.

    Parameters: distance 120 m, direction right, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config: ClassVar[type[ParkedObstacleConfig]] = ParkedObstacleConfig
    against_traffic: ClassVar[bool] = False  # whether the way round is the oncoming lane

    def fits(self, site: Site) -> str | None:
        return no_place(site, self.config.distance, self.config.distance, self.config.direction, self.against_traffic)

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_room(site, self.config.distance, self.config.distance)

    def place(self, stage: Stage) -> None:
        self._place = must_be_ahead(stage.site, self.config.distance)
        offset = sign_of(self.config.direction) * _SHIFT * self._place.width / 2.0
        car = park(self, stage, pick(stage.draws, CARS), self._place, offset)
        car.switch_on(HAZARD_LIGHTS)

    def script(self, stage: Stage) -> Script:
        yield from passage(stage, self.actors[0].xy, _NEAR, self.config.distance, self._traffic(stage))

    def _traffic(self, stage: Stage) -> Script:
        """Traffic that the ego has to mind while it passes."""
        return slowed_traffic(stage, self.config.speed / 3.6)


@SCENARIOS.register(("2.x", "ParkedObstacleTwoWays"))
class ParkedObstacleTwoWays(ParkedObstacle):
    """NHTSA pre-crash type: vehicle(s) parked in the lane; passing with oncoming traffic.

    As `ParkedObstacle`, but the way round is the oncoming lane: 5 s after the ego has come within 50 m vehicles come
    against it at the speed limit, and driving in the wrong lane is not charged until the hazard is over.

    Parameters: distance 120 m, direction right, frequency 20 to 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ParkedObstacleTwoWaysConfig
    against_traffic = True

    def _traffic(self, stage: Stage) -> Script:
        return oncoming_traffic(self, stage, self._place, self.config.frequency)
