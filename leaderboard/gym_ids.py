"""The environments' ids, entered when gymnasium itself is imported (entry point `gymnasium.envs`).

`gymnasium.make("lavsim/Route-v0")` drives the routes of a file, `"lavsim/LaneKeeping-v0"` one straight road without
traffic. Nothing heavy is imported here.
"""

from __future__ import annotations


def register() -> None:
    """Enters the ids; gymnasium puts the entry point's name, `lavsim/`, before them."""
    import gymnasium

    gymnasium.register("Route-v0", entry_point="leaderboard.env:RouteEnv")
    gymnasium.register(
        "LaneKeeping-v0",
        entry_point="leaderboard.env:RouteEnv",
        kwargs={"routes": "quick", "traffic": "empty", "hazards": False, "observe": ("state",), "max_seconds": 20.0},
    )
