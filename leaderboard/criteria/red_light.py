"""Crossing a stop line while its light is red."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lavsim.geometry import forward, right, segments_cross
from lavsim.map.route import Route
from lavsim.map.stop_lines import StopLine
from lavsim.map.town_map import TownMap
from lavsim.types import LightState
from lavsim.world.snapshot import EgoState, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place, place_text
from leaderboard.progress import SLACK, Clear

_RED = int(LightState.RED)  # an enum's attributes are slow to get


@CRITERIA.register("red_light")
class RedLight(Criterion):
    """Fires when a short segment behind the ego's REAR meets the stop line of its lane at red.

    Crossing on yellow with the rear still over the line when it turns red is an infraction; stopping with the nose
    over the line is not. One light is charged at most once until another one is.
    """

    name = "red_light"
    order = 40
    charges = (Charge("red_light", "Red lights infractions", 7, {"1.0": 0.70, "2.0": 0.70, "2.1": 0.40}),)

    reach = 15.0  # [m] ego centre to the centre of the light's trigger box, at most
    tail = (0.8, 1.0)  # from 0.8 half lengths to one half length + 1 m behind the ego's centre
    line = {"1.0": 0.4, "2.x": 0.6}  # noqa: RUF012 - half width of the stop line, in lane widths

    def start(self, town: TownMap, route: Route) -> None:
        self._town = town
        self._lights = town.lights
        self._x = np.array([light.trigger[0] for light in town.lights], np.float64)
        self._y = np.array([light.trigger[1] for light in town.lights], np.float64)
        self._half = self.rules.require(self.line)
        self._last: int | None = None
        self._clear = Clear(self._x, self._y, self.reach)

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        ego = snapshot.ego
        if self._clear.holds(ego.x, ego.y):
            return ()
        aside, along = self._x - ego.x, self._y - ego.y
        near = aside * aside + along * along <= self.reach**2
        if not near.any():
            return ()
        found = []
        for index in np.flatnonzero(near & (snapshot.lights == _RED)):
            if index != self._last and self._crosses(snapshot, int(index)):
                self._last = int(index)
                light = self._lights[index]
                where = place_text((light.x, light.y, light.z))
                text = f"Agent ran a red light {light.signal_id} at {where}"
                found.append(Infraction("red_light", snapshot.tick, place(snapshot), text))
        return found

    def _crosses(self, snapshot: Snapshot, index: int) -> bool:
        ego = snapshot.ego
        lines = [s for s in self._lights[index].stop_lines if self._is_behind(ego, s)]
        if not lines:
            return False
        back, half = -forward(ego.yaw), ego.length / 2.0
        tail_near = ego.xy + back * self.tail[0] * half
        tail_far = ego.xy + back * (half + self.tail[1])
        under = self._town.nearest(np.array([[tail_far[0], tail_far[1], ego.z]]))
        lane = int(under.lane[0])
        road_lane = (int(self._town.lanes.road_id[lane]), int(self._town.lanes.lane_id[lane]))
        for stop in lines:
            if road_lane == (stop.road_id, stop.lane_id):
                middle, aside = np.array([stop.x, stop.y]), right(stop.yaw) * self._half * stop.width
                if segments_cross(tail_near, tail_far, middle - aside, middle + aside):
                    return True
        return False

    def _is_behind(self, ego: EgoState, line: StopLine) -> bool:
        """Whether the line is of the ego's direction and may lie behind its centre, where the tail is.

        In plain numbers, since most ticks near a red light end here.
        """
        if math.cos(ego.yaw - line.yaw) <= 0.0:
            return False
        along = (line.x - ego.x) * math.cos(line.yaw) + (line.y - ego.y) * math.sin(line.yaw)
        return -(ego.length / 2.0 + self.tail[1] + SLACK) < along < SLACK
