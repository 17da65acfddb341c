"""A walker steps out from behind a parked car."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.errors import ConfigError
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.cross import walk
from lavsim.scenarios.moves.crossing_way import across
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.models import WALKERS, pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import lane_ahead, must_be_ahead, parking_beside
from lavsim.scenarios.place import Site, aside
from lavsim.types import Role
from lavsim.world.blueprints import find_blueprint

_SPEED, _LENGTH = 2.0, 8.0  # [m/s], [m] of the walker
_BEHIND = 0.7  # [m] of the walker from the car's front
_NEAR = 6.0  # [m] of the ego to the place where they would meet
_END = 40.0  # [m] that the ego drives


@dataclass(frozen=True)
class ParkingCrossingPedestrianConfig:
    """Where the walker waits and how it crosses.

    Attributes:
        distance: From the trigger to the walker along the lane [m].
        direction: Side it comes from, "right" or "left".
        crossing_angle: Of its way against the perpendicular of the lane [deg], positive towards the ego.
    """

    distance: float = 12.0
    direction: str = "right"
    crossing_angle: float = 0.0

    def __post_init__(self) -> None:
        check_positive(self, "distance")
        check_direction(self)
        if not -60.0 <= self.crossing_angle <= 60.0:
            raise ConfigError(f"crossing_angle must lie in -60 to 60 [deg], got {self.crossing_angle}.")


@SCENARIOS.register(("2.x", "ParkingCrossingPedestrian"))
class ParkingCrossingPedestrian(Scenario):
    """NHTSA pre-crash type: pedestrian crossing without prior vehicle manoeuvre, occluded by a parked car.

    A walker before a car in the parking lane starts across when the ego would be at its line within 2.15 s (plus
    0.1 s for every 5 degrees of crossing angle) or is within 6 m of it, and walks 8 m at 2 m/s. It is over when the ego
    has driven 40 m from then on.

    Parameters: distance 12 m, crossing_angle 0 degrees, direction right.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ParkingCrossingPedestrianConfig

    def fits(self, site: Site) -> str | None:
        for distance in (self.config.distance, max(self.config.distance - 6.0, 0.0)):
            place = lane_ahead(site, distance)
            if place is None:
                return f"the road ends within {distance:g} m of the trigger"
            if parking_beside(place, self.config.direction) is None:
                return f"there is no parking lane to the {self.config.direction}, {distance:g} m on"
        return None

    def place(self, stage: Stage) -> None:
        direction = self.config.direction
        model = pick(stage.draws, CARS)
        back = find_blueprint(model).size[0] / 2.0 + _BEHIND
        before = must_be_ahead(stage.site, max(self.config.distance - back, 0.0))
        slot = parking_beside(before, direction)
        self._place = must_be_ahead(stage.site, self.config.distance)
        start = parking_beside(self._place, direction)
        assert slot is not None  # `fits` has seen to it
        assert start is not None
        park(self, stage, model, slot)
        self._way = across(self._place.yaw, direction, self.config.crossing_angle)
        heading = float(np.arctan2(self._way[1], self._way[0]))
        self._walker = self.spawn(stage, pick(stage.draws, WALKERS, 1), aside(start, 0.0), heading, Role.SCENARIO)

    def script(self, stage: Stage) -> Script:
        within = 2.15 + 0.1 * np.floor(self.config.crossing_angle / 5.0)
        yield from wait.until_arrival(stage.world.ego, self._place.xy, within, _NEAR)
        crossing = walk(self._walker, self._way, _SPEED, _LENGTH)
        yield from wait.beside(wait.driven(stage.world.ego, _END), crossing)
