"""Something stands in the ego's lane and is passed: by the lane beside it, or against oncoming traffic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.base import Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.moves.checks import DIRECTIONS
from lavsim.scenarios.moves.flow import ActorFlow
from lavsim.scenarios.moves.opposing import oncoming_line
from lavsim.scenarios.moves.roadside import lane_ahead
from lavsim.scenarios.parameters import Interval
from lavsim.scenarios.place import Site, beside, oncoming
from lavsim.world.snapshot import HAZARD_OWNS_TIMER, HAZARD_WRONG_LANE_OFF

END = 50.0  # [m] behind the last obstacle where the ego has passed
WAIT = 5.0  # [s] from the ego's coming near until traffic beside or against it moves
_FLOW_TIME, _FLOW_BASE = 1.5, 30.0  # [m per km/h], [m]: how far off oncoming traffic begins
_SLOWED = 100.0  # [m] of road ahead on which traffic minds a limit
_FURTHER = 20.0  # [m] that a road must go on behind the last obstacle
_ROUTE_LEFT = 10.0  # [m] of route behind where it is over
_CALM = 60.5 / 3.6  # [m/s] limit of a road where an ego may be asked to pass against traffic
_CLEAR = 25.0  # [m] before and behind it without a junction


def no_place(site: Site, first: float, last: float, direction: str, against_traffic: bool) -> str | None:
    """Why nothing can fill the lane from `first` to `last` metres after the trigger and be passed; None if it can."""
    for distance in (first, last, last + _FURTHER):
        place = lane_ahead(site, distance)
        if place is None:
            return f"the road ends within {distance:g} m of the trigger"
        if distance > last:
            continue
        if place.is_junction:
            return f"the place {distance:g} m on lies in a junction"
        other = DIRECTIONS[1 - DIRECTIONS.index(direction)]
        if against_traffic and oncoming(place) is None:
            return f"there is no oncoming lane to pass it by, {distance:g} m on"
        if not against_traffic and beside(place, other) is None:
            return f"there is no lane to the {other} to pass it by, {distance:g} m on"
    return None


def no_room(site: Site, first: float, last: float) -> str | None:
    """Why a new file should not put it there: a junction is near, the route changes lanes or ends before it is over."""
    end = site.ahead(last + END + _ROUTE_LEFT)
    if end is None:
        return f"the route ends within {last + END + _ROUTE_LEFT:g} m of the trigger"
    near = range(site.ahead(max(first - _CLEAR, 0.0)) or end, site.ahead(last + _CLEAR) or end)
    if any(site.waypoint(k).is_junction for k in near):
        return "a junction is too near"
    return "the route changes lanes on the way" if site.changes_lane(last + END) else None


def no_gap(site: Site, distance: float) -> str | None:
    """What to say where those who come against the ego would be too fast to find a gap between them."""
    place = lane_ahead(site, distance)
    is_calm = place is not None and place.speed_limit <= _CALM
    return None if is_calm else f"oncoming traffic drives faster than {3.6 * _CALM:.0f} km/h"


def passage(stage: Stage, near: NDArray[np.float64], range_: float, length: float, traffic: Script) -> Script:
    """Waits for the ego to come within `range_` of `near` and to pass `length` metres after the trigger and `END`.

    Args:
        stage: What to act on.
        near: (2,) place of the first obstacle [m].
        range_: [m].
        length: From the trigger to the last obstacle [m].
        traffic: Runs beside it from `WAIT` seconds after the ego came near.
    """
    stage.flags.set(HAZARD_OWNS_TIMER)
    ego = stage.world.ego
    passed = stage.site.at + length + END
    yield from wait.until(lambda: float(np.hypot(*(near - ego.xy))) < range_ or stage.progress() > passed)
    yield from wait.seconds(WAIT)
    yield from wait.beside(wait.until(lambda: stage.progress() > passed), traffic)


def slowed_traffic(stage: Stage, speed: float) -> Script:
    """Keeps background vehicles on the road ahead from driving faster than `speed` [m/s]."""
    while True:
        stage.traffic.hold(stage.traffic.ahead(_SLOWED), speed)
        yield


def oncoming_traffic(
    scenario: Scenario, stage: Stage, beside_it: Waypoint, gap: Interval, lasting: bool = False
) -> Script:
    """Lets traffic come against the ego and allows it the other lane meanwhile, for ever if `lasting`.

    Args:
        scenario: Whose actors they are.
        stage: What to act on.
        beside_it: Lane centre of the obstacle.
        gap: Between two that start [m].
        lasting: Whether the test for wrong lanes stays off when the hazard is over.
    """
    stage.flags.set(HAZARD_WRONG_LANE_OFF, lasting=lasting)
    speed = beside_it.speed_limit
    reach = _FLOW_TIME * 3.6 * speed + _FLOW_BASE
    line = oncoming_line(beside_it, reach, reach)
    assert line is not None  # `fits` has seen to it
    yield from ActorFlow(scenario, stage, line, speed, gap, keeps_distance=True).run()
