"""What is known about a bundled town beside its road network: `towns.toml`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources

SPLITS = ("training", "test", "full")


@dataclass(frozen=True)
class TownFacts:
    """A bundled town in words and numbers.

    Attributes:
        layout: In words.
        split: "training", "test" or "full" (trains only in the full set).
        vehicles: Background vehicles of a drive.
        vehicles_per_lane_km: Density that traffic profiles go by [1/km].
        walkers: Background walkers of a drive.
        parked: Share of parking spaces taken.
    """

    layout: str
    split: str
    vehicles: int
    vehicles_per_lane_km: float
    walkers: int = 0
    parked: float = 0.0


@cache
def bundled_facts() -> dict[str, TownFacts]:
    """Facts by name of the town."""
    text = (resources.files("lavsim.towns") / "towns.toml").read_text(encoding="utf-8")
    return {name: TownFacts(**values) for name, values in tomllib.loads(text).items()}


def facts_of(name: str) -> TownFacts | None:
    """Facts about a town; None for one that is not bundled."""
    return bundled_facts().get(name)
