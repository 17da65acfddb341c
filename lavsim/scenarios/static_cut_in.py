"""A car leaves the queue in the lane beside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.errors import ConfigError
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import lane_ahead, must_be_ahead, own_line, sign_of
from lavsim.scenarios.place import Site, beside
from lavsim.types import VehicleLight

_GAP = 11.0  # [m] from one middle to the next
_BEHIND, _AHEAD = 2, 3  # vehicles of the queue behind and ahead of the one that leaves it
_WITHIN, _NEAR = 2.7, 15.0  # [s], [m] of the ego to its place
_SPEED, _SECONDS = 4.0, 3.0  # [m/s] of the car, [s] in which it takes the lane
_PLAN, _LONGEST = 70.0, 30.0  # [m] that it drives, or [s]


@dataclass(frozen=True)
class StaticCutInConfig:
    """Where the queue stands.

    Attributes:
        distance: From the trigger to the car that leaves it, along the lane [m].
        direction: Side of the queue's lane, "right" or "left".
    """

    distance: float = 100.0
    direction: str = "right"

    def __post_init__(self) -> None:
        check_positive(self, "distance")
        check_direction(self)
        if self.distance <= _BEHIND * _GAP:
            raise ConfigError(f"distance must be above {_BEHIND * _GAP:g} [m], got {self.distance:g}.")


@SCENARIOS.register(("2.x", "StaticCutIn"))
class StaticCutIn(Scenario):
    """NHTSA pre-crash type: vehicle changing lanes, same direction.

    Six vehicles stand in a queue in the lane beside, 11 m from one to the next. When the ego would be beside the third
    within 2.7 s, or is within 15 m of it, that one changes to the ego's lane within 3 s. It is over when it has driven
    70 m, or after 30 s.

    Parameters: distance 100 m, direction right.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = StaticCutInConfig

    def fits(self, site: Site) -> str | None:
        for k in range(-_BEHIND, _AHEAD + 1):
            place = lane_ahead(site, self.config.distance + k * _GAP)
            if place is None:
                return f"the road ends within {self.config.distance + k * _GAP:g} m of the trigger"
            if beside(place, self.config.direction) is None or place.is_junction:
                where = f"{self.config.distance + k * _GAP:g} m on"
                return f"there is no lane to the {self.config.direction} for the queue, {where}"
        return None

    def place(self, stage: Stage) -> None:
        for number, k in enumerate(range(-_BEHIND, _AHEAD + 1)):
            lane = beside(must_be_ahead(stage.site, self.config.distance + k * _GAP), self.config.direction)
            assert lane is not None  # `fits` has seen to it
            stage.traffic.make_room(lane.xy, _GAP / 2.0)
            park(self, stage, pick(stage.draws, CARS, number), lane, moves=True).switch_on(VehicleLight.BRAKE)

    def script(self, stage: Stage) -> Script:
        place, car = must_be_ahead(stage.site, self.config.distance), self.actors[_BEHIND]
        yield from wait.until_arrival(stage.world.ego, place.xy, _WITHIN, _NEAR)
        car.switch_off(VehicleLight.BRAKE)
        on_left = self.config.direction == "right"
        car.switch_on(VehicleLight.LEFT_BLINKER if on_left else VehicleLight.RIGHT_BLINKER)
        follower = LaneFollower(stage, car, own_line(stage.site, place, 3.0 * _PLAN), _SPEED)
        follower.start_aside(sign_of(self.config.direction) * float(np.hypot(*(car.xy - place.xy))))
        follower.shift(0.0, _SECONDS)
        yield from wait.first_of(wait.seconds(_LONGEST), wait.driven(car, _PLAN), follower.run())
