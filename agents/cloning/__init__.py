"""Conditional behaviour cloning: cameras to waypoints by command, the learned baseline beside LAV."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.cloning.agent import CloningAgent, get_entry_point

__all__ = ["CloningAgent", "get_entry_point"]


def __getattr__(name: str) -> Any:
    """The agent, imported when it is asked for: a list of agents does not need PyTorch."""
    if name in __all__:
        from agents.cloning import agent

        return getattr(agent, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
