"""The ego starts in a parking space and has to find a gap in traffic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lavsim.errors import ScenarioError
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.flow import CARS, ActorFlow
from lavsim.scenarios.moves.meeting import phase_at
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.roadside import parking_beside
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, join, line_ahead, line_behind
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_AT_START = 20.0  # [m] of the trigger from the start of the route
_BEHIND, _AHEAD = 100.0, 150.0  # [m] of road on which traffic passes
_WIDEST = 4.0  # times the smallest gap is the widest
_SOON = 1.8  # [s] after the start the first vehicle passes: who pulls out without looking meets it
_BRAKING = 2.0  # [m/s²]
_STRAIGHT = 60.0  # [m] of road before it where a new file puts it: vehicles come fast
_END = 15.0  # [m] that the ego drives beyond the car before it


@dataclass(frozen=True)
class ParkingExitConfig:
    """The parking space and the traffic.

    Attributes:
        front_vehicle_distance: To the car before [m].
        behind_vehicle_distance: To the car behind [m].
        flow_distance: Smallest gap between vehicles that pass [m].
        direction: Side of the parking lane, "right" or "left".
        speed: Of the vehicles that pass [km/h].
    """

    front_vehicle_distance: float = 20.0
    behind_vehicle_distance: float = 10.0
    flow_distance: float = 25.0
    direction: str = "right"
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "front_vehicle_distance", "behind_vehicle_distance", "flow_distance", "speed")
        check_direction(self)


@SCENARIOS.register(("2.x", "ParkingExit"))
class ParkingExit(Scenario):
    """NHTSA pre-crash type: vehicle leaving a parked position (the ego does).

    The ego starts in the parking lane beside the trigger, between two parked cars, while vehicles pass in its lane.
    The first is there 1.8 s after the start; gaps behind it are `flow_distance` to four times that. They brake for
    the ego, with 2 m/s² at most. It is over when the ego has driven 15 m more than
    `front_vehicle_distance`. It owns a timer of 240 s.

    Parameters: front_vehicle_distance 20 m, behind_vehicle_distance 10 m, flow_distance 25 m, direction right, speed
    60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = ParkingExitConfig
    starts_route = True

    def fits(self, site: Site) -> str | None:
        if site.at > _AT_START:
            return f"the ego starts in the parking space, but the trigger is {site.at:.0f} m after the route's start"
        places = (site.anchor, *self._neighbours(site))
        if any(parking_beside(place, self.config.direction) is None for place in places):
            return f"there is no parking lane to the {self.config.direction} for the ego and the cars before and behind"
        return None

    def suits(self, site: Site) -> str | None:
        line = line_behind(site.anchor, _STRAIGHT)
        length, chord = np.hypot(*np.diff(line, axis=0).T).sum(), np.hypot(*(line[-1] - line[0]))
        is_straight = length > 0.99 * _STRAIGHT and chord > 0.98 * length
        return self.fits(site) or (None if is_straight else "the road before it should be straight")

    def place(self, stage: Stage) -> None:
        if stage.world.tick > 0:
            raise ScenarioError("the ego has left the start of its route")
        slots = [parking_beside(place, self.config.direction) for place in self._neighbours(stage.site)]
        own = parking_beside(stage.anchor, self.config.direction)
        for number, slot in enumerate(slots):
            assert slot is not None  # `fits` has seen to it
            park(self, stage, pick(stage.draws, CARS, number), slot)
        assert own is not None
        stage.world.pose[stage.world.ego.row] = own.x, own.y, stage.anchor.yaw

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        line = join(line_behind(stage.anchor, _BEHIND), line_ahead(stage.anchor, _AHEAD))
        gap = Interval(self.config.flow_distance, _WIDEST * self.config.flow_distance)
        speed = self.config.speed / 3.6
        phase = phase_at(line, speed, stage.anchor.xy, _SOON)
        flow = ActorFlow(
            self, stage, line, speed, gap, prefilled=True, keeps_distance=True, phase=phase, braking=_BRAKING
        )
        left = wait.driven(stage.world.ego, self.config.front_vehicle_distance + _END)
        yield from wait.beside(left, flow.run())

    def _neighbours(self, site: Site) -> tuple[Waypoint, Waypoint]:
        """Lane centres beside the cars before and behind the ego."""
        behind = site.anchor.previous(self.config.behind_vehicle_distance)
        return site.anchor.ahead(self.config.front_vehicle_distance), behind[0] if behind else site.anchor.ahead(1e9)
