"""Velocities of detected actors, from where they are found tick after tick in a frame that stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lavsim.types import DT

Floats = NDArray[np.float64]

_GATE = 2.5  # [m] from where an actor was expected
_PLACE_STD = 0.25  # [m] of a detection: cells are half a metre
_ACCELERATION = 2.5  # [m/s²]
_BEGIN_SPEED = 8.0  # [m/s] what a new one may drive
_KNOWN = 1.0  # [m/s] standard deviation below which a velocity is told
_LOST = 10  # ticks without a detection


class Tracker:
    """One Kalman filter an actor, constant velocity, the nearest detection each."""

    def __init__(self) -> None:
        self._state = np.zeros((0, 2, 2))  # by track: place and velocity, by axis
        self._spread = np.zeros((0, 2, 2))  # the same for both axes
        self._missed = np.zeros(0, np.int64)

    def update(self, places: Floats) -> Floats:
        """(N, 2) velocities [m/s] of the actors at places (N, 2) [m], not a number where they are not known yet."""
        self._predict()
        tracks, found = self._pairs(places)
        self._correct(tracks, places[found])
        velocities = np.full((len(places), 2), np.nan)
        sure = self._spread[tracks, 1, 1] < _KNOWN**2
        velocities[found[sure]] = self._state[tracks[sure], 1]
        self._renew(tracks, np.delete(places, found, axis=0))
        return velocities

    def _predict(self) -> None:
        step = np.array([[1.0, DT], [0.0, 1.0]])
        push = np.array([DT * DT / 2.0, DT]) * _ACCELERATION
        self._state = step @ self._state
        self._spread = step @ self._spread @ step.T + np.outer(push, push)

    def _pairs(self, places: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of tracks and of the detections that are theirs."""
        offset = self._state[:, None, 0] - places[None]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        tracks, found = linear_sum_assignment(np.minimum(distance, 2.0 * _GATE))
        near = distance[tracks, found] < _GATE
        return tracks[near], found[near]

    def _correct(self, tracks: NDArray[np.int64], places: Floats) -> None:
        spread = self._spread[tracks]
        gain = spread[:, :, 0] / (spread[:, :1, 0] + _PLACE_STD**2)
        self._state[tracks] += gain[:, :, None] * (places - self._state[tracks, 0])[:, None]
        self._spread[tracks] = spread - gain[:, :, None] * spread[:, :1]

    def _renew(self, tracks: NDArray[np.int64], fresh: Floats) -> None:
        """Forgets the lost, begins with the new."""
        self._missed += 1
        self._missed[tracks] = 0
        kept = self._missed <= _LOST
        begin = np.stack([fresh, np.zeros_like(fresh)], axis=1)
        unsure = np.broadcast_to(np.diag([_PLACE_STD**2, _BEGIN_SPEED**2]), (len(fresh), 2, 2))
        self._state = np.concatenate([self._state[kept], begin])
        self._spread = np.concatenate([self._spread[kept], unsure])
        self._missed = np.concatenate([self._missed[kept], np.zeros(len(fresh), np.int64)])
