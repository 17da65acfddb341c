"""Two crashed cars and the police block a lane."""

from __future__ import annotations

from lavsim.scenarios.base import SCENARIOS, Stage
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.models import BLUE_LIGHTS, POLICE, pick
from lavsim.scenarios.moves.obstacle import Obstacle, TwoWaysConfig
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import sign_of
from lavsim.scenarios.place import kerb
from lavsim.world.actor import Actor
from lavsim.world.blueprints import find_blueprint

_GAPS = (10.0, 6.0)  # [m] from the police car to the first crashed car, from there to the second
_SHIFT = 0.6  # of half a lane, to the side
_SIGN = "static.prop.warningaccident"


@SCENARIOS.register(("2.x", "Accident"))
class Accident(Obstacle):
    """NHTSA pre-crash type: vehicle(s) stopped in the lane; evade by changing lanes.

    A police car with its lights on stands in the lane, shifted to the side, 10 m behind it a crashed car and 6 m
    farther another; a warning sign stands beside the road at the trigger. 5 s after the ego has come within 50 m
    traffic in the lane beside slows to `speed`. It is over when the ego is 50 m past the last car. It owns a timer of
    240 s. The cars are vehicles, the sign is off the road.

    Parameters: distance 120 m, direction right, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    length = sum(_GAPS)

    def place(self, stage: Stage) -> None:
        police = self._park(stage, POLICE, 0.0)
        police.switch_on(BLUE_LIGHTS)
        self._park(stage, pick(stage.draws, CARS, 1), _GAPS[0])
        self._park(stage, pick(stage.draws, CARS, 2), sum(_GAPS))
        side, sign = sign_of(self.config.direction), find_blueprint(_SIGN)
        offset = side * (kerb(stage.anchor, self.config.direction) + sign.size[0])
        park(self, stage, _SIGN, stage.anchor, offset)

    def _park(self, stage: Stage, model: str, behind: float) -> Actor:
        place = self.at(stage.site, behind)
        offset = sign_of(self.config.direction) * _SHIFT * place.width / 2.0
        return park(self, stage, model, place, offset)


@SCENARIOS.register(("2.x", "AccidentTwoWays"))
class AccidentTwoWays(Accident):
    """NHTSA pre-crash type: vehicle(s) stopped in the lane; passing with oncoming traffic.

    As `Accident`, but the way round is the oncoming lane: 5 s after the ego has come within 50 m vehicles come against
    it at the speed limit, and driving in the wrong lane is not charged until the hazard is over.

    Parameters: distance 120 m, direction right, frequency 20 to 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = TwoWaysConfig
    against_traffic = True
