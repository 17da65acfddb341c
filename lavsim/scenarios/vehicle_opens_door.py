"""The door of a parked car opens into the lane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.geometry import forward, right
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.moves.passing import END, WAIT, no_gap, no_place, no_room, oncoming_traffic
from lavsim.scenarios.moves.roadside import must_be_ahead, parking_beside, sign_of
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, at_height
from lavsim.types import Role
from lavsim.world.actor import VehicleDoor
from lavsim.world.blueprints import find_blueprint
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_WITHIN, _NEAR = 3.0, 10.0  # [s], [m] of the ego to the car
_OVER = 0.25  # [m] that the car stands over the edge of the parking lane
_DOOR = "static.prop.cardoor"
_HINGE = 0.16  # of the car's length before its middle: where the picture of it has the front door


@dataclass(frozen=True)
class VehicleOpensDoorConfig:
    """Where the car stands, and who comes against the ego.

    Attributes:
        distance: From the trigger along the lane [m].
        direction: Side of the parking lane, "right" or "left".
        frequency: Gap between oncoming vehicles [m].
        speed: Says nothing here, as in the original [km/h].
    """

    distance: float = 50.0
    direction: str = "right"
    frequency: Interval = Interval(20.0, 100.0)  # noqa: RUF009 - frozen
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "distance", "frequency", "speed")
        check_direction(self)


@SCENARIOS.register(("2.x", "VehicleOpensDoorTwoWays"))
class VehicleOpensDoorTwoWays(Scenario):
    """NHTSA pre-crash type: vehicle(s) parked; passing with oncoming traffic.

    A car in the parking lane opens the door on the road's side when the ego would be beside it within 3 s, or is within
    10 m. 5 s later vehicles come against the ego at the speed limit, and driving in the wrong lane is not charged until
    the hazard is over, 50 m past the car. It owns a timer of 240 s. The open door is an actor of its own, 0.95 m wide:
    to touch it counts as layout.

    Parameters: distance 50 m, direction right, frequency 20 to 100 m, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = VehicleOpensDoorConfig

    def fits(self, site: Site) -> str | None:
        distance, direction = self.config.distance, self.config.direction
        reason = no_place(site, distance, distance, direction, against_traffic=True)
        if reason is None and parking_beside(must_be_ahead(site, distance), direction) is None:
            return f"there is no parking lane to the {direction}, {distance:g} m on"
        return reason

    def suits(self, site: Site) -> str | None:
        distance = self.config.distance
        return self.fits(site) or no_room(site, distance, distance) or no_gap(site, distance)

    def place(self, stage: Stage) -> None:
        self._place = must_be_ahead(stage.site, self.config.distance)
        slot = parking_beside(self._place, self.config.direction)
        assert slot is not None  # `fits` has seen to it
        model, side = pick(stage.draws, CARS), sign_of(self.config.direction)
        edge = slot.xy - side * slot.width / 2.0 * right(slot.yaw)
        middle = edge + side * (find_blueprint(model).size[1] / 2.0 - _OVER) * right(slot.yaw)
        self._car = self.spawn(stage, model, at_height(middle, slot.z), self._place.yaw, Role.PROP)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        yield from wait.until_arrival(stage.world.ego, self._car.xy, _WITHIN, _NEAR)
        self._open_door(stage)
        traffic = oncoming_traffic(self, stage, self._place, self.config.frequency)
        passed = wait.until(wait.ego_past(stage, self.config.distance + END))
        yield from wait.beside(passed, wait.in_turn(wait.seconds(WAIT), traffic))

    def _open_door(self, stage: Stage) -> None:
        """Opens it for the eye and puts a panel there for the touch; boxes of actors don't change."""
        car, side = self._car, -sign_of(self.config.direction)
        car.open_door(VehicleDoor.FRONT_LEFT if side < 0.0 else VehicleDoor.FRONT_RIGHT)
        reach = (float(car.size[1]) + find_blueprint(_DOOR).size[1]) / 2.0
        middle = car.xy + _HINGE * float(car.size[0]) * forward(car.yaw) + side * reach * right(car.yaw)
        position = at_height(np.asarray(middle), self._place.z)
        self.spawn(stage, _DOOR, position, car.yaw, Role.PROP)
