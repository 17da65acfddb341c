"""The way of who crosses the road from its edge."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import forward, right
from lavsim.map.waypoint import Waypoint
from lavsim.scenarios.moves.roadside import sign_of
from lavsim.scenarios.place import aside, kerb


def across(yaw: float, direction: str, angle: float = 0.0) -> NDArray[np.float64]:
    """Unit vector (2,) across a road.

    Args:
        yaw: Of the lane [rad].
        direction: Side it starts from, "right" or "left".
        angle: Against the perpendicular of the lane [deg], positive towards who drives on it.
    """
    way = -sign_of(direction) * right(yaw) - math.tan(math.radians(angle)) * forward(yaw)
    unit: NDArray[np.float64] = way / np.hypot(*way)
    return unit


def at_kerb(place: Waypoint, direction: str, beyond: float) -> NDArray[np.float64]:
    """x, y, z (3,) of the place `beyond` metres outside the roadway beside a lane centre."""
    return aside(place, sign_of(direction) * (kerb(place, direction) + beyond))
