"""Who is there, out of what is found look after look: one track an actor, whatever kind it is found as.

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
from agents.lav.stepping import SLIGHT, SMALL, steps_out, towards_the_way
from agents.lav.tracking import Tracker
from lavsim.types import DT

Floats = NDArray[np.float64]

_RESTING, _MARGIN, _AS_WALKER = 6, 6, 7  # numbers of a box that stands; what is tracked beside it
_COAST = 0.2  # [s] that who was found is taken to be there still
_SAME = 1.0  # [m] between a walker and a vehicle that are one
_WIDE = 1.3  # [m] half length of who can't be a walker, though he was found as one


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


class _Followed(NamedTuple):
    """Everybody who is there: boxes now and at rest (N, 5), margin and kind as above, velocities in the frame that
    stands still (N, 2) [m/s], looks in which each was found (N,), and of them those since he was a walker (N,): who was
    once found as a walker is one."""

    boxes: Floats
    rested: Floats
    margin: Floats
    walks: NDArray[np.bool_]
    velocities: Floats
    seen: NDArray[np.int64]
    walked: NDArray[np.int64]


class Others:
    """Follows everybody who is found, and says who counts.

    Args:
        config: How sure detections must be, and how often they come.
    """

    def __init__(self, config: DriveConfig) -> None:
        self._config, self._period = config, config.look_every * DT
        self._tracker = Tracker(self._period, _AS_WALKER + 1, highest=1)

    def update(self, vehicles: Detections, walkers: Detections, pose: Pose, moved: float) -> Found:
        """Takes in a look.

        Args:
            vehicles: Found, the doubtful ones among them.
            walkers: Found.
            pose: Of the ego in the frame that stands still.
            moved: Way of the ego since the last look [m].
        """
        drive = self._config
        boxes, rested, margin, walks, velocities, seen, walked = self._followed(vehicles, walkers, pose, moved)
        speeds, is_small = np.hypot(*velocities.T), walks | (boxes[:, 3] < SMALL)
        rests = (speeds < drive.standing) & ~is_small  # who walks slowly is where he is found
        boxes[rests] = rested[rests]

        counts = (seen >= drive.least_seen) & (walks | (boxes[:, 1] < 0.0))
        is_sure = counts & (margin >= 0.0)
        moves = counts & ~is_sure & (speeds > drive.doubtful_speed)  # cyclists; fences stand
        runs = steps_out(boxes, margin, walks, np.where(walks, walked, seen), velocities, moved / self._period)
        cars = np.flatnonzero(is_sure & ~is_small)
        nearest = cars[np.argsort(np.hypot(*boxes[cars, :2].T), kind="stable")][: drive.forecasts]
        people = (is_sure & is_small) | moves | runs

        velocities = planner_from_world(velocities, np.zeros(2), pose.yaw)
        velocities[runs] = towards_the_way(boxes[runs])
        return Found(boxes[nearest], velocities[nearest], boxes[people, :2], np.nan_to_num(velocities[people]))

    def _followed(self, vehicles: Detections, walkers: Detections, pose: Pose, moved: float) -> _Followed:
        """Everybody who is found, and who is missed for a moment."""
        boxes, margin, walks = self._joined(vehicles, walkers)
        as_walker = np.where(walks, margin, -1.0)
        looks = np.column_stack([_resting(boxes, pose), margin, as_walker])
        tracks = self._tracker.update(looks, moved, walks | (boxes[:, 3] < SLIGHT))
        missed = self._tracker.coasting(_COAST)
        lost, rested = missed.rested, np.concatenate([tracks.rested, missed.rested])
        boxes = np.concatenate([boxes, _unresting(lost, pose)])
        best, margin = rested[:, _AS_WALKER], np.concatenate([margin, lost[:, _MARGIN]])
        walked = (best >= 0.0) & (boxes[:, 3] < _WIDE)
        walked[: len(walks)] |= walks
        return _Followed(
            boxes,
            _unresting(rested, pose),
            np.where(walked, np.maximum(margin, best), margin),
            walked,
            np.concatenate([tracks.velocities, missed.velocities]),
            np.concatenate([tracks.seen, missed.seen]),
            np.concatenate([tracks.since, missed.since]),
        )

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
    """The inverse of `_resting`, of means (N, 6 or more)."""
    heading = np.arctan2(means[:, 3], means[:, 2]) / 2.0 - pose.yaw
    return np.column_stack([planner_from_world(means[:, :2], *pose), heading, means[:, 4:_RESTING]])
