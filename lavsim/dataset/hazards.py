"""Hazards of a collected drive: along a random route, where they fit, of types drawn by hash."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lavsim.errors import UnknownName
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.scenarios.base import SCENARIOS, ScenarioSpec
from lavsim.scenarios.suggest import suggestion

LAV_HAZARDS = ("Scenario1", "Scenario3", "Scenario4", "Scenario7", "Scenario8", "Scenario9", "Scenario10")
AFTER_START = 25.0  # [m] of route that the ego has to get going
BEFORE_END = 40.0  # [m] of route in which none begins
_PLACES = 6  # points of a stretch that are tried for a type


def generation_of(kind: str) -> str:
    """The generation of the leaderboard whose hazard is meant by a type's name: the newer where both have it.

    Raises:
        UnknownName: there is no such type.
    """
    for generation in ("2.x", "1.0"):
        if (generation, kind) in SCENARIOS:
            return generation
    raise UnknownName("hazard", kind, known_hazards())


def known_hazards() -> tuple[str, ...]:
    """All types there are."""
    keys = [key for key in SCENARIOS if isinstance(key, tuple)]
    return tuple(sorted({str(kind) for _, kind in keys}))


def named_hazards(text: str) -> tuple[str, ...]:
    """Types of hazards, separated by commas; "none", "lav" for those of LAV's collector, "all" for all there are."""
    if text in ("none", ""):
        return ()
    if text == "all":
        return known_hazards()
    return LAV_HAZARDS if text == "lav" else tuple(dict.fromkeys(part.strip() for part in text.split(",")))


def hazards_along(
    town: TownMap, route: Route, kinds: Sequence[str], per_km: float, draws: Draws
) -> tuple[ScenarioSpec, ...]:
    """At most one hazard on each stretch of a route, its type drawn from those that fit somewhere on it.

    Args:
        town: Where.
        route: What is driven.
        kinds: Types to draw from.
        per_km: Stretches in a kilometre of route.
        draws: Of this drive.

    Source: LAV's collector draws one of the possible hazards at each trigger point (reference `lav.md` 3.6).
    """
    if not kinds or per_km <= 0.0:
        return ()
    ends = np.arange(AFTER_START, route.length - BEFORE_END + 1e-9, 1000.0 / per_km)
    found: list[ScenarioSpec] = []
    for number, begin in enumerate(ends.tolist()):
        own = draws.stream("stretch", number)
        stop = min(begin + 1000.0 / per_km, route.length - BEFORE_END)
        places = np.searchsorted(route.distance, own.uniform(0, _PLACES, begin, stop)).tolist()
        for kind in (kinds[k] for k in own.permutation(1, len(kinds)).tolist()):
            name = f"{kind}_{len(found) + 1}"
            fits = (suggestion(town, route, place, kind, generation_of(kind), name) for place in places)
            chosen = next((hazard for hazard in fits if hazard is not None), None)
            if chosen is not None:
                found.append(chosen.spec)
                break
    return tuple(found)
