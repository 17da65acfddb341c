"""What blocks the ego's lane and is passed: parameters and script that such types share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import Scenario, Script, Stage
from lavsim.scenarios.moves.checks import check_direction, check_positive
from lavsim.scenarios.moves.passing import no_gap, no_place, no_room, oncoming_traffic, passage, slowed_traffic
from lavsim.scenarios.moves.roadside import must_be_ahead
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site

ONCOMING = Interval(20.0, 100.0)  # [m] between vehicles that come against the ego


@dataclass(frozen=True)
class ObstacleConfig:
    """Where it stands.

    Attributes:
        distance: From the trigger to its beginning along the lane [m].
        direction: Side of the lane on which it stands, "right" or "left"; the way round is on the other.
        speed: Most that traffic beside it drives 5 s after the ego has come near [km/h].
    """

    distance: float = 120.0
    direction: str = "right"
    speed: float = 60.0

    def __post_init__(self) -> None:
        check_positive(self, "distance", "speed")
        check_direction(self)


@dataclass(frozen=True)
class TwoWaysConfig(ObstacleConfig):
    """The same, and who comes against the ego; `speed` says nothing here, as in the original.

    Attributes:
        frequency: Gap between oncoming vehicles [m].
    """

    frequency: Interval = ONCOMING

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "frequency")


class Obstacle(Scenario):
    """Stands in the lane until the ego is past it.

    Class attributes:
        against_traffic: Whether the way round is the oncoming lane; else it is the lane beside.
        near: Distance of the ego from its first actor at which traffic begins to act [m].
        length: From its beginning to its end [m].
    """

    Config: ClassVar[type[ObstacleConfig]] = ObstacleConfig
    against_traffic: ClassVar[bool] = False
    near: ClassVar[float] = 50.0
    length: ClassVar[float] = 0.0

    def fits(self, site: Site) -> str | None:
        return no_place(site, self.config.distance, self._end, self.config.direction, self.against_traffic)

    def suits(self, site: Site) -> str | None:
        reason = self.fits(site) or no_room(site, self.config.distance, self._end)
        return reason or (no_gap(site, self.config.distance) if self.against_traffic else None)

    def script(self, stage: Stage) -> Script:
        yield from passage(stage, self.actors[0].xy, self.near, self._end, self._traffic(stage))

    def at(self, site: Site, behind: float = 0.0) -> Waypoint:
        """The lane centre `behind` metres after its beginning."""
        return must_be_ahead(site, self.config.distance + behind)

    @property
    def _end(self) -> float:
        """From the trigger [m]."""
        return float(self.config.distance) + self.length

    def _traffic(self, stage: Stage) -> Script:
        """Traffic that the ego has to mind while it passes."""
        if self.against_traffic:
            return oncoming_traffic(self, stage, self.at(stage.site), self.config.frequency)
        return slowed_traffic(stage, self.config.speed / 3.6)
