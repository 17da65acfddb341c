"""The environments' ids: entered when this module is imported, which gymnasium does itself when a name says so.

`gymnasium.make("leaderboard.gym_ids:lavsim/Route-v0")` drives the routes of a file,
`"leaderboard.gym_ids:lavsim/LaneKeeping-v0"` roads without traffic or hazards.
"""

from __future__ import annotations

import gymnasium

gymnasium.register("lavsim/Route-v0", entry_point="leaderboard.env:RouteEnv")
gymnasium.register(
    "lavsim/LaneKeeping-v0",
    entry_point="leaderboard.env:RouteEnv",
    kwargs={"routes": "quick", "traffic": "empty", "hazards": False, "observe": ("state",), "max_seconds": 20.0},
)
