"""A junction without lights, where traffic must be negotiated with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lavsim.scenarios.base import SCENARIOS, Scenario, Script, Stage
from lavsim.scenarios.moves import wait
from lavsim.scenarios.place import Site

_END = 20.0  # [m] behind the junction


@dataclass(frozen=True)
class NoSignalJunctionConfig:
    """Nothing to choose.

    Attributes:
        other_actors: Places of the scenario file; 1.0 does not use them here.
    """

    other_actors: Mapping[str, Any] = field(default_factory=dict)


@SCENARIOS.register(("1.0", "Scenario10"))
class NoSignalJunctionCrossing(Scenario):
    """NHTSA pre-crash type: crossing negotiation at an unsignalised junction. A support type: nothing is scripted.

    It lasts from the trigger until the ego is 20 m behind the next junction. Only background traffic acts.

    Source: leaderboard 1.0 (reference `leaderboard.md` 6.1).
    """

    Config = NoSignalJunctionConfig
    appears_at_trigger = True
    acts = False

    def fits(self, site: Site) -> str | None:
        return None

    def suits(self, site: Site) -> str | None:
        if site.exit is None or site.to_junction > 60.0:
            return "no junction follows within 60 m"
        return "the junction has lights" if site.light >= 0 else None

    def place(self, stage: Stage) -> None:
        """It has no actors."""

    def script(self, stage: Stage) -> Script:
        return wait.until(wait.left_junction(stage, _END))
