"""Crossing a stop line at red, judged by the ego's middle: `--rules corrected`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lavsim.geometry import right, segments_cross
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.types import LightState
from lavsim.world.snapshot import Snapshot
from leaderboard.criteria.base import CRITERIA, Criterion, Infraction, place, place_text
from leaderboard.criteria.red_light import RedLight


@CRITERIA.register("corrected_red_light")
class CorrectedRedLight(Criterion):
    """Fires in the tick in which the ego's centre passes a stop line of its direction at red, every time it does.

    The originals judge a stretch behind the ego's rear, so who passes on yellow and is still over the line at red is
    charged, and who runs the same light again is not. The line is as wide as its lane.
    """

    name = "corrected_red_light"
    order = 40
    applies = ("corrected",)
    instead_of = "red_light"
    charges = RedLight.charges

    level = 3.0  # [m] a line farther above or below belongs to another road
    farthest = 5.0  # [m] between two ticks: farther is no driving (a drive's first tick, a log that was cut)

    def start(self, town: TownMap, route: Route) -> None:
        self._lights = town.lights
        self._before: np.ndarray | None = None
        lines = [(k, stop) for k, light in enumerate(town.lights) for stop in light.stop_lines]
        self._light = np.array([k for k, _ in lines], np.int64)
        self._middle = np.array([(stop.x, stop.y) for _, stop in lines], np.float64).reshape(-1, 2)
        self._yaw = np.array([stop.yaw for _, stop in lines], np.float64)
        self._half = np.array([stop.width / 2.0 for _, stop in lines], np.float64)
        places = np.array([stop.lane for _, stop in lines], np.int64), np.array([stop.u for _, stop in lines])
        self._z = town.centre(*places)[:, 2] if lines else np.zeros(0)

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        now = snapshot.ego.xy
        before, self._before = self._before, now
        if before is None or not len(self._light) or not 0.0 < math.dist(before, now) < self.farthest:
            return ()
        near = np.abs(self._middle - now).max(axis=1) < self.farthest + self._half
        near &= np.asarray(snapshot.lights)[self._light] == LightState.RED
        near &= np.abs(self._z - snapshot.ego.z) < self.level
        course = now - before
        run = {int(self._light[k]) for k in np.flatnonzero(near) if self._passes(int(k), before, now, course)}
        found = []
        for light in sorted(run):
            signal = self._lights[light]
            where = place_text((signal.x, signal.y, signal.z))
            text = f"Agent ran a red light {signal.signal_id} at {where}"
            found.append(Infraction("red_light", snapshot.tick, place(snapshot), text))
        return found

    def _passes(self, line: int, before: np.ndarray, now: np.ndarray, course: np.ndarray) -> bool:
        yaw = float(self._yaw[line])
        if course @ (math.cos(yaw), math.sin(yaw)) <= 0.0:
            return False
        aside = right(yaw) * self._half[line]
        # The point that touched the line is not passed again by the next tick, which starts from it.
        ahead = (now - self._middle[line]) @ (math.cos(yaw), math.sin(yaw)) > 0.0
        return bool(ahead and segments_cross(before, now, self._middle[line] - aside, self._middle[line] + aside))
