"""The behaviour agent: an expert on privileged state, rule-based."""

from agents.behavior.agent import BehaviorAgent, get_entry_point

__all__ = ["BehaviorAgent", "get_entry_point"]
