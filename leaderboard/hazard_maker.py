"""Where in a town hazards can stand: short ways through it, each with one hazard where its type stands well."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count
from typing import Generic, TypeVar

import numpy as np

from lavsim.errors import ConfigError, UnknownName
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.scenarios.base import SCENARIOS, ScenarioSpec
from lavsim.scenarios.suggest import suggestion
from leaderboard.route_maker import RouteWish, driven_way, random_ways
from leaderboard.routes import RouteEntry

T = TypeVar("T")

AFTER_START = (25.0, 90.0)  # [m] of route before a trigger
AT_START = (2.0, 12.0)  # [m] the same of what is set off where the route starts
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


def find_type(name: str) -> tuple[str, str]:
    """(generation, type) of "Accident" or "1.0:Scenario3".

    Raises:
        UnknownName: there is none.
    """
    generation, colon, kind = name.rpartition(":")
    found = [key for key in hazard_types() if key[1] == kind and (not colon or key[0] == generation)]
    if not found:
        raise UnknownName("scenario", name, (f"{key[0]}:{key[1]}" if colon else key[1] for key in hazard_types()))
    return found[-1]  # a name of both generations is the newer one


def chosen_types(names: Sequence[str]) -> list[tuple[str, str]]:
    """The types that `names` name; "all" stands for all of 2.x that act.

    Raises:
        UnknownName: there is none of a name.
    """
    everything = [key for key in hazard_types("2.x") if SCENARIOS[key].acts]
    found = [key for name in names for key in (everything if name == "all" else [find_type(name)])]
    return list(dict.fromkeys(found))


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
    taken: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    for route in _short_routes(town, RouteWish(1, shortest, longest, seed, most_stops=0 if quiet else None), tries):
        stand = stand_on(town, route, kind, generation)
        if stand is None:
            continue
        place = np.asarray(stand.spec.trigger[:2])
        if all(np.hypot(*(place - other)) > APART for other in taken):
            taken.append(place)
            yield stand


class _Kept(Generic[T]):
    """An iterator that can be gone through again; what it has given is kept."""

    def __init__(self, source: Iterator[T]) -> None:
        self._source, self._given = source, list[T]()

    def __iter__(self) -> Iterator[T]:
        for number in count():
            if number == len(self._given):
                try:
                    self._given.append(next(self._source))
                except StopIteration:
                    return
            yield self._given[number]


@lru_cache(maxsize=32)
def _short_routes(town: TownMap, wish: RouteWish, tries: int) -> _Kept[Route]:
    """Routes of up to `tries` random ways; the same for all types of hazards."""
    draws, planner = Draws.of_seed(wish.seed).stream(f"stands in {town.name}"), get_planner(town)
    traced = (driven_way(town, planner, way, wish) for way in random_ways(town, wish, draws, tries))
    return _Kept(route for route in traced if route is not None)


def stand_on(town: TownMap, route: Route, kind: str, generation: str, number: int = 1) -> Stand | None:
    """The first place on `route` for a hazard of a type; None where there is none."""
    after = AT_START if SCENARIOS[generation, kind].starts_route else AFTER_START
    first, last = (int(np.searchsorted(route.distance, at)) for at in after)
    for index in range(first, min(last, len(route)), STEP):
        if route.length - route.distance[index] < BEFORE_END:
            return None
        found = suggestion(town, route, index, kind, generation, f"{kind}_{number}")
        if found is not None:
            return Stand(route, index, found.spec)
    return None


def put_hazards(
    town: TownMap, entry: RouteEntry, kinds: Sequence[tuple[str, str]], spacing: float, draws: Draws
) -> RouteEntry:
    """The route with hazards of drawn types where they stand well, `spacing` metres apart or more.

    Args:
        town: Where.
        entry: A route; its own hazards are replaced.
        kinds: (generation, type) to draw from; where one does not stand the next in a drawn order is tried.
        spacing: Between two triggers [m].
        draws: What to draw from.

    Raises:
        ConfigError: `spacing` is not positive.
    """
    if not spacing > 0.0:
        raise ConfigError(f"spacing of hazards must be positive [m], got {spacing:g}.")
    route = get_planner(town).trace(entry.keypoints)
    specs: list[ScenarioSpec] = []
    free = AFTER_START[0]
    for index in range(0, len(route), STEP):
        here = float(route.distance[index])
        if here < free or route.length - here < BEFORE_END:
            continue
        for choice in draws.stream("kind").permutation(index, len(kinds)):
            generation, kind = kinds[int(choice)]
            found = suggestion(town, route, index, kind, generation, f"{kind}_{len(specs) + 1}")
            if found is not None:
                specs.append(found.spec)
                free = here + spacing
                break
    return replace(entry, scenarios=tuple(specs))
