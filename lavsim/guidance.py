"""What an agent with GNSS, compass and plan knows about its way: the command that holds and the goal ahead."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import EARTH_RADIUS
from lavsim.types import RoadOption

TURN_REACH = 4.5  # [m] a node is reached from that far when its command ends a "follow"
REACH = 3.0  # [m] otherwise
PASSED_REACH = 10.0  # [m] or it lies behind, no farther away than this
GOAL_REACHED = 20.0  # [m] the goal moves on when it is that near …
GOAL_FARTHEST = 75.0  # [m] … and the next is not farther than this


@dataclass(frozen=True)
class Guidance:
    """Attributes:
    command: Of the plan node reached last.
    goal, next_goal: (2,) in the ego's frame (x ahead, y right) [m].
    node: Number of the goal in the plan.
    """

    command: RoadOption
    goal: NDArray[np.float32]
    next_goal: NDArray[np.float32]
    node: int


class Guide:
    """Follows a thinned plan by GNSS, tick by tick.

    The first command is "follow". The node after the current one becomes current when it is nearer than 4.5 m if the
    command is "follow" and the node's another, 3 m otherwise. Unlike LAV's, a node within 10 m that lies behind counts
    as reached too: noise of half a metre can carry an ego past the 3 m, and all commands behind it would be lost.

    The goal begins at the first node and moves on by one a tick, when it is nearer than 20 m and the next one nearer
    than 75 m. Unlike LAV's it moves on, too, when it is that near and lies behind: nodes of 2.x's plans are up to 200 m
    apart, and a goal that is never nearer than 75 m would leave the ego with one behind it.

    Source: LAV's `Waypointer` and `RoutePlanner` (reference `lav.md` 6.1).

    Args:
        gps: (K, 2) latitude and longitude [deg] of the plan's nodes.
        commands: (K,) `RoadOption` of each.
    """

    def __init__(self, gps: NDArray[np.float64], commands: Sequence[int]) -> None:
        gps = np.asarray(gps, np.float64)
        self._scale = math.cos(math.radians(float(gps[:, 0].mean())))
        self._nodes = self._metres(gps)
        self._ahead = self._directions()
        self._commands = [RoadOption(int(value)) for value in commands]
        self._current, self._goal = 0, 0
        self._command = RoadOption.LANEFOLLOW

    def update(self, gnss: NDArray[np.float64]) -> None:
        """Takes in the fix of a tick: latitude, longitude [deg], and what may follow."""
        self._place = self._metres(np.asarray(gnss, np.float64)[:2])
        offset = self._nodes - self._place
        distance = np.hypot(offset[:, 0], offset[:, 1])
        last = len(self._nodes) - 1
        following = min(self._current + 1, last)
        if following > self._current and self._is_reached(following, offset[following], float(distance[following])):
            self._current, self._command = following, self._commands[following]
        goal = self._goal
        if goal < last and distance[goal] < GOAL_REACHED:
            is_passed = float(offset[goal] @ self._ahead[goal]) < 0.0
            if is_passed or distance[goal + 1] < GOAL_FARTHEST:
                self._goal = goal + 1

    def now(self, compass: float) -> Guidance:
        """What holds at the tick of the last update; `compass` [rad], 0 north, clockwise."""
        north, east = math.cos(compass), math.sin(compass)
        turn = np.array([[north, -east], [east, north]])  # columns: ahead, right, of (north, east)
        following = min(self._goal + 1, len(self._nodes) - 1)
        goal, next_goal = ((self._nodes[[self._goal, following]] - self._place) @ turn).astype(np.float32)
        command = RoadOption.STRAIGHT if self._command == RoadOption.VOID else self._command
        return Guidance(command, goal, next_goal, self._goal)

    def _is_reached(self, node: int, offset: NDArray[np.float64], distance: float) -> bool:
        ends_follow = self._command == RoadOption.LANEFOLLOW and self._commands[node] != RoadOption.LANEFOLLOW
        if distance < (TURN_REACH if ends_follow else REACH):
            return True
        return distance < PASSED_REACH and float(offset @ self._ahead[node]) < 0.0

    def _metres(self, gps: NDArray[np.float64]) -> NDArray[np.float64]:
        """(…, 2) north, east [m] of latitudes and longitudes [deg]."""
        scale = EARTH_RADIUS * math.pi / 180.0
        return gps * (scale, scale * self._scale)

    def _directions(self) -> NDArray[np.float64]:
        """(K, 2) from each node to the next, of the last one from that before."""
        if len(self._nodes) < 2:
            return np.zeros_like(self._nodes)
        steps = np.diff(self._nodes, axis=0)
        return np.concatenate([steps, steps[-1:]])
