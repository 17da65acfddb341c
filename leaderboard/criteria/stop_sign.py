"""Running a stop sign."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lavsim.map.route import Route
from lavsim.map.signal import Sign
from lavsim.map.town_map import TownMap
from lavsim.world.snapshot import EgoState, Snapshot
from leaderboard.criteria.base import CRITERIA, Charge, Criterion, Infraction, place, place_text
from leaderboard.progress import Clear

_LEVEL = 3.0  # [m] signs farther above or below belong to another road


@CRITERIA.register("stop_sign")
class StopSign(Criterion):
    """Fires when the ego leaves the reach of a stop sign at which it did not come to rest.

    1.0 looks 20 m ahead along the lane for the sign's trigger box, and charges only where the ego's centre was also
    within a box of the same size around the POST: signs whose post stands off the lane are never charged. 2.x looks
    4 m ahead, scales the box by 1.2 and asks nothing about the post. Boxes stay parallel to the world's axes in both.

    Source: reference `leaderboard.md` 2.3.
    """

    name = "stop_sign"
    order = 50
    charges = (Charge("stop_infraction", "Stop sign infractions", 8, {"1.0": 0.80, "2.0": 0.80, "2.1": 0.25}),)

    rest = 0.1  # [m/s] slower is stopped
    reach = {"1.0": 50.0, "2.x": 4.0}  # noqa: RUF012 - [m] to the post (1.0), to the trigger box (2.x)
    steps = {"1.0": (1.0, 20), "2.x": (0.5, 8)}  # noqa: RUF012 - lane points ahead: spacing [m] and number
    scale = {"1.0": 1.0, "2.x": 1.2}  # noqa: RUF012 - of the trigger box
    facing = {"1.0": 0.0, "2.x": -0.17}  # noqa: RUF012 - cosine of ego and lane below which signs are ignored

    def start(self, town: TownMap, route: Route) -> None:
        self._town = town
        self._signs = [sign for sign in town.signs if sign.kind == "stop"]
        self._posts = np.array([(s.x, s.y) for s in self._signs], np.float64).reshape(-1, 2)
        self._boxes = np.array([s.trigger for s in self._signs], np.float64).reshape(-1, 5)
        self._is_first = self.rules.generation == "1.0"
        self._reach, self._scale = self.rules.require(self.reach), self.rules.require(self.scale)
        self._steps, self._facing = self.rules.require(self.steps), self.rules.require(self.facing)
        self._centres = self._posts if self._is_first else self._boxes[:, :2]
        # Lane points lie near the ego: how near a box is to them is tested later.
        self._margin = self._reach if self._is_first else self._reach + 5.0
        self._clear = Clear(self._centres[:, 0], self._centres[:, 1], self._margin)
        self._target: int | None = None
        self._stopped = self._entered = False
        self._last_failed: int | None = None

    def update(self, snapshot: Snapshot) -> Sequence[Infraction]:
        ego = snapshot.ego
        if self._target is None:
            self._target = self._find(ego)
            return ()
        self._stopped = self._stopped or ego.speed < self.rest
        self._entered = self._entered or self._is_entered(self._target, ego)
        if self._affects(self._target, ego, self._points(ego)):
            return ()
        target, self._target = self._target, None
        failed = not self._stopped and self._entered and (self._is_first or target != self._last_failed)
        self._stopped = self._entered = False
        if not failed:
            return ()
        self._last_failed = target
        sign = self._signs[target]
        text = f"Agent ran a stop {sign.signal_id} at {place_text((sign.x, sign.y, sign.z))}"
        return (Infraction("stop_infraction", snapshot.tick, place(snapshot), text),)

    def _find(self, ego: EgoState) -> int | None:
        """The first sign in the list that the ego comes to."""
        if self._clear.holds(ego.x, ego.y):
            return None
        near = np.flatnonzero(np.hypot(self._centres[:, 0] - ego.x, self._centres[:, 1] - ego.y) < self._margin)
        if not len(near) or (not self._is_first and ego.forward_speed < self._facing):
            return None
        under = self._town.nearest(np.array([[ego.x, ego.y, ego.z]]))
        if math.cos(ego.yaw - float(under.yaw[0])) < self._facing:
            return None
        points = self._points(ego)
        return next((int(index) for index in near if self._affects(int(index), ego, points)), None)

    def _affects(self, index: int, ego: EgoState, points: NDArray[np.float64]) -> bool:
        """Whether a point of the lane ahead lies in the sign's trigger box."""
        sign = self._signs[index]
        if not self._is_near(sign, index, ego, points):
            return False
        return bool(np.any(self._inside(index, points) & (np.abs(points[:, 2] - sign.z) < _LEVEL)))

    def _inside(self, index: int, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """`(P,)` which points lie in the sign's trigger box; it isn't turned with its road."""
        x, y, _yaw, half_length, half_width = self._boxes[index]
        return (np.abs(points[:, 0] - x) < self._scale * half_length) & (
            np.abs(points[:, 1] - y) < self._scale * half_width
        )

    def _is_near(self, sign: Sign, index: int, ego: EgoState, points: NDArray[np.float64]) -> bool:
        if self._is_first:
            return math.hypot(sign.x - ego.x, sign.y - ego.y) < self._reach
        return math.hypot(*(self._boxes[index, :2] - points[0, :2])) < self._reach

    def _is_entered(self, index: int, ego: EgoState) -> bool:
        """Whether the ego came to the sign: 1.0 asks for the place around the post, 2.x for nothing."""
        if not self._is_first:
            return True
        sign, (_x, _y, _yaw, half_length, half_width) = self._signs[index], self._boxes[index]
        return abs(ego.x - sign.x) < half_length and abs(ego.y - sign.y) < half_width

    def _points(self, ego: EgoState) -> NDArray[np.float64]:
        """`(P, 3)` the points looked at [m]: the ego's place (1.0) or the lane below it (2.x), then the lane ahead."""
        under = self._town.nearest(np.array([[ego.x, ego.y, ego.z]]))
        table, step, count = self._town.lanes, *self._steps
        lane, u = int(under.lane[0]), float(under.u[0])
        lanes, places = [lane], [u]
        for _ in range(count):
            u += step
            while u > table.length[lane]:
                following = table.successors(lane)
                if not len(following):
                    break
                u -= float(table.length[lane])
                lane = int(following[0])
            lanes.append(lane)
            places.append(u)
        points = self._town.centre(np.array(lanes), np.array(places))[:, :3].copy()
        if self._is_first:
            points[0] = ego.x, ego.y, ego.z
        return points
