"""A route as dense points with commands, and a vehicle's progress along it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.geometry import geolocation
from lavsim.types import RoadOption

Floats = NDArray[np.float64]


def polyline_length(points: Floats) -> Floats:
    """Length along a 3D polyline (N, 3) up to each of its points (N,) [m]."""
    steps = np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True, eq=False)
class Route:
    """What an agent is asked to drive: R points about 1 m apart.

    Where two roads or two key points join, neighbouring points may coincide; a lane change is a jump of about five
    points to the neighbouring lane (the leaderboard's interpolated trajectory has both).

    Attributes:
        points: (R, 3) lane centres [m].
        yaw: (R,) direction of the lane [rad].
        command: (R,) int8, `RoadOption`.
        lane: (R,) int32, index into the town's lanes.
        u: (R,) place on that lane [m].
        distance: (R,) length along the points [m].
        keypoints: (K, 3) what the route was traced from [m].
    """

    points: Floats
    yaw: Floats
    command: NDArray[np.int8]
    lane: NDArray[np.int32]
    u: Floats
    distance: Floats
    keypoints: Floats

    def __post_init__(self) -> None:
        for array in (self.points, self.yaw, self.command, self.lane, self.u, self.distance, self.keypoints):
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.points)

    @property
    def length(self) -> float:
        """Length along the dense points [m]."""
        return float(self.distance[-1])

    @cached_property
    def keypoint_length(self) -> float:
        """Length of the polyline through the key points [m]."""
        return float(polyline_length(self.keypoints)[-1])

    @property
    def xy(self) -> Floats:
        """(R, 2) lane centres [m]."""
        return self.points[:, :2]

    def thinned(self, spacing: float, keep_first: bool = True) -> NDArray[np.int64]:
        """Indices of the points that an agent gets: changes of command, lane changes, one after every `spacing` m.

        The length counts only over points that are not kept, so a 1 m route with a spacing of 50 m keeps every 52nd
        point. The first point differs from "no command" and so is kept either way; `keep_first` says so for 2.x.

        Source: the leaderboard's `downsample_route`; 50 m in 1.0, 200 m in 2.x.
        """
        kept: list[int] = []
        previous: RoadOption | None = None
        since = 0.0
        steps = np.diff(self.distance, prepend=0.0)
        for i, value in enumerate(self.command.tolist()):
            option = RoadOption(value)
            first = keep_first and i == 0
            new = option != previous and not (previous is not None and previous.is_lane_change)
            if first or option.is_lane_change or new or since > spacing or i == len(self.command) - 1:
                kept.append(i)
                since = 0.0
            else:
                since += float(steps[i])
            previous = option
        return np.array(kept, dtype=np.int64)

    def gps(self, geo_reference: tuple[float, float]) -> Floats:
        """Latitude, longitude [deg] and height [m] of the points (R, 3), free of noise.

        Args:
            geo_reference: `TownMap.geo_reference`.
        """
        lat, lon = geolocation(self.points[:, 0], self.points[:, 1], *geo_reference)
        return np.stack([lat, lon, self.points[:, 2]], axis=1)

    def commands(self) -> list[tuple[RoadOption, int]]:
        """Runs of equal commands: (command, number of points)."""
        runs: list[tuple[RoadOption, int]] = []
        for value in self.command.tolist():
            option = RoadOption(value)
            if runs and runs[-1][0] == option:
                runs[-1] = (option, runs[-1][1] + 1)
            else:
                runs.append((option, 1))
        return runs


class RouteTracker:
    """Follows a vehicle along a route: the nearest point within a window that only moves forward.

    Args:
        route: What is driven.
        window: Points ahead of the current one that are looked at.
    """

    def __init__(self, route: Route, window: int = 5) -> None:
        self.route = route
        self.window = window
        self.index = 0
        self._xy = np.ascontiguousarray(route.points[:, :2])

    def update(self, xy: ArrayLike) -> int:
        """Index of the route point nearest to `xy` (2,); of equally near ones the later."""
        ahead = self._xy[self.index : self.index + self.window + 1]
        squared = np.sum((ahead - np.asarray(xy, dtype=np.float64)[:2]) ** 2, axis=1)
        self.index += len(squared) - 1 - int(np.argmin(squared[::-1]))
        return self.index

    def metres(self) -> float:
        """Length of the route behind the current point [m]."""
        return float(self.route.distance[self.index])

    @property
    def percentage(self) -> float:
        """Share of the route's length behind the current point [0 to 100]."""
        if self.route.length <= 0.0:
            return 100.0
        return float(100.0 * self.route.distance[self.index] / self.route.length)
