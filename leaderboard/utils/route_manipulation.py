"""The leaderboard's route helpers that team code imports."""

from lavsim.agent import downsample_route
from lavsim.route_standin import interpolate_trajectory, location_route_to_gps
from lavsim.route_standin import location_to_gps as _location_to_gps

__all__ = ["_location_to_gps", "downsample_route", "interpolate_trajectory", "location_route_to_gps"]
