"""A parked car blocks a lane."""

from __future__ import annotations

from lavsim.scenarios.base import SCENARIOS, Stage
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.models import HAZARD_LIGHTS, pick
from lavsim.scenarios.moves.obstacle import Obstacle, TwoWaysConfig
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import sign_of

_SHIFT = 0.7  # of half a lane, to the side


@SCENARIOS.register(("2.x", "ParkedObstacle"))
class ParkedObstacle(Obstacle):
    """NHTSA pre-crash type: vehicle(s) parked in the lane; evade by changing lanes.

    A car with its hazard lights on stands in the lane, shifted to the side. 5 s after the ego has come within 50 m
    traffic in the lane beside slows to `speed`. It is over when the ego is 50 m past the car. It owns a timer of 240 s.

    Parameters: distance 120 m, direction right, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    def place(self, stage: Stage) -> None:
        place = self.at(stage.site)
        offset = sign_of(self.config.direction) * _SHIFT * place.width / 2.0
        car = park(self, stage, pick(stage.draws, CARS), place, offset)
        car.switch_on(HAZARD_LIGHTS)


@SCENARIOS.register(("2.x", "ParkedObstacleTwoWays"))
class ParkedObstacleTwoWays(ParkedObstacle):
    """NHTSA pre-crash type: vehicle(s) parked in the lane; passing with oncoming traffic.

    As `ParkedObstacle`, but the way round is the oncoming lane: 5 s after the ego has come within 50 m vehicles come
    against it at the speed limit, and driving in the wrong lane is not charged until the hazard is over.

    Parameters: distance 120 m, direction right, frequency 20 to 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = TwoWaysConfig
    against_traffic = True
