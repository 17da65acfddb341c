"""Errors that a user can cause; the command line prints them as one line and exits with 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class LavsimError(Exception):
    """A mistake in what came from outside: the message says what came and what was expected."""


class UnknownName(LavsimError):  # noqa: N818 - reads as what happened, as in the messages
    """A name that no registry, folder or table holds."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        names = sorted(known)
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        listed = ", ".join(names[:40]) + (", …" if len(names) > 40 else "")
        super().__init__(f"no {kind} {name!r}.{hint} Known: {listed or 'none'}.")


class ConfigError(LavsimError):
    """A setting out of its range, of the wrong type, or unknown."""


class MapError(LavsimError):
    """An OpenDRIVE file that can't be read or makes no road network."""


class RouteError(LavsimError):
    """A route file that can't be read, or a route that can't be driven."""


class ScenarioError(LavsimError):
    """A hazard whose parameters or place don't fit."""


class SensorError(LavsimError):
    """A sensor dictionary that is malformed or not allowed."""


class LogError(LavsimError):
    """A recorded drive that can't be read."""


class DatasetError(LavsimError):
    """A dataset, or a file of one, that is damaged, incomplete, of another version, or not what was named."""


class OutputError(LavsimError):
    """An output folder that can't be written or already holds a run."""


class AgentError(LavsimError):
    """An agent that can't be found or loaded from what the user gave."""
