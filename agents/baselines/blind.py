"""The expert without eyes for others: what is left of a score when nobody is there to be hit is its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.behavior.agent import BehaviorAgent

_PER_ACTOR = ("ids", "classes", "roles", "sizes", "xyz", "yaw", "velocities", "vehicle_lights")


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "BlindRouteFollower"


class BlindRouteFollower(BehaviorAgent):
    """Keeps to the route, its lanes, limits, lights and stop signs; no other actor exists for it."""

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Any:
        frame, truth = input_data["truth"]
        return super().run_step({**input_data, "truth": (frame, alone(truth))}, timestamp)


def alone(truth: Mapping[str, Any]) -> dict[str, Any]:
    """The truth with the ego (row 0) as its only actor."""
    return {key: value[:1] if key in _PER_ACTOR else value for key, value in truth.items()}
