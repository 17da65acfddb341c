"""Traffic profiles: how many vehicles and walkers a drive has, by town, rules' generation and profile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lavsim.errors import UnknownName
from lavsim.map.town_map import TownMap
from lavsim.towns.facts import facts_of
from lavsim.types import LaneType

TRAFFIC_PROFILES = ("leaderboard", "lav", "empty")

# Vehicles of leaderboard 1.0 by CARLA's exact town name; any other town has none (reference `leaderboard.md` 6.4).
LEADERBOARD_VEHICLES: Mapping[str, int] = {
    "Town01": 120, "Town02": 100, "Town03": 120, "Town04": 200, "Town05": 120,
    "Town06": 150, "Town07": 110, "Town08": 180, "Town09": 300, "Town10": 120,
}  # fmt: skip
_VEHICLES_PER_LANE_KM = 10.0  # in towns of one's own
_WALKERS_PER_KM = 8.0  # of sidewalk
_MOST_VEHICLES, _MOST_WALKERS = 250, 150


@dataclass(frozen=True)
class Population:
    """Who is in town beside the ego and the hazards.

    Attributes:
        vehicles: Background vehicles; where they follow the ego, how many at most.
        walkers: Background walkers.
        parked: Share of parking spaces taken, 0 to 1.
        follows_ego: Whether vehicles appear around the ego and vanish behind it (2.x) instead of filling the town.
    """

    vehicles: int
    walkers: int = 0
    parked: float = 0.0
    follows_ego: bool = False


def population_of(profile: str, generation: str, town: TownMap) -> Population:
    """The population of a profile.

    Args:
        profile: One of `TRAFFIC_PROFILES`: "leaderboard" is what the rules of `generation` say, "lav" the town's own
            density with walkers and parked cars (collection and our route files), "empty" nobody.
        generation: "1.0" or "2.x".
        town: Where.

    Raises:
        UnknownName: no such profile.
    """
    if profile not in TRAFFIC_PROFILES:
        raise UnknownName("traffic profile", profile, TRAFFIC_PROFILES)
    if profile == "empty":
        return Population(0)
    if profile == "lav":
        return _town_density(town)
    if generation == "2.x":
        return Population(_MOST_VEHICLES, parked=1.0, follows_ego=True)
    return Population(LEADERBOARD_VEHICLES.get(town.name, 0))


def _town_density(town: TownMap) -> Population:
    """What `towns.toml` says, or a density by length for towns it does not know."""
    facts = facts_of(town.name)
    if facts is not None:
        return Population(facts.vehicles, facts.walkers, facts.parked)
    lanes = town.lanes
    driving = float(np.sum(lanes.length[(lanes.type == LaneType.DRIVING) & (lanes.junction < 0)])) / 1e3
    sidewalk = float(np.sum(lanes.length[lanes.type == LaneType.SIDEWALK])) / 1e3
    return Population(
        min(round(_VEHICLES_PER_LANE_KM * driving), _MOST_VEHICLES),
        min(round(_WALKERS_PER_KM * sidewalk), _MOST_WALKERS),
        parked=0.5,
    )
