"""Where the ego is, from GNSS, compass, speed and steering: an extended Kalman filter with a bicycle model.

Convention:
    One frame for motion and measurements: x east, y south of the first fix [m], heading clockwise from east [rad], the
    compass less a quarter turn. It is the world's but for its origin.

Source: reference `lav.md` 2.5 and 6.2. The released filter mixed frames and fell behind by a third within a minute
(its section 7.1); this is the model that was meant, with this vehicle's numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.geometry import EARTH_RADIUS, wrap_angle
from lavsim.sensors.gnss import NOISE_STD
from lavsim.types import DT
from lavsim.world.dynamics import REAR_LENGTH, steer_curvature

Floats = NDArray[np.float64]

GNSS_STD = math.radians(NOISE_STD) * EARTH_RADIUS  # [m]
_COMPASS_STD = 1e-3  # [rad]; it has no noise
# What the model gets wrong in a tick grows with the way: who stands stays where he is.
_PLACE_STD, _LEAST_PLACE_STD = 0.03, 1e-3  # [m] a metre driven, [m]
_HEADING_STD = 3e-3  # [rad]


class Pose(NamedTuple):
    """Attributes:
    xy: (2,) [m].
    yaw: [rad].
    """

    xy: Floats
    yaw: float


class EgoFilter:
    """Follows the ego tick by tick. The first fix is the origin."""

    def __init__(self) -> None:
        self._is_begun = False
        self._origin = np.zeros(2)  # latitude, longitude [deg]
        self._scale = np.ones(2)  # [m/deg] of both
        self._state = np.zeros(3)
        self._spread = np.zeros((3, 3))

    def update(self, gnss: ArrayLike, compass: float, speed: float, steer: float) -> Pose:
        """The pose now.

        Args:
            gnss: Latitude and longitude [deg], and what may follow.
            compass: [rad], 0 north, clockwise; not a number where there is none.
            speed: [m/s].
            steer: What was asked at the tick before, -1 to 1.
        """
        fix = np.asarray(gnss, np.float64)[:2]
        heading = float(wrap_angle(compass - math.pi / 2.0)) if math.isfinite(compass) else None
        if self._is_begun:
            self._predict(speed, steer)
        else:
            self._begin(fix, heading)
        north, east = (fix - self._origin) * self._scale
        self._correct(np.array([1.0, 0.0, 0.0]), east, GNSS_STD)
        self._correct(np.array([0.0, 1.0, 0.0]), -north, GNSS_STD)
        if heading is not None:
            near = self._state[2] + wrap_angle(heading - self._state[2])
            self._correct(np.array([0.0, 0.0, 1.0]), near, _COMPASS_STD)
        return Pose(self._state[:2].copy(), float(wrap_angle(self._state[2])))

    def gps(self) -> Floats:
        """(2,) latitude and longitude [deg] of where it takes the ego to be."""
        east, south = self._state[:2]
        return np.asarray(self._origin + np.array([-south, east]) / self._scale)

    def _begin(self, fix: Floats, heading: float | None) -> None:
        degree = EARTH_RADIUS * math.pi / 180.0
        self._is_begun, self._origin = True, fix
        self._scale = np.array([degree, degree * math.cos(math.radians(fix[0]))])
        self._state[2] = heading or 0.0
        self._spread = np.diag([GNSS_STD**2, GNSS_STD**2, math.pi**2])

    def _predict(self, speed: float, steer: float) -> None:
        curvature, way = steer_curvature(steer), speed * DT
        course = self._state[2] + math.asin(curvature * REAR_LENGTH)  # slips at its middle
        along = np.array([math.cos(course), math.sin(course)])
        self._state[:2] += way * along
        self._state[2] += way * curvature
        jacobian = np.eye(3)
        jacobian[:2, 2] = way * np.array([-along[1], along[0]])
        place = max(_PLACE_STD * abs(way), _LEAST_PLACE_STD)
        self._spread = jacobian @ self._spread @ jacobian.T + np.diag([place**2, place**2, _HEADING_STD**2])

    def _correct(self, row: Floats, measured: float, std: float) -> None:
        """Takes in one measurement of `row @ state`."""
        gain = self._spread @ row / (row @ self._spread @ row + std * std)
        self._state = self._state + gain * (measured - row @ self._state)
        self._spread = self._spread - np.outer(gain, row @ self._spread)
        self._spread = (self._spread + self._spread.T) / 2.0
