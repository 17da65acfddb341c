"""Slow bicycles at the edge of the lane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import check_positive
from lavsim.scenarios.moves.flow import BICYCLES
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.moves.park import park
from lavsim.scenarios.moves.passing import WAIT, no_gap, no_place, no_room, oncoming_traffic, slowed_traffic
from lavsim.scenarios.moves.roadside import must_be_ahead
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, line_ahead
from lavsim.world.snapshot import HAZARD_OWNS_TIMER

_GAP = 9.0  # [m] between the two
_SHIFT = 0.55  # of half a lane, to the right
_NEAR, _PAST = 50.0, 50.0  # [m] of the ego from the first; beyond the last


@dataclass(frozen=True)
class HazardAtSideLaneConfig:
    """Where the bicycles are and how they ride.

    Attributes:
        distance: From the trigger to the first bicycle along the lane [m].
        bicycle_speed: [km/h].
        bicycle_drive_distance: How far they ride [m].
        speed: Most that traffic beside drives 5 s after the ego has come near [km/h].
    """

    distance: float = 100.0
    bicycle_speed: float = 10.0
    bicycle_drive_distance: float = 50.0
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "distance", "bicycle_speed", "bicycle_drive_distance", "speed")


@dataclass(frozen=True)
class HazardAtSideLaneTwoWaysConfig(HazardAtSideLaneConfig):
    """The same, and who comes against the ego; `speed` says nothing here, as in the original.

    Attributes:
        frequency: Gap between oncoming vehicles [m].
    """

    frequency: Interval = Interval(100.0, 100.0)  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "frequency")


@SCENARIOS.register(("2.x", "HazardAtSideLane"))
class HazardAtSideLane(Scenario):
    """NHTSA pre-crash type: lead vehicle moving at lower constant speed; evade by changing lanes.

    Two bicycles 9 m apart ride at the right edge of the lane from when the ego is within 50 m of the first, for
    `bicycle_drive_distance`, and stop there. 5 s later traffic in the lane beside slows to `speed`. It is over when the
    ego has passed the foremost and driven 50 m. It owns a timer of 240 s.

    Parameters: distance 100 m, bicycle_speed 10 km/h, bicycle_drive_distance 50 m, speed 60 km/h.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config: ClassVar[type[HazardAtSideLaneConfig]] = HazardAtSideLaneConfig
    against_traffic: ClassVar[bool] = False  # whether the way round is the oncoming lane

    def fits(self, site: Site) -> str | None:
        return no_place(site, self.config.distance, self.config.distance + _GAP, "right", self.against_traffic)

    def suits(self, site: Site) -> str | None:
        last = self.config.distance + _GAP + self.config.bicycle_drive_distance
        reason = self.fits(site) or no_room(site, self.config.distance, last)
        return reason or (no_gap(site, self.config.distance) if self.against_traffic else None)

    def place(self, stage: Stage) -> None:
        self._places = [must_be_ahead(stage.site, self.config.distance + k * _GAP) for k in range(2)]
        for k, place in enumerate(self._places):
            park(self, stage, pick(stage.draws, BICYCLES, k), place, _offset(place), moves=True)

    def script(self, stage: Stage) -> Script:
        stage.flags.set(HAZARD_OWNS_TIMER)
        ego, (first, last) = stage.world.ego, self.actors
        yield from wait.until(lambda: wait.gap_to(ego, first.xy) < _NEAR)
        rides = [self._ride(stage, k) for k in range(2)]
        passed = wait.until(lambda: stage.site.distance_along(last.xy) < stage.progress() - stage.site.at)
        traffic = wait.in_turn(wait.seconds(WAIT), self._traffic(stage))
        end = wait.in_turn(passed, wait.driven(ego, _PAST))
        yield from wait.beside(end, *rides, traffic)

    def _ride(self, stage: Stage, k: int) -> Script:
        bicycle, place = self.actors[k], self._places[k]
        line = line_ahead(place, self.config.bicycle_drive_distance)
        follower = LaneFollower(stage, bicycle, line, self.config.bicycle_speed / 3.6, keeps_distance=True)
        follower.start_aside(_offset(place))
        return follower.run()

    def _traffic(self, stage: Stage) -> Script:
        """Traffic that the ego has to mind while it passes."""
        return slowed_traffic(stage, self.config.speed / 3.6)


@SCENARIOS.register(("2.x", "HazardAtSideLaneTwoWays"))
class HazardAtSideLaneTwoWays(HazardAtSideLane):
    """NHTSA pre-crash type: lead vehicle moving at lower constant speed; passing with oncoming traffic.

    As `HazardAtSideLane`, but the way round is the oncoming lane: 5 s after the ego has come within 50 m vehicles come
    against it at the speed limit. From then on driving in the wrong lane is not charged, to the end of the route: the
    original never switches that test on again.

    Parameters: distance 100 m, bicycle_speed 10 km/h, bicycle_drive_distance 50 m, frequency 100 m.

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = HazardAtSideLaneTwoWaysConfig
    against_traffic = True

    def _traffic(self, stage: Stage) -> Script:
        return oncoming_traffic(self, stage, self._places[1], self.config.frequency, lasting=True)


def _offset(place: Waypoint) -> float:
    return _SHIFT * place.width / 2.0
