"""Velocities of detected actors, and where those that stand are: from tick after tick, in a frame that stands still."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Floats = NDArray[np.float64]

_GATE = 2.5  # [m] from where an actor was expected
# Standard deviations of a detection's place [m], and of accelerations [m/s²]: of cars, and of who is small and nimble.
_PLACE_STD = np.array([0.25, 0.15])
_ACCELERATION = np.array([2.5, 4.0])
_BEGIN_SPEED = 8.0  # [m/s] what a new one may drive
_KNOWN = 1.0  # [m/s] standard deviation below which a velocity is told
_STANDS = 1.0  # [m/s]
_LOST = 0.5  # [s] without a detection
_APART = 0.5  # [m] that the ego has to move before it sees anew: detections err by cells, the same from the same place
_MOST = 10.0  # such looks that are averaged


class Tracked(NamedTuple):
    """Of the actors found at a tick, in their order.

    Attributes:
        velocities: (N, 2) [m/s], not a number where they are not known yet.
        rested: (N, D) means of what was found, for those who stand; the largest of columns that are not averaged.
        seen: (N,) looks in which each was found.
        since: (N,) of them those since the last column was 0 or more for the first time.
    """

    velocities: Floats
    rested: Floats
    seen: NDArray[np.int64]
    since: NDArray[np.int64]


class Tracker:
    """One Kalman filter an actor, constant velocity, the nearest detection each.

    Args:
        period: From look to look [s].
        columns: Of what is found of an actor, its place first.
        highest: So many of the last are not averaged: their largest value since the actor was first found is told.
    """

    def __init__(self, period: float, columns: int = 2, highest: int = 0) -> None:
        self._period = period
        self._averaged = columns - highest
        self._state = np.zeros((0, 2, 2))  # by track: place and velocity, by axis
        self._spread = np.zeros((0, 2, 2))  # the same for both axes
        self._nimble = np.zeros(0, np.int64)
        self._missed = np.zeros(0, np.int64)
        self._seen, self._since = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self._mean, self._looks = np.zeros((0, columns)), np.zeros(0)

    def update(self, found: Floats, moved: float = 0.0, nimble: NDArray[np.bool_] | None = None) -> Tracked:
        """Takes in a look.

        Args:
            found: (N, D) of each actor: its place [m], and whatever is to be averaged of those who stand.
            moved: Way of the ego since the last look [m].
            nimble: (N,) who is small: found more precisely, and starts and stops at once.
        """
        places, count = found[:, :2], len(found)
        kinds = np.zeros(count, np.int64) if nimble is None else nimble.astype(np.int64)
        self._predict()
        tracks, rows = self._pairs(places)
        self._nimble[tracks] = kinds[rows]
        self._correct(tracks, places[rows])
        self._average(tracks, found[rows], moved)
        self._seen[tracks] += 1
        self._since[tracks] += self._mean[tracks, -1] >= 0.0
        told = Tracked(np.full((count, 2), np.nan), found.copy(), np.ones(count, np.int64), _as_count(found))
        sure = self._spread[tracks, 1, 1] < _KNOWN**2
        told.velocities[rows[sure]] = self._state[tracks[sure], 1]
        told.rested[rows], told.seen[rows] = self._mean[tracks], self._seen[tracks]
        told.since[rows] = self._since[tracks]
        self._renew(tracks, np.delete(found, rows, axis=0), np.delete(kinds, rows))
        return told

    def coasting(self, time: float) -> Tracked:
        """Those who are missed now, but were found within the last `time` [s]; `rested` begins with where they are now.

        What a detector finds it misses now and again, and who is missed for a moment is not gone.
        """
        kept = (self._missed > 0) & self._is_within(time)
        velocities = np.where(self._spread[kept, 1, 1, None] < _KNOWN**2, self._state[kept, 1], np.nan)
        rested = np.concatenate([self._state[kept, 0], self._mean[kept, 2:]], axis=1)
        return Tracked(velocities, rested, self._seen[kept], self._since[kept])

    def _is_within(self, time: float) -> NDArray[np.bool_]:
        """Who was found within the last `time` [s]."""
        return np.asarray(self._missed <= round(time / self._period))

    def _predict(self) -> None:
        period = self._period
        step = np.array([[1.0, period], [0.0, 1.0]])
        push = np.array([period * period / 2.0, period]) * _ACCELERATION[self._nimble, None]
        self._state = step @ self._state
        self._spread = step @ self._spread @ step.T + push[:, :, None] * push[:, None]

    def _pairs(self, places: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of tracks and of the detections that are theirs."""
        offset = self._state[:, None, 0] - places[None]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        tracks, found = linear_sum_assignment(np.minimum(distance, 2.0 * _GATE))
        near = distance[tracks, found] < _GATE
        return tracks[near], found[near]

    def _correct(self, tracks: NDArray[np.int64], places: Floats) -> None:
        spread = self._spread[tracks]
        gain = spread[:, :, 0] / (spread[:, :1, 0] + _PLACE_STD[self._nimble[tracks], None] ** 2)
        self._state[tracks] += gain[:, :, None] * (places - self._state[tracks, 0])[:, None]
        self._spread[tracks] = spread - gain[:, :, None] * spread[:, :1]

    def _average(self, tracks: NDArray[np.int64], found: Floats, moved: float) -> None:
        """Means since each stands, of looks from different places."""
        drives = np.hypot(*self._state[tracks, 1].T) > _STANDS
        weight = min(moved / _APART, 1.0)
        looks = np.where(drives, 1.0, np.minimum(self._looks[tracks] + weight, _MOST))
        gain = np.where(drives, 1.0, weight / looks)
        self._looks[tracks] = looks
        mean = self._mean[tracks]
        mean += np.where(np.arange(found.shape[1]) < self._averaged, gain[:, None], 0.0) * (found - mean)
        mean[:, self._averaged :] = np.maximum(mean, found)[:, self._averaged :]
        self._mean[tracks] = mean

    def _renew(self, tracks: NDArray[np.int64], found: Floats, kinds: NDArray[np.int64]) -> None:
        """Forgets the lost, begins with the new."""
        fresh, count = found[:, :2], len(found)
        self._missed += 1
        self._missed[tracks] = 0
        kept = self._is_within(_LOST)
        begin = np.stack([fresh, np.zeros_like(fresh)], axis=1)
        unsure = np.zeros((count, 2, 2))
        unsure[:, 0, 0], unsure[:, 1, 1] = _PLACE_STD[kinds] ** 2, _BEGIN_SPEED**2
        self._nimble = np.concatenate([self._nimble[kept], kinds])
        self._state = np.concatenate([self._state[kept], begin])
        self._spread = np.concatenate([self._spread[kept], unsure])
        self._missed = np.concatenate([self._missed[kept], np.zeros(count, np.int64)])
        self._seen = np.concatenate([self._seen[kept], np.ones(count, np.int64)])
        self._since = np.concatenate([self._since[kept], _as_count(found)])
        self._mean = np.concatenate([self._mean[kept], found])
        self._looks = np.concatenate([self._looks[kept], np.ones(count)])


def _as_count(found: Floats) -> NDArray[np.int64]:
    """(N,) 1 for those whose last column is 0 or more, else 0."""
    return (found[:, -1] >= 0.0).astype(np.int64)
