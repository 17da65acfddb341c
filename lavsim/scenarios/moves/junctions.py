"""The junction that a route leads through next: who else comes to it, from which side, and on which lanes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.map.town_map import TownMap
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.place import Site, join
from lavsim.types import LaneType, RoadOption

Floats = NDArray[np.float64]

SAME, LEFT, OPPOSITE, RIGHT = "same", "left", "opposite", "right"
_MOST_PIECES = 8  # lanes that one way through a junction may consist of
_ROUTE_LEFT = 60.0  # [m] behind the junction: hazards at junctions are over by then
_MEET = 1.0  # [m] centre lines that come closer than that cross or merge


@dataclass(frozen=True)
class Way:
    """One way through a junction: the lanes in it, with the lane before and the lane after.

    Attributes:
        town: Where.
        before: Lane that leads in.
        inside: Lanes of the junction, in order.
        after: Lane it leads to.
    """

    town: TownMap
    before: int
    inside: tuple[int, ...]
    after: int

    @property
    def entry(self) -> Waypoint:
        """Where it enters the junction, on the lane before."""
        return self.town.waypoint_at(self.before, np.inf)

    @property
    def exit(self) -> Waypoint:
        """Where it leaves the junction, on the lane after."""
        return self.town.waypoint_at(self.after, 0.0)

    @property
    def turn(self) -> float:
        """How much it turns, clockwise positive [rad]."""
        return float(np.mod(self.exit.yaw - self.entry.yaw + np.pi, 2.0 * np.pi) - np.pi)

    @property
    def light(self) -> int:
        """The traffic light that governs it, or -1."""
        return max(int(self.town.lanes.light[lane]) for lane in self.inside)

    def path(self, before: float, after: float) -> Floats:
        """Centre line from `before` metres ahead of the junction to `after` metres behind it (N, 2) [m].

        It is shorter where the road ends or another junction comes first.
        """
        lanes, town = self.town.lanes, self.town
        pieces: list[tuple[int, float, float]] = [(lane, 0.0, float(lanes.length[lane])) for lane in self.inside]
        lane, rest = self.before, before
        while rest > 0.0 and lane >= 0:
            length = float(lanes.length[lane])
            pieces.insert(0, (lane, max(length - rest, 0.0), length))
            lane, rest = _first_outside(town, lanes.predecessors(lane)), rest - length
        lane, rest = self.after, after
        while rest > 0.0 and lane >= 0:
            length = float(lanes.length[lane])
            pieces.append((lane, 0.0, min(rest, length)))
            lane, rest = _first_outside(town, lanes.successors(lane)), rest - length
        return _centres(town, pieces)

    def inner(self) -> Floats:
        """Centre line inside the junction (N, 2) [m]."""
        return self.path(0.0, 0.0)


@dataclass(frozen=True)
class JunctionAhead:
    """Where a route passes its next junction.

    Attributes:
        junction: Its index in the town.
        way: The route's own way through it.
        start: Length of the route up to the junction [m].
        end: Length of the route up to where it has left the junction [m].
    """

    junction: int
    way: Way
    start: float
    end: float

    def ways(self, *sides: str) -> list[Way]:
        """All ways of others who come from `sides` as the route's approach sees them; those of the first side first."""
        yaw = self.way.entry.yaw
        found = ways_through(self.way.town, self.junction)
        return [way for side in sides for way in found if side_of(yaw, way.entry.yaw) == side]

    def crossing(self, other: Way) -> Floats | None:
        """Where the route's own way first meets `other` (2,) [m]; None where they don't meet."""
        own, theirs = self.way.path(0.0, 3.0), other.path(0.0, 3.0)
        apart = np.hypot(*(own[:, None] - theirs[None]).transpose(2, 0, 1))
        near = np.flatnonzero(apart.min(axis=1) < _MEET)
        return own[near[0]] if len(near) else None


def junction_ahead(site: Site) -> JunctionAhead | None:
    """The next junction of the route after `site`, or the one it lies in; None where the route leaves none behind."""
    if site.junction is None or site.junction[1] + 1 >= len(site.route) or site.junction[0] == 0:
        return None
    first, last = site.junction
    route, lanes = site.route, site.town.lanes
    inside = tuple(dict.fromkeys(int(lane) for lane in route.lane[first : last + 1]))
    leading, following = lanes.predecessors(inside[0]).tolist(), lanes.successors(inside[-1]).tolist()
    before = _own(route.lane[max(first - 3, 0) : first][::-1].tolist(), leading)
    after = _own(route.lane[last + 1 : last + 4].tolist(), following)
    if before < 0 or after < 0:
        return None
    way = Way(site.town, before, inside, after)
    index = int(lanes.junction[inside[0]])
    return JunctionAhead(index, way, float(route.distance[first]), float(route.distance[last + 1]))


def no_light(site: Site) -> str | None:
    """What to say where the next junction has no light for the route; None where it has one."""
    return "the next junction has no traffic light for the route" if site.light < 0 else None


def has_light(site: Site) -> str | None:
    """What to say where the next junction has a light for the route; None where it has none."""
    return "the next junction has a traffic light for the route" if site.light >= 0 else None


def no_turn(site: Site, *turns: RoadOption, near: float = 20.0, far: float = 60.0) -> str | None:
    """Why a trigger should not stand at `site`: the next junction is too near or far, or the route does not turn."""
    if not near <= site.to_junction <= far:
        return f"the next junction should begin {near:g} to {far:g} m after the trigger"
    if site.junction is not None and site.route.length - site.route.distance[site.junction[1]] < _ROUTE_LEFT:
        return f"the route should go on for {_ROUTE_LEFT:g} m behind the junction"
    if turns and site.turn not in turns:
        return f"the route should go {' or '.join(turn.name.lower() for turn in turns)} there"
    return None


def ways_through(town: TownMap, junction: int) -> list[Way]:
    """All ways for vehicles through a junction, in the order of the lane table."""
    lanes = town.lanes
    found: list[Way] = []
    for lane in town.junctions[junction].lanes:
        if lanes.type[lane] & int(LaneType.DRIVING):
            for before in lanes.predecessors(lane).tolist():
                if lanes.junction[before] != junction:
                    found += [Way(town, before, inside, after) for inside, after in _through(town, (lane,))]
    return found


def side_of(yaw: float, other: float) -> str:
    """The side from which traffic with heading `other` comes, for one who drives with heading `yaw` [rad].

    Source: the leaderboard's sectors, 30 to 135 degrees, to 225, to 330.
    """
    turned = np.degrees(other - yaw) % 360.0
    if not 30.0 < turned <= 330.0:
        return SAME
    return LEFT if turned <= 135.0 else OPPOSITE if turned <= 225.0 else RIGHT


def _through(town: TownMap, inside: tuple[int, ...]) -> Iterator[tuple[tuple[int, ...], int]]:
    lanes = town.lanes
    for following in lanes.successors(inside[-1]).tolist():
        if lanes.junction[following] != lanes.junction[inside[0]]:
            yield inside, following
        elif len(inside) < _MOST_PIECES and following not in inside:
            yield from _through(town, (*inside, following))


def _own(route: Sequence[int], linked: Sequence[int]) -> int:
    """The lane of the route among `linked`; else the first of them, -1 if there is none."""
    return next((lane for lane in route if lane in linked), linked[0] if linked else -1)


def _first_outside(town: TownMap, choices: NDArray[np.int32]) -> int:
    """The first of `choices` outside junctions, -1 if there is none."""
    return next((int(lane) for lane in choices if town.lanes.junction[lane] < 0), -1)


def _centres(town: TownMap, pieces: Sequence[tuple[int, float, float]]) -> Floats:
    lines = []
    for lane, low, high in pieces:
        u = np.linspace(low, high, max(int(np.ceil(high - low)), 1) + 1)
        lines.append(town.centre(np.full(len(u), lane), u)[:, :2])
    return join(*lines)
