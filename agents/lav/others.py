"""Who is there, out of what is found tick after tick: one track an actor, whatever kind it is found as.

A walker beside a bin is found now as a walker, now as a vehicle: tracked by kind he would have no speed in either.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import DriveConfig
from agents.lav.frames import planner_from_world, world_from_planner
from agents.lav.localise import Pose
from agents.lav.models.detection import Detections
from agents.lav.tracking import Tracker

Floats = NDArray[np.float64]

_RESTING = 6  # numbers of a box that stands
_SAME = 1.0  # [m] between a walker and a vehicle that are one
_SMALL = 0.55  # [m] half length of who walks, whatever it is found as; bicycles have 0.75 and more


class Found(NamedTuple):
    """Who is there, in the planner frame.

    Attributes:
        vehicles: (N, 5) boxes of the nearest ahead: x, y, heading, half length, half width [m, rad].
        velocities: (N, 2) [m/s], not a number where they are not known.
        walkers: (M, 2) [m].
        walking: (M, 2) their velocities [m/s].
    """

    vehicles: Floats
    velocities: Floats
    walkers: Floats
    walking: Floats

    @property
    def speeds(self) -> Floats:
        """(N,) of the vehicles [m/s], not a number where they are not known."""
        return np.asarray(np.hypot(*self.velocities.T))


class _Seen(NamedTuple):
    """Detections of both kinds: boxes (K, 5), scores above their kind's threshold (K,), and who is a walker (K,)."""

    boxes: Floats
    margin: Floats
    walks: NDArray[np.bool_]


class Others:
    """Follows everybody."""

    def __init__(self, config: DriveConfig) -> None:
        self._config = config
        self._tracker = Tracker(_RESTING)

    def update(self, vehicles: Detections, walkers: Detections, pose: Pose, moved: float) -> Found:
        """Takes in a tick.

        Args:
            vehicles: Found, the doubtful ones among them.
            walkers: Found.
            pose: Of the ego in the frame that stands still.
            moved: Way of the ego since the last tick [m].
        """
        drive = self._config
        boxes, margin, walks = self._joined(vehicles, walkers)
        tracks = self._tracker.update(_resting(boxes, pose), moved)
        speeds = np.hypot(*tracks.velocities.T)
        is_small = walks | (boxes[:, 3] < _SMALL)
        rests = (speeds < drive.standing) & ~is_small  # who walks slowly is where he is found
        boxes[rests] = _unresting(tracks.rested[rests], pose)

        counts = (tracks.seen >= drive.least_seen) & (walks | (boxes[:, 1] < 0.0))
        is_sure = counts & (margin >= 0.0)
        moves = counts & ~is_sure & (speeds > drive.doubtful_speed)  # cyclists; fences stand
        cars = np.flatnonzero(is_sure & ~is_small)
        nearest = cars[np.argsort(np.hypot(*boxes[cars, :2].T), kind="stable")][: drive.forecasts]
        people = (is_sure & is_small) | moves
        velocities = planner_from_world(tracks.velocities, np.zeros(2), pose.yaw)
        walking = np.nan_to_num(velocities[people])
        return Found(boxes[nearest], velocities[nearest], boxes[people, :2], walking)

    def _joined(self, vehicles: Detections, walkers: Detections) -> _Seen:
        """Both kinds; of a walker and a vehicle in one place the one that is surer for its kind."""
        parts = ((vehicles, self._config.detection_score), (walkers, self._config.walker_score))
        boxes = np.concatenate([part.boxes.numpy() for part, _ in parts]).astype(np.float64)
        margin = np.concatenate([part.scores.numpy().astype(np.float64) - least for part, least in parts])
        walks = np.arange(len(boxes)) >= len(vehicles.scores)
        apart = np.hypot(*(boxes[:, None, :2] - boxes[None, :, :2]).transpose(2, 0, 1))
        is_other = (walks[:, None] != walks[None]) & (apart < _SAME)
        is_surer = (margin[None] > margin[:, None]) | ((margin[None] == margin[:, None]) & walks[None])
        kept = ~(is_other & is_surer).any(axis=1)
        return _Seen(boxes[kept], margin[kept], walks[kept])


def _resting(boxes: Floats, pose: Pose) -> Floats:
    """(N, 6) of boxes (N, 5) what can be averaged in the frame that stands still: a box found the other way round is
    the same box."""
    axis = 2.0 * (boxes[:, 2] + pose.yaw)
    return np.column_stack([world_from_planner(boxes[:, :2], *pose), np.cos(axis), np.sin(axis), boxes[:, 3:]])


def _unresting(means: Floats, pose: Pose) -> Floats:
    """The inverse of `_resting`."""
    heading = np.arctan2(means[:, 3], means[:, 2]) / 2.0 - pose.yaw
    return np.column_stack([planner_from_world(means[:, :2], *pose), heading, means[:, 4:]])
