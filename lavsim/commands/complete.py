"""What a shell offers after Tab: the names that ship. Files are listed by their names, so the answer comes at once."""

from __future__ import annotations

from importlib import resources


def towns(incomplete: str) -> list[str]:
    return [name for name in _stems("lavsim", "towns", ".xodr") if name.startswith(incomplete)]


def routes(incomplete: str) -> list[str]:
    return [name for name in _stems("routes", "", ".xml") if name.startswith(incomplete)]


def rules(incomplete: str) -> list[str]:
    from leaderboard.rules import RULES

    return [name for name in RULES if name.startswith(incomplete)]


def agents(incomplete: str) -> list[str]:
    """Modules of agents; a shell like bash takes a colon for the end of a word, so their classes are left out."""
    from lavsim.agent_source import packaged_agents

    modules = sorted({target.partition(":")[0] for target, _ in packaged_agents()})
    return [name for name in modules if name.startswith(incomplete)]


def towns_and_routes(incomplete: str) -> list[str]:
    return [*towns(incomplete), *routes(incomplete)]


def _stems(package: str, folder: str, ending: str) -> list[str]:
    names = sorted(file.name for file in resources.files(package).joinpath(folder).iterdir())
    return [name.removesuffix(ending) for name in names if name.endswith(ending)]
