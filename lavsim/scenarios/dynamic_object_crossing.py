"""A walker steps out from behind an obstacle at the kerb."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError
from lavsim.geometry import forward, right
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.place import Site, at_height, kerb
from lavsim.types import Role
from lavsim.world.blueprints import find_blueprint

_WALK_SPEED = 2.0  # [m/s]
_BLOCKER_SHARE = 0.9  # the blocker stands at that share of the line from the trigger to the walker
_CLEAR_BEFORE = 6.0  # [m] before the walker that must lie outside junctions: the blocker stands there
_FARTHEST = 4.5  # [m] of the kerb from the lane's middle where a new file puts it: farther, it comes too late
_MARGIN = 0.3  # [m] between the kerb and what stands beside it


@dataclass(frozen=True)
class DynamicObjectCrossingConfig:
    """Where the walker waits and how it crosses.

    Attributes:
        distance: From the trigger to the walker along the lane [m].
        direction: Side it comes from, "right" or "left".
        blocker_model: Blueprint that hides it.
        crossing_angle: Of its way against the perpendicular of the lane [deg], positive towards the ego.
    """

    distance: float = 12.0
    direction: str = "right"
    blocker_model: str = "static.prop.vendingmachine"
    crossing_angle: float = 0.0

    def __post_init__(self) -> None:
        if self.distance <= 0.0:
            raise ConfigError(f"distance must be positive [m], got {self.distance}.")
        if self.direction not in ("right", "left"):
            raise ConfigError(f"direction must be 'right' or 'left', got {self.direction!r}.")
        if not -60.0 <= self.crossing_angle <= 60.0:
            raise ConfigError(f"crossing_angle must lie in -60 to 60 [deg], got {self.crossing_angle}.")
        find_blueprint(self.blocker_model)


@SCENARIOS.register(("2.x", "DynamicObjectCrossing"))
class DynamicObjectCrossing(Scenario):
    """NHTSA pre-crash type: pedestrian crossing without prior vehicle manoeuvre, occluded.

    A walker behind a blocker starts across the lane when the ego would be at its line within 2.1 s (plus 0.1 s for
    every 5 degrees of crossing angle) or is within 6 m of it, walks twice its distance to the lane centre, and is taken
    away with the blocker once the ego has driven 40 m farther.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = DynamicObjectCrossingConfig

    def fits(self, site: Site) -> str | None:
        distance = self.config.distance
        for back in (0.0, _CLEAR_BEFORE):
            place = _walk(site.anchor, max(distance - back, 0.0))
            if place is None:
                return f"the road ends within {distance:g} m of the trigger"
            if place.is_junction:
                return f"the place {distance:g} m after the trigger lies at or just behind a junction"
        return None

    def suits(self, site: Site) -> str | None:
        reach = kerb(site.anchor.ahead(self.config.distance), self.config.direction)
        return self.fits(site) or (f"the walker would stand {reach:.1f} m off the lane" if reach > _FARTHEST else None)

    def place(self, stage: Stage) -> None:
        crossing = stage.anchor.ahead(self.config.distance)
        blocker = find_blueprint(self.config.blocker_model)
        side = 1.0 if self.config.direction == "right" else -1.0
        reach = side * (kerb(crossing, self.config.direction) + _MARGIN + blocker.size[1] / 2.0)
        self._target = crossing.xy
        start = crossing.xy + reach * right(crossing.yaw)
        along = self.config.distance * (1.0 - _BLOCKER_SHARE) + blocker.size[0] / 2.0 + 0.3
        way = -side * right(crossing.yaw) - math.tan(math.radians(self.config.crossing_angle)) * forward(crossing.yaw)
        self._way: NDArray[np.float64] = way / np.hypot(*way)
        self._length = 2.0 * abs(reach)
        self.blocker = self.spawn(
            stage, blocker.name, at_height(start - along * forward(crossing.yaw), crossing.z), crossing.yaw, Role.PROP
        )
        heading = float(np.arctan2(self._way[1], self._way[0]))
        self.walker = self.spawn(stage, "walker.pedestrian.0001", at_height(start, crossing.z), heading, Role.SCENARIO)

    def script(self, stage: Stage) -> Script:
        start_time = 2.1 + 0.1 * math.floor(self.config.crossing_angle / 5.0)
        ego = stage.world.ego
        while (gap := float(np.hypot(*(self._target - ego.xy)))) > 6.0 and gap > start_time * ego.speed:
            yield
        walked_from = self.walker.xy
        self.walker.walk(_WALK_SPEED * self._way)
        begun = stage.progress()
        while stage.progress() - begun < 40.0:
            if np.hypot(*(self.walker.xy - walked_from)) >= self._length:
                self.walker.walk(np.zeros(2))
            yield


def _walk(anchor: Waypoint, distance: float) -> Waypoint | None:
    """The lane centre `distance` m on, by the first branch; None beyond the end of the road."""
    if distance == 0.0:
        return anchor
    reached = anchor.next(distance)
    return reached[0] if reached else None
