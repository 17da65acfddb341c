"""Learning from All Vehicles (Chen & Krähenbühl, CVPR 2022): models, stages, agents."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.lav.agent import LavAgent, get_entry_point

__all__ = ["LavAgent", "get_entry_point"]


def __getattr__(name: str) -> Any:
    """The agent, imported when it is asked for: sizes and commands do not need PyTorch."""
    if name in __all__:
        from agents.lav import agent

        return getattr(agent, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
