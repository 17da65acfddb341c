"""CARLA's route helpers for team code, answered from the plan that the agent was handed: it has no map.

Only the agent's child process is told a plan; `leaderboard.utils.route_manipulation` has these functions under their
names there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lavsim.geometry import geolocation

if TYPE_CHECKING:
    from lavsim.agent import AgentPlan

REACH = 3.0  # [m] from the plan, beyond which a place is not on it

_plan: AgentPlan | None = None  # of the route that this process drives


def tell_plan(plan: AgentPlan) -> None:
    """Sets the dense plan of the route that begins."""
    global _plan
    _plan = plan


def interpolate_trajectory(*arguments: Any, hop_resolution: float = 1.0) -> tuple[list[Any], list[Any]]:
    """The dense plan between the first and the last of some places on it, as (gps, world).

    Args:
        arguments: `(world, trajectory, hop_resolution)` as in 1.0, or `(trajectory, hop_resolution)` as in 2.x; the
            trajectory is a list of locations, in order along the agent's own route.
        hop_resolution: Accepted and not used: the plan has a point every metre.

    Raises:
        RuntimeError: the places are not on the agent's route; another way would need the map.
    """
    trajectory = next((a for a in arguments[:2] if isinstance(a, Sequence)), None)
    if trajectory is None or not len(trajectory):
        raise RuntimeError("interpolate_trajectory needs a list of locations")
    if _plan is None:
        raise RuntimeError("interpolate_trajectory knows the plan of the agent's route only, and there is none yet")
    indices = [0]
    for place in trajectory:
        location: Any = getattr(place, "location", place)
        ahead = _plan.points[indices[-1] :, :2] - (location.x, location.y)
        distance = np.hypot(ahead[:, 0], ahead[:, 1])
        if distance.min() > REACH:
            raise RuntimeError(
                f"interpolate_trajectory: ({location.x:.1f}, {location.y:.1f}) is not on the agent's route after the "
                "places before it; other ways need a CARLA server"
            )
        indices.append(indices[-1] + int(distance.argmin()))
    first, last = indices[1], indices[-1] + 1
    return _plan.gps[first:last], _plan.world[first:last]


def location_to_gps(lat_ref: float, lon_ref: float, location: Any) -> dict[str, float]:
    """Latitude, longitude [deg] and z [m] of a location, by the reference of its map."""
    lat, lon = geolocation(location.x, location.y, lat_ref, lon_ref)
    return {"lat": float(lat), "lon": float(lon), "z": location.z}


def location_route_to_gps(route: Sequence[tuple[Any, Any]], lat_ref: float, lon_ref: float) -> list[tuple[Any, Any]]:
    """A route of (transform, option) as one of ({"lat", "lon", "z"}, option)."""
    return [(location_to_gps(lat_ref, lon_ref, transform.location), option) for transform, option in route]
