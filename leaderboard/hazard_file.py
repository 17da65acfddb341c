"""The route file `hazards`: for every type of hazard two routes in different towns, 150 to 400 m, one hazard each.

There is no background traffic but for types that act through it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice

from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town, town_names
from lavsim.scenarios.director import trigger_index
from lavsim.scenarios.suggest import suggestion
from lavsim.world.weather import WeatherKeyframe
from leaderboard.hazard_maker import Stand, hazard_types, stands
from leaderboard.route_maker import WEATHERS, entry_of
from leaderboard.routes import RouteEntry

TOWNS_A_TYPE = 2
TRIES = 120  # ways through a town that are looked at for a type
CANDIDATES = 4  # stands in a town of which the first good one is taken
TRAFFIC = "empty"
THROUGH_TRAFFIC = {"Scenario7", "Scenario8", "Scenario9", "Scenario10", "HardBreakRoute"}  # they act through it
OFF_THE_EGO = {"HardBreakRoute"}  # acts on vehicles right ahead of the ego, which 2.x's traffic keeps there
DENSE = "leaderboard"

Good = Callable[[RouteEntry], bool]


def hazard_routes(
    kinds: Sequence[tuple[str, str]] | None = None,
    good: Good | None = None,
    tell: Callable[[str], None] = print,
    kept: Sequence[RouteEntry] = (),
) -> Iterator[RouteEntry]:
    """Routes for `kinds` (generation, type), all of ours if not given.

    Args:
        kinds: What to draw routes for.
        good: Takes or refuses a route; where a town has no good one among its first, the first is taken if no other
            town has one.
        tell: Is told of each type in which towns it stands.
        kept: Routes of an older file, taken before others where their type would still stand there.
    """
    number = 0
    for place, (generation, kind) in enumerate(hazard_types() if kinds is None else kinds):
        old = [
            entry for entry in kept if (entry.scenarios[0].generation, entry.scenarios[0].type) == (generation, kind)
        ]
        found = _entries(generation, kind, place, good, [new for entry in old if (new := _again(entry)) is not None])
        tell(f"{generation} {kind}: {', '.join(entry.town for entry in found)}")
        for entry in found:
            yield replace(entry, id=str(number))
            number += 1


def _again(entry: RouteEntry) -> RouteEntry | None:
    """An older route with the parameters that its hazard would have now; None where it would not be put there now."""
    town, old = load_town(entry.town), entry.scenarios[0]
    route = get_planner(town).trace(entry.keypoints)
    index = trigger_index(route, old)
    found = None if index is None else suggestion(town, route, index, old.type, old.generation, old.name)
    return None if found is None else replace(entry, scenarios=(replace(old, parameters=found.spec.parameters),))


def _entries(generation: str, kind: str, place: int, good: Good | None, kept: Sequence[RouteEntry]) -> list[RouteEntry]:
    """Routes of one type: those kept, then towns are tried in turn, beginning with another one for each type.

    Where only one town has a place for it, as for what needs a motorway, both routes lead through that one.
    """
    towns, spare = town_names(), list[RouteEntry]()
    taken = [entry for entry in kept if good is None or good(entry)][:TOWNS_A_TYPE]
    for offset in range(len(towns)):
        name = towns[(place + offset) % len(towns)]
        if len(taken) == TOWNS_A_TYPE:
            break
        if any(entry.town == name for entry in taken):
            continue
        entries = [_entry(name, stand, place) for stand in _stands(name, generation, kind)]
        fine = next((entry for entry in entries if good is None or good(entry)), None)
        if fine is not None:
            taken.append(fine)
        spare += [entry for entry in entries if entry is not fine]
    return (taken + spare)[:TOWNS_A_TYPE]


def _stands(town: str, generation: str, kind: str) -> list[Stand]:
    """The first few in a town; routes with stop signs are taken where there are no others."""
    where = load_town(town)
    quiet = list(islice(stands(where, kind, generation, tries=TRIES), CANDIDATES))
    return quiet or list(islice(stands(where, kind, generation, tries=TRIES, quiet=False), CANDIDATES))


def _entry(town: str, stand: Stand, place: int) -> RouteEntry:
    weather = list(WEATHERS.values())[place % len(WEATHERS)]
    entry = entry_of(load_town(town), "0", stand.route.keypoints, (WeatherKeyframe(0.0, weather),))
    traffic = DENSE if stand.spec.type in OFF_THE_EGO else "lav" if stand.spec.type in THROUGH_TRAFFIC else TRAFFIC
    return replace(entry, scenarios=(stand.spec,), traffic=traffic)
