"""A car pulls out of the parking lane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_direction
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import lane_ahead, must_be_ahead, own_line, parking_beside, sign_of
from lavsim.scenarios.place import Site
from lavsim.types import VehicleLight

_BLOCKER, _CAR = 28.0, 35.0  # [m] after the trigger
_WITHIN, _NEAR = 2.35, 10.0  # [s], [m] of the ego to the car's place
_SPEED, _SECONDS = 4.0, 2.5  # [m/s] of the car, [s] in which it takes the lane
_END = 30.0  # [m] that it drives


@dataclass(frozen=True)
class ParkingCutInConfig:
    """Where the car stands.

    Attributes:
        direction: Side of the parking lane, "right" or "left".
    """

    direction: str = "right"

    def __post_init__(self) -> None:
        check_direction(self)


@SCENARIOS.register(("2.x", "ParkingCutIn"))
class ParkingCutIn(Scenario):
    """NHTSA pre-crash type: vehicle parking or leaving a parked position.

    A car stands in the parking lane 35 m after the trigger, hidden by another at 28 m. When the ego would be there
    within 2.35 s, or is within 10 m, it pulls out into the ego's lane. It is over when it has driven 30 m.

    Parameters: direction right.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ParkingCutInConfig

    def fits(self, site: Site) -> str | None:
        for distance in (_BLOCKER, _CAR, _CAR + _END):
            place = lane_ahead(site, distance)
            if place is None:
                return f"the road ends within {distance:g} m of the trigger"
            if distance <= _CAR and parking_beside(place, self.config.direction) is None:
                return f"there is no parking lane to the {self.config.direction}, {distance:g} m on"
        return None

    def place(self, stage: Stage) -> None:
        for number, distance in enumerate((_BLOCKER, _CAR)):
            slot = parking_beside(must_be_ahead(stage.site, distance), self.config.direction)
            assert slot is not None  # `fits` has seen to it
            park(self, stage, pick(stage.draws, CARS, number), slot, moves=distance == _CAR)

    def script(self, stage: Stage) -> Script:
        place, car = must_be_ahead(stage.site, _CAR), self.actors[1]
        yield from wait.until_arrival(stage.world.ego, place.xy, _WITHIN, _NEAR)
        on_left = self.config.direction == "right"
        car.switch_on(VehicleLight.LEFT_BLINKER if on_left else VehicleLight.RIGHT_BLINKER)
        follower = LaneFollower(stage, car, own_line(stage.site, place, 10.0 * _END), _SPEED)
        follower.start_aside(sign_of(self.config.direction) * float(np.hypot(*(car.xy - place.xy))))
        follower.shift(0.0, _SECONDS)
        yield from wait.beside(wait.driven(car, _END), follower.run())
