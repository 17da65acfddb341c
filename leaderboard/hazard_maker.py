"""Where in a town hazards can stand: short ways through it, each with one hazard where its type stands well."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.scenarios.base import SCENARIOS, ScenarioSpec
from lavsim.scenarios.suggest import suggestion
from leaderboard.route_maker import RouteWish, driven_way, random_ways

AFTER_START = (25.0, 90.0)  # [m] of route before a trigger
BEFORE_END = 60.0  # [m] of route after it, at least
STEP = 5  # route points between two that are tried
TRIES = 300  # ways through a town
APART = 30.0  # [m] between the triggers of two stands


@dataclass(frozen=True)
class Stand:
    """A route with a hazard on it.

    Attributes:
        route: 150 to 400 m unless wished otherwise.
        index: Point of the route at the trigger.
        spec: The hazard as a route file has it.
    """

    route: Route
    index: int
    spec: ScenarioSpec


def hazard_types(generation: str | None = None) -> list[tuple[str, str]]:
    """(generation, type) of all hazards."""
    keys = [key for key in SCENARIOS if isinstance(key, tuple)]
    return [(str(key[0]), str(key[1])) for key in keys if generation in (None, key[0])]


def stands(
    town: TownMap,
    kind: str,
    generation: str,
    seed: int = 0,
    shortest: float = 150.0,
    longest: float = 400.0,
    tries: int = TRIES,
    quiet: bool = True,
) -> Iterator[Stand]:
    """Places for hazards of a type, in drawn order.

    Args:
        town: Where.
        kind: Type of the hazard.
        generation: "1.0" or "2.x".
        seed: Of the ways.
        shortest, longest: Of the routes [m].
        tries: Ways to look at.
        quiet: Whether routes with stop signs, which only cost time, are left out.

    Raises:
        UnknownName: no such hazard.
    """
    SCENARIOS[generation, kind]
    wish = RouteWish(1, shortest, longest, seed, most_stops=0 if quiet else None)
    draws, planner = Draws.of_seed(seed).stream(f"stands in {town.name}"), get_planner(town)
    taken: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    for way in random_ways(town, wish, draws, tries):
        route = driven_way(town, planner, way, wish)
        if route is None:
            continue
        stand = stand_on(town, route, kind, generation)
        if stand is None:
            continue
        place = np.asarray(stand.spec.trigger[:2])
        if all(np.hypot(*(place - other)) > APART for other in taken):
            taken.append(place)
            yield stand


def stand_on(town: TownMap, route: Route, kind: str, generation: str, number: int = 1) -> Stand | None:
    """The first place on `route` for a hazard of a type; None where there is none."""
    first, last = (int(np.searchsorted(route.distance, at)) for at in AFTER_START)
    for index in range(first, min(last, len(route)), STEP):
        if route.length - route.distance[index] < BEFORE_END:
            return None
        found = suggestion(town, route, index, kind, generation, f"{kind}_{number}")
        if found is not None:
            return Stand(route, index, found.spec)
    return None
