"""Frames and their conventions, stated once.

Convention:
    World frame (CARLA's): x, y [m], z up; yaw in radians, clockwise seen from above (from +x towards +y).
    Vehicle frame: x forward, y right, z up. At yaw 0 a vehicle looks along +x and +y lies to its right.
    OpenDRIVE (y north, angles counter-clockwise) is converted in `lavsim.map.opendrive` alone: y = -y_od, yaw = -hdg.
    A transform is named `dst_from_src`; points are rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

EARTH_RADIUS = 6_378_137.0  # [m] spherical Mercator, CARLA up to 0.9.15 (reference `carla.md` 1.3)


def wrap_angle(angle: ArrayLike) -> Floats:
    """The same angles in [-pi, pi)."""
    return np.mod(np.asarray(angle, dtype=np.float64) + np.pi, 2.0 * np.pi) - np.pi


def forward(yaw: ArrayLike) -> Floats:
    """Unit vectors `(…, 2)` along headings `yaw` (…)."""
    return np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)


def right(yaw: ArrayLike) -> Floats:
    """Unit vectors `(…, 2)` to the right of headings `yaw` (…)."""
    return np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)


def to_world(points: ArrayLike, origin: ArrayLike, yaw: float) -> Floats:
    """World coordinates `(N, 2)` of local `points` `(N, 2)` (x forward, y right) of a frame at `origin`, `yaw`."""
    points = np.asarray(points, dtype=np.float64)
    return points[..., :1] * forward(yaw) + points[..., 1:2] * right(yaw) + np.asarray(origin, dtype=np.float64)


def to_local(points: ArrayLike, origin: ArrayLike, yaw: float) -> Floats:
    """Local coordinates `(N, 2)` (x forward, y right) of world `points` `(N, 2)` in a frame at `origin`, `yaw`."""
    delta = np.asarray(points, dtype=np.float64) - np.asarray(origin, dtype=np.float64)
    return np.stack([delta @ forward(yaw), delta @ right(yaw)], axis=-1)


def box_corners(x: ArrayLike, y: ArrayLike, yaw: ArrayLike, length: ArrayLike, width: ArrayLike) -> Floats:
    """Corners `(N, 4, 2)` of boxes centred at x, y: front-left, front-right, rear-right, rear-left."""
    ahead = forward(yaw) * np.asarray(length, dtype=np.float64)[..., None] / 2.0
    aside = right(yaw) * np.asarray(width, dtype=np.float64)[..., None] / 2.0
    centre = np.stack([np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)], axis=-1)
    return np.stack(
        [centre + ahead - aside, centre + ahead + aside, centre - ahead + aside, centre - ahead - aside], axis=-2
    )


def segments_cross(a0: Floats, a1: Floats, b0: Floats, b1: Floats) -> bool:
    """Whether segment a0-a1 meets segment b0-b1; touching counts."""
    u, v, w = a1 - a0, b1 - b0, b0 - a0
    cross = u[0] * v[1] - u[1] * v[0]
    if cross == 0.0:
        return False  # parallel: a car's tail and a stop line are not, unless it drives along the line
    along_a = (w[0] * v[1] - w[1] * v[0]) / cross
    along_b = (w[0] * u[1] - w[1] * u[0]) / cross
    return bool(0.0 <= along_a <= 1.0 and 0.0 <= along_b <= 1.0)


def geolocation(x: ArrayLike, y: ArrayLike, lat_ref: float = 0.0, lon_ref: float = 0.0) -> tuple[Floats, Floats]:
    """Latitude and longitude [deg] of world points [m].

    Source: the CARLA leaderboard's `route_manipulation` (spherical Mercator, north is -y).
    """
    scale = np.cos(np.radians(lat_ref))
    east = scale * np.radians(lon_ref) * EARTH_RADIUS + np.asarray(x, dtype=np.float64)
    north = scale * EARTH_RADIUS * np.log(np.tan((90.0 + lat_ref) * np.pi / 360.0)) - np.asarray(y, dtype=np.float64)
    lon = east * 180.0 / (np.pi * EARTH_RADIUS * scale)
    lat = 360.0 * np.arctan(np.exp(north / (EARTH_RADIUS * scale))) / np.pi - 90.0
    return lat, lon
