"""Two crashed cars and the police block a lane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lavsim.map.town_map import Waypoint
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.models import BLUE_LIGHTS, POLICE, pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.passing import no_place, no_room, oncoming_traffic, passage, slowed_traffic
from lavsim.scenarios.moves.roadside import must_be_ahead, sign_of
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, kerb
from lavsim.world.actor import Actor
from lavsim.world.blueprints import find_blueprint

_GAPS = (10.0, 6.0)  # [m] from the police car to the first crashed car, from there to the second
_SHIFT = 0.6  # of half a lane, to the side
_NEAR = 50.0  # [m] of the ego from the police car
_SIGN = "static.prop.warningaccident"


@dataclass(frozen=True)
class AccidentConfig:
    """Where it happened.

    Attributes:
        distance: From the trigger to the police car along the lane [m].
        direction: Side to which the cars stand, "right" or "left".
        speed: Most that traffic beside it drives 5 s after the ego has come near [km/h].
    """

    distance: float = 120.0
    direction: str = "right"
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "distance", "speed")
        check_direction(self)


@dataclass(frozen=True)
class AccidentTwoWaysConfig(AccidentConfig):
    """The same, and who comes against the ego; `speed` says nothing here, as in the original.

    Attributes:
        frequency: Gap between oncoming vehicles [m].
    """

    frequency: Interval = Interval(20.0, 100.0)  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "frequency")


@SCENARIOS.register(("2.x", "Accident"))
class Accident(Scenario):
    """NHTSA pre-crash type: vehicle(s) stopped in the lane; evade by changing lanes.

    A police car with its lights on stands in the lane, shifted to the side, 10 m behind it a crashed car and 6 m
    farther another; a warning sign stands beside the road at the trigger. 5 s after the ego has come within 50 m
    traffic in the lane beside slows to `speed`. It is over when the ego is 50 m past the last car. It owns a timer of
    240 s. The cars are vehicles, the sign is off the road.

    Parameters: distance 120 m, direction right, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config: ClassVar[type[AccidentConfig]] = AccidentConfig
    against_traffic: ClassVar[bool] = False  # whether the way round is the oncoming lane

    def fits(self, site: Site) -> str | None:
        return no_place(site, self.config.distance, self._length, self.config.direction, self.against_traffic)

    def suits(self, site: Site) -> str | None:
        return self.fits(site) or no_room(site, self.config.distance, self._length)

    def place(self, stage: Stage) -> None:
        police = self._park(stage, POLICE, 0.0)
        police.switch_on(BLUE_LIGHTS)
        self._park(stage, pick(stage.draws, CARS, 1), _GAPS[0])
        self._park(stage, pick(stage.draws, CARS, 2), sum(_GAPS))
        side, sign = sign_of(self.config.direction), find_blueprint(_SIGN)
        offset = side * (kerb(stage.anchor, self.config.direction) + sign.size[0])
        park(self, stage, _SIGN, stage.anchor, offset)

    def script(self, stage: Stage) -> Script:
        yield from passage(stage, self.actors[0].xy, _NEAR, self._length, self._traffic(stage))

    def _traffic(self, stage: Stage) -> Script:
        """Traffic that the ego has to mind while it passes."""
        return slowed_traffic(stage, self.config.speed / 3.6)

    @property
    def _length(self) -> float:
        return float(self.config.distance) + sum(_GAPS)

    def _park(self, stage: Stage, model: str, behind: float) -> Actor:
        place = self._at(stage.site, behind)
        offset = sign_of(self.config.direction) * _SHIFT * place.width / 2.0
        return park(self, stage, model, place, offset)

    def _at(self, site: Site, behind: float) -> Waypoint:
        return must_be_ahead(site, self.config.distance + behind)


@SCENARIOS.register(("2.x", "AccidentTwoWays"))
class AccidentTwoWays(Accident):
    """NHTSA pre-crash type: vehicle(s) stopped in the lane; passing with oncoming traffic.

    As `Accident`, but the way round is the oncoming lane: 5 s after the ego has come within 50 m vehicles come against
    it at the speed limit, and driving in the wrong lane is not charged until the hazard is over.

    Parameters: distance 120 m, direction right, frequency 20 to 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = AccidentTwoWaysConfig
    against_traffic = True

    def _traffic(self, stage: Stage) -> Script:
        return oncoming_traffic(self, stage, self._at(stage.site, 0.0), self.config.frequency)
