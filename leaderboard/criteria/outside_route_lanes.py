"""Metres of route driven off the road or in a lane of the wrong direction."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import LaneType
from lavsim.world.snapshot import HAZARD_WRONG_LANE_OFF, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place
from leaderboard.progress import PlaneProgress


@CRITERIA.register("outside_route_lanes")
class OutsideRouteLanes(Criterion):
    """One infraction a route: the share of the completed distance that was driven outside, taken off the penalty.

    *Outside* is the ego's centre farther from the nearest driving or parking lane than half its width and a margin.
    *Wrong lane* is a flag with memory, reset in junctions, judged when the lane under the ego changes. 1.0 loses it at
    the next piece of road, and finds it again on the way back to the right lane; 2.x keeps it. Standing outside adds
    nothing: metres are those of the route passed meanwhile.
    """

    name = "outside_route_lanes"
    order = 20
    charges = (Charge("outside_route_lanes", "Off-road infractions", 9, by="share"),)

    margin = {"1.0": 1.3, "2.x": 0.5}  # noqa: RUF012 - [m] beyond half the lane's width
    window = 3  # points ahead
    exit_angle = 120.0  # [deg] between ego and lane when it leaves a junction
    jump_angle = 150.0  # [deg] between lanes; 1.0 includes it, 2.x does not

    def start(self, town: TownMap, route: Route) -> None:
        self._town, self._route = town, route
        self._progress = PlaneProgress(route, self.window)
        self._allowed = self.rules.require(self.margin)
        self._first_generation = self.rules.generation == "1.0"
        self._has_parking = bool(np.any(town.lanes.type & LaneType.PARKING))
        self._wrong_lane = False
        self._before: tuple[int, int, bool, float] | None = None  # road, lane id, in junction, lane yaw [deg]
        self._total = self._wrong = 0.0
        self._still: tuple[float, float, float, float] | None = None  # where nothing changes as long as the ego stands
        self._first: tuple[int, tuple[float, float, float]] | None = None  # tick and place of the first wrong metre

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        ego = snapshot.ego
        pose = ego.x, ego.y, ego.z, ego.yaw
        if pose == self._still:
            return ()
        point = np.array([[ego.x, ego.y, ego.z]])
        under = self._town.nearest(point)
        self._follow_lane(int(under.lane[0]), math.degrees(float(under.yaw[0])), math.degrees(ego.yaw))
        current = self._progress.index
        passed = self._progress.advance(ego.x, ego.y)
        self._still = None if passed else pose
        if not passed:
            return ()
        # "Outside" has no memory, so it is only asked for in ticks that pass a point.
        bad = self._is_outside(point, float(under.distance[0]), float(under.width[0])) or (
            self._wrong_lane and not self._wrong_lane_test_is_off(snapshot)
        )
        for index in passed:
            step = float(np.linalg.norm(self._route.points[index] - self._route.points[current]))
            current = index
            self._total += step
            if bad:
                self._wrong += step
                self._first = self._first or (snapshot.tick, place(snapshot))
        return ()

    def finish(self) -> Sequence[Infraction]:
        if self._first is None or self._wrong <= 0.0:
            return ()
        percent = 100.0 * self._wrong / self._total
        text = (
            f"Agent went outside its route lanes for about {round(self._wrong, 3)} meters "
            f"({round(percent, 2)}% of the completed route)"
        )
        tick, where = self._first
        return (Infraction("outside_route_lanes", tick, where, text, value=percent, metres=self._wrong),)

    def _is_outside(self, point: np.ndarray, distance: float, width: float) -> bool:
        if self._has_parking and distance > width / 2.0:  # inside a driving lane nothing is outside
            parking = self._town.nearest(point, LaneType.PARKING)
            if float(parking.distance[0]) <= distance:
                distance, width = float(parking.distance[0]), float(parking.width[0])
        return distance > width / 2.0 + self._allowed

    def _follow_lane(self, lane: int, lane_yaw: float, ego_yaw: float) -> None:
        """Sets the flag by the lane under the ego and the one before; yaws [deg]."""
        lanes = self._town.lanes
        road, lane_id, in_junction = int(lanes.road_id[lane]), int(lanes.lane_id[lane]), bool(lanes.junction[lane] >= 0)
        before = self._before or (road, lane_id, in_junction, lane_yaw)
        if in_junction:
            self._wrong_lane = False
        elif before[:2] != (road, lane_id):
            if before[2]:
                angle = (lane_yaw - ego_yaw) % 360.0
                self._wrong_lane = not (angle < self.exit_angle or angle > 360.0 - self.exit_angle)
            else:
                angle = (before[3] - lane_yaw) % 360.0
                if self._is_jump(angle):
                    self._wrong_lane = not self._wrong_lane
                elif self._first_generation:
                    self._wrong_lane = False
        self._before = (road, lane_id, in_junction, lane_yaw)

    def _is_jump(self, angle: float) -> bool:
        if self._first_generation:
            return self.jump_angle <= angle <= 360.0 - self.jump_angle
        return self.jump_angle < angle < 360.0 - self.jump_angle

    def _wrong_lane_test_is_off(self, snapshot: Snapshot) -> bool:
        if self._first_generation or not len(snapshot.hazards):
            return False
        return bool(np.any(snapshot.hazards["flags"] & HAZARD_WRONG_LANE_OFF))
