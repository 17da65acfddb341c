"""Follows the route at one speed, whatever happens: what a planner adds to steering is measured against it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.baselines.route_agent import Pose, RouteAgent

SPEED = 5.0  # [m/s] most turns can be driven at it
GAIN = 1.0  # [1/s]


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "ConstantSpeed"


class ConstantSpeed(RouteAgent):
    """Keeps 5 m/s: no lights, no signs, no others."""

    def acceleration(self, pose: Pose, truth: Mapping[str, Any]) -> float:
        return GAIN * (SPEED - pose.speed)
