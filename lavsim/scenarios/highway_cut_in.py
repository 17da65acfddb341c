"""A car from the slip road cuts in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import right
from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.enter import clear_line, enter
from lavsim.scenarios.moves.flow import CARS
from lavsim.scenarios.moves.follow import LaneFollower
from lavsim.scenarios.moves.junctions import LEFT, RIGHT, SAME, JunctionAhead, Way, has_light, junction_ahead, no_turn
from lavsim.scenarios.moves.models import pick
from lavsim.scenarios.parameters import Location
from lavsim.scenarios.place import Site, line_ahead
from lavsim.types import VehicleLight

_BEFORE, _ROAD = 60.0, 400.0  # [m] of the slip road where no file names a place; of the car's way
_BESIDE, _TURN = 4.5, np.radians(15.0)  # [m], [rad] of the car's way from the route's where they run side by side
_HEAD = 9.0  # [m] that the car is ahead of the ego when it cuts in
_CLOSE, _SPARE = 1.0, 3.0  # [m] off that at most; more of it before the end of the slip road, whose bend makes slow
_LAST, _GAIN = 15.0, 0.1  # [m] of its way before it is beside the ego: from there on it minds its place, [1/m]
_SLOWER, _FASTER = 0.8, 1.3  # of the ego's speed
_FASTEST, _SLOWEST = 35.0, 3.0  # [m/s] while it comes alongside
_FAST, _LANE = 59.0 / 3.6, 3.0  # [m/s] limit of a road, [m] of the car's lane from the ego's where a new file puts it
_SLOPE = 0.25  # of its way that it moves aside at most: slow ones take longer than 2 s
_SECONDS, _OTHER_LANE = 2.0, 3.0  # [s] of the change, [s] in the ego's lane afterwards


@dataclass(frozen=True)
class HighwayCutInConfig:
    """Where the car starts.

    Attributes:
        other_actor_location: On the slip road [m]; None: 60 m before the ego's next junction, on a lane that joins it.
    """

    other_actor_location: Location | None = None


@SCENARIOS.register(("2.x", "HighwayCutIn"))
class HighwayCutIn(Scenario):
    """NHTSA pre-crash type: vehicle changing lanes, same direction, from a slip road.

    A car on the slip road drives so that it is 9 m before the ego where the two roads run side by side, or soon after,
    then changes to the ego's lane within 2 s at 80 % of the ego's speed. It is over 3 s later.

    Parameters: other_actor_location (a place).

    Source: leaderboard 2.x (reference `leaderboard.md` 6.3).
    """

    Config = HighwayCutInConfig
    appears_at_trigger = True

    def fits(self, site: Site) -> str | None:
        line = self._line(site)
        if line is None:
            return "no slip road joins at the next junction"
        return None if _alongside(site, line) is not None else "the car's way does not run along the route"

    def suits(self, site: Site) -> str | None:
        if site.anchor.speed_limit < _FAST:  # asked first, as it is quick to tell
            return f"the speed limit is below {3.6 * _FAST:.0f} km/h"
        reason = no_turn(site, near=40.0, far=150.0) or has_light(site)
        line = self._line(site) if reason is None else None
        found = None if line is None else _alongside(site, line)
        return reason or (None if found and abs(found[2]) > _LANE else "no slip road runs beside the ego's lane")

    def place(self, stage: Stage) -> None:
        line = self._line(stage.site)
        assert line is not None  # `fits` has seen to it
        clear_line(stage, line)
        self._car = enter(self, stage, pick(stage.draws, CARS), line, 0.0)
        self._car.actor.launch(stage.world.ego.speed)

    def script(self, stage: Stage) -> Script:
        found = _alongside(stage.site, self._car.line.xy)
        assert found is not None  # `fits` has seen to it
        along, meeting, aside = found
        yield from _come_alongside(stage, self._car, along, meeting)
        self._car.actor.switch_on(VehicleLight.LEFT_BLINKER if aside < 0.0 else VehicleLight.RIGHT_BLINKER)
        self._car.speed = _SLOWER * stage.world.ego.speed
        seconds = max(_SECONDS, abs(aside) / (_SLOPE * max(self._car.speed, 1.0)))
        self._car.shift(aside, seconds)
        yield from wait.first_of(wait.seconds(seconds + _OTHER_LANE), self._car.run())

    def _line(self, site: Site) -> NDArray[np.float64] | None:
        place = self.config.other_actor_location
        if place is not None:
            return line_ahead(site.town.waypoint(np.array(place[:3])), _ROAD)
        junction = junction_ahead(site)
        joining = [] if junction is None else _joining(junction)
        return joining[0].path(_BEFORE, _ROAD) if joining else None


def _come_alongside(stage: Stage, car: LaneFollower, along: float, meeting: float) -> Script:
    """Drives so that it is `_HEAD` before the ego at `along` metres of its way, `meeting` metres of the route.

    Where it is not yet then, or has not been able to wait for so long, it makes up for it beside the ego: who is cut in
    on from its side has nothing to brake for.
    """
    ego = stage.world.ego
    while not car.finished:
        left, to_meeting = along - car.travelled, meeting - (stage.progress() - stage.site.at)
        head = to_meeting - left
        if left <= 0.0 and abs(head - _HEAD) < _CLOSE:
            break
        if left > _LAST or (left > 0.0 and head > _HEAD + _SPARE):
            seconds = max((to_meeting - _HEAD - _SPARE) / max(ego.speed, 1.0), 0.5)
            car.speed = float(np.clip(left / seconds, _SLOWEST, _FASTEST))
        else:
            car.speed = ego.speed * float(np.clip(1.0 + _GAIN * (_HEAD - head), _SLOWER, _FASTER))
        car.step()
        yield


def _alongside(site: Site, line: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """Where a line first runs beside the route: metres of the line, metres of route from the trigger, and how far to
    the right of the line the route is [m].
    """
    steps = np.diff(line, axis=0)
    yaw = np.arctan2(steps[:, 1], steps[:, 0])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    route, headings = site.route.xy[site.index :], site.route.yaw[site.index :]
    gaps = np.hypot(*(line[:-1, None] - route[None]).transpose(2, 0, 1))
    nearest = np.argmin(gaps, axis=1)
    turn = np.abs(np.mod(yaw - headings[nearest] + np.pi, 2.0 * np.pi) - np.pi)
    found = np.flatnonzero((gaps[np.arange(len(nearest)), nearest] < _BESIDE) & (turn < _TURN) & (nearest > 0))
    if not len(found):
        return None
    k = int(found[0])
    i = int(nearest[k])
    aside = float(right(headings[i]) @ (route[i] - line[k]))
    return float(along[k]), float(site.route.distance[site.index + i]) - site.at, aside


def _joining(junction: JunctionAhead) -> list[Way]:
    """Ways from other roads into the road that the route takes, the straightest first."""
    own, lanes = junction.way, junction.way.town.lanes
    road, came = lanes.road_id[own.after], lanes.road_id[own.before]
    ways = junction.ways(SAME, LEFT, RIGHT)
    ways = [way for way in ways if lanes.road_id[way.after] == road and lanes.road_id[way.before] != came]
    return sorted(ways, key=lambda way: abs(way.turn))
