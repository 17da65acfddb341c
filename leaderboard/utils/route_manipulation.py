"""The leaderboard's route helpers that team code imports."""

from lavsim.agent import downsample_route

__all__ = ["downsample_route"]
