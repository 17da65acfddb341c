"""Where hazards stand: on the route, along its lane, in the lanes beside it, at the junction ahead."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import forward, right, wrap_angle
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.map.waypoint import MOST_STEPS, Waypoint
from lavsim.types import LaneType, RoadOption

Floats = NDArray[np.float64]

LINE_STEP = 0.5  # [m] between the points of a line along lanes
_WIDE = 2.0  # [m] narrower strips are no place to wait beyond
_SIDE = math.radians(45.0)  # lanes that meet the ego's way at less run with it or against it
_CHANGES = (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)


@dataclass(frozen=True)
class Site:
    """Where on a route a hazard is set off.

    Attributes:
        town: The town.
        route: The ego's route.
        index: Point of the route at the trigger.
    """

    town: TownMap = field(repr=False)
    route: Route = field(repr=False)
    index: int

    @cached_property
    def anchor(self) -> Waypoint:
        """Lane centre at the trigger."""
        return self.waypoint(self.index)

    @property
    def at(self) -> float:
        """Length of the route up to the trigger [m]."""
        return float(self.route.distance[self.index])

    def waypoint(self, index: int) -> Waypoint:
        """Lane centre of a point of the route."""
        return self.town.waypoint_at(int(self.route.lane[index]), float(self.route.u[index]))

    def ahead(self, distance: float) -> int | None:
        """The point of the route `distance` metres of it after the trigger; None beyond its end."""
        index = int(np.searchsorted(self.route.distance, self.at + distance - 1e-6))
        return index if index < len(self.route) else None

    def bends(self, begin: float, end: float) -> float:
        """How far the route's direction spreads from `begin` to `end` metres after the trigger [rad]."""
        first, last = np.searchsorted(self.route.distance, (self.at + begin, self.at + end))
        return float(np.ptp(np.unwrap(self.route.yaw[first : last + 1]))) if last > first else 0.0

    @cached_property
    def junction(self) -> tuple[int, int] | None:
        """First and last point of the route in the next junction (the trigger's own if it lies in one); None: none."""
        inside = self.town.lanes.junction[self.route.lane[self.index :]]
        found = np.flatnonzero(inside >= 0)
        if not len(found):
            return None
        first = int(found[0])
        left = np.flatnonzero(inside[first:] != inside[first])
        last = first + int(left[0]) - 1 if len(left) else len(inside) - 1
        return self.index + first, self.index + last

    @property
    def to_junction(self) -> float:
        """Metres of route from the trigger to the next junction; inf without one."""
        return math.inf if self.junction is None else float(self.route.distance[self.junction[0]]) - self.at

    @property
    def turn(self) -> RoadOption:
        """What the route does at the next junction; LANEFOLLOW without one."""
        on = (RoadOption.LANEFOLLOW, *_CHANGES)
        ahead = (RoadOption(int(value)) for value in self.route.command[self.index :])
        return next((option for option in ahead if option not in on), RoadOption.LANEFOLLOW)

    def changes_lane(self, distance: float) -> bool:
        """Whether the route changes lanes within `distance` metres after the trigger, or ends there."""
        end = self.ahead(distance)
        commands = self.route.command[self.index : end]
        return end is None or bool(np.isin(commands, _CHANGES).any())

    @property
    def entry_lane(self) -> int:
        """The route's lane inside the next junction; -1 without one."""
        return -1 if self.junction is None else int(self.route.lane[self.junction[0]])

    @property
    def light(self) -> int:
        """Traffic light of the route at the next junction; -1 for none."""
        return -1 if self.junction is None else int(self.town.lanes.light[self.entry_lane])

    @property
    def exit(self) -> Waypoint | None:
        """First lane centre behind the next junction; None where the route ends before."""
        if self.junction is None or self.junction[1] + 1 >= len(self.route):
            return None
        return self.waypoint(self.junction[1] + 1)

    def distance_along(self, xy: Floats) -> float:
        """Length of the route at its point nearest to `xy`, from the trigger on [m]; negative before it."""
        gaps = np.hypot(*(self.route.xy - np.asarray(xy)[:2]).T)
        return float(self.route.distance[int(np.argmin(gaps))]) - self.at

    def approaches(self, *sides: str) -> list[int]:
        """Junction lanes by which others enter the next junction from `sides`, as the ego sees it.

        Args:
            sides: "left", "right", "opposite": where they come from. Lanes of the first side come first.
        """
        if self.junction is None:
            return []
        entry, found = self.waypoint(self.junction[0]), {side: list[int]() for side in sides}
        heading = self._heading_before(entry.lane)
        for lane in self.town.junctions[entry.junction].lanes:
            if not self.town.lanes.type[lane] & LaneType.DRIVING:
                continue
            side = _side(float(wrap_angle(self._heading_before(lane) - heading)))
            if side in found:
                found[side].append(lane)
        return [lane for side in sides for lane in found[side]]

    def _heading_before(self, lane: int) -> float:
        return float(self.town.lanes.centre_line(lane)[0, 3])


def _side(turn: float) -> str:
    """Where a lane comes from whose heading differs by `turn` [rad] from the ego's."""
    if abs(turn) < _SIDE:
        return "behind"
    if abs(turn) > math.pi - _SIDE:
        return "opposite"
    return "left" if turn > 0.0 else "right"  # it heads to the ego's right: it comes from the left


def along_lane(start: Waypoint, distance: float, stop_at_junction: bool = True) -> tuple[Waypoint, float]:
    """The lane centre `distance` metres on by first branches, and how far that is.

    With `stop_at_junction` it ends where a junction begins, as placing does in the leaderboard of 1.0; it always ends
    at the end of the road.
    """
    lanes, lane, u, gone = start.town.lanes, start.lane, start.u, 0.0
    for _ in range(MOST_STEPS):
        left = float(lanes.length[lane]) - u
        if gone + left >= distance or (stop_at_junction and lanes.junction[lane] >= 0):
            break
        following = lanes.successors(lane)
        if not len(following):
            return Waypoint(start.town, lane, float(lanes.length[lane])), gone + left
        gone += left
        lane, u = int(following[0]), 0.0
    if stop_at_junction and lanes.junction[lane] >= 0:
        return Waypoint(start.town, lane, u), gone
    return Waypoint(start.town, lane, min(u + distance - gone, float(lanes.length[lane]))), distance


def to_junction(start: Waypoint, most: float = 500.0) -> float:
    """Metres along first branches to where a junction begins (0 inside one); inf if there is none within `most`."""
    place, gone = along_lane(start, most)
    return gone if place.is_junction else math.inf


def beside(waypoint: Waypoint, side: str) -> Waypoint | None:
    """The driving lane beside, of the same direction; None at the edge.

    Args:
        waypoint: Where.
        side: "left" or "right".
    """
    neighbours = waypoint.town.lanes.left if side == "left" else waypoint.town.lanes.right
    lane = int(neighbours[waypoint.lane])
    if lane < 0:
        return None
    return Waypoint(waypoint.town, lane, waypoint.town.lanes.u_of_s(lane, waypoint.s))


def outermost(waypoint: Waypoint, side: str) -> tuple[Waypoint, int]:
    """The last driving lane of the same direction on that side, and how many lanes away it is."""
    steps = 0
    while (other := beside(waypoint, side)) is not None:
        waypoint, steps = other, steps + 1
    return waypoint, steps


def oncoming(waypoint: Waypoint) -> Waypoint | None:
    """The nearest driving lane of the other direction on the same road; None on a one-way road."""
    lane, _ = outermost(waypoint, "left")
    other = lane.left()
    for _ in range(4):  # across a median, say
        if other is None or other.lane_type & LaneType.DRIVING:
            break
        other = other.left()
    if other is None or not other.lane_type & LaneType.DRIVING or math.cos(other.yaw - waypoint.yaw) > 0.0:
        return None
    return other


def kerb(waypoint: Waypoint, side: str) -> float:
    """Distance from the lane centre to where the sidewalk (or the land beside the road) begins [m]."""
    reach, lane = waypoint.width / 2.0, waypoint
    outward: Callable[[Waypoint], Waypoint | None] = Waypoint.right if side == "right" else Waypoint.left
    while (next_lane := outward(lane)) is not None and not next_lane.lane_type & (LaneType.SIDEWALK | LaneType.NONE):
        if math.cos(next_lane.yaw - lane.yaw) < -0.5:
            outward = Waypoint.left if outward is Waypoint.right else Waypoint.right  # sides swap across the centre
        reach += next_lane.width
        lane = next_lane
    return reach


def aside(waypoint: Waypoint, offset: float, ahead: float = 0.0) -> Floats:
    """x, y, z (3,) of the place `offset` metres to the right of a lane centre and `ahead` in its direction [m]."""
    xy = waypoint.xy + offset * right(waypoint.yaw) + ahead * forward(waypoint.yaw)
    return np.array([xy[0], xy[1], waypoint.z])


def at_height(xy: Floats, z: float) -> Floats:
    """x, y, z (3,)."""
    return np.array([xy[0], xy[1], z])


def line_ahead(start: Waypoint, length: float, choose: Callable[[Waypoint, list[int]], int] | None = None) -> Floats:
    """Lane centres (N, 2) from `start` on for `length` metres, or to the end of the road.

    Args:
        start: First point.
        length: [m].
        choose: Picks among the lanes that follow; the first if not given.
    """
    lanes, at, rows, left = start.town.lanes, start, list[tuple[int, float, float]](), length
    for _ in range(MOST_STEPS):
        end = min(at.u + left, float(lanes.length[at.lane]))
        rows.append((at.lane, at.u, end))
        left -= end - at.u
        following = [int(k) for k in lanes.successors(at.lane)]
        if left <= 1e-6 or not following:
            break
        at = Waypoint(start.town, choose(at, following) if choose and len(following) > 1 else following[0], 0.0)
    return _centres(start.town, rows)


def line_behind(end: Waypoint, length: float) -> Floats:
    """Lane centres (N, 2) that lead to `end`, from `length` metres before it or the beginning of the road."""
    lanes, rows, left, lane, u = end.town.lanes, list[tuple[int, float, float]](), length, end.lane, end.u
    for _ in range(MOST_STEPS):
        begin = max(u - left, 0.0)
        rows.insert(0, (lane, begin, u))
        left -= u - begin
        before = lanes.predecessors(lane)
        if left <= 1e-6 or not len(before):
            break
        lane = int(before[0])
        u = float(lanes.length[lane])
    return _centres(end.town, rows)


def join(*lines: Floats) -> Floats:
    """One line (N, 2) of several that follow each other, without doubled points."""
    points = np.concatenate([np.asarray(line, dtype=np.float64)[:, :2] for line in lines])
    kept = np.append(True, np.hypot(*np.diff(points, axis=0).T) > 0.05)
    return points[kept]


def _centres(town: TownMap, rows: list[tuple[int, float, float]]) -> Floats:
    parts = []
    for lane, begin, end in rows:
        u = np.linspace(begin, end, max(2, math.ceil((end - begin) / LINE_STEP) + 1))
        parts.append(town.centre(np.full(len(u), lane), u)[:, :2])
    return join(*parts)


def past_parking(waypoint: Waypoint) -> tuple[Waypoint, int]:
    """The last lane to the right before a sidewalk, a verge or a narrow strip, and how many lanes away it is.

    Parking and cycle lanes count; that is where 1.0 lets walkers and cyclists wait.
    """
    steps = 0
    while (other := waypoint.right()) is not None and other.width > _WIDE:
        if other.lane_type & (LaneType.SIDEWALK | LaneType.NONE | LaneType.BORDER | LaneType.MEDIAN):
            break
        if math.cos(other.yaw - waypoint.yaw) < 0.0:
            break
        waypoint, steps = other, steps + 1
    return waypoint, steps
