"""CARLA's base class under the path published agents import it from."""

from __future__ import annotations

from lavsim.agent import Agent, Track

__all__ = ["AutonomousAgent", "Track"]


class AutonomousAgent(Agent):
    """Base class of agents written for the CARLA leaderboard, 1.0 and 2.x."""
