"""Which hazards can be set before the ego now, and where."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, cast

import numpy as np

from lavsim.scenarios.base import SCENARIOS, ScenarioSpec
from lavsim.scenarios.director import trigger_index
from lavsim.scenarios.suggest import Suggestion, suggestion

if TYPE_CHECKING:
    from lavsim.map.route import Route
    from lavsim.map.town_map import TownMap

GENERATION = "2.x"
_REACH = (12.0, 160.0, 8.0)  # [m] ahead of the ego: from, to, step
_LEAD = 1.5  # [s] of the ego's way added to the nearest place
_SAME = 5  # route points between a place and where the director finds its trigger again


def kinds() -> list[str]:
    """Types of hazards that can be set under way."""
    keys = cast(Iterable[tuple[str, str]], SCENARIOS)
    found = [kind for generation, kind in keys if generation == GENERATION]
    known = ((kind, SCENARIOS[GENERATION, kind]) for kind in found)
    return sorted(kind for kind, scenario in known if scenario.acts and not scenario.starts_route)


def next_place(town: TownMap, route: Route, metres: float, speed: float, kind: str, name: str) -> Suggestion | None:
    """The nearest place ahead for a hazard of type `kind`; None where there is none.

    Args:
        town: Where.
        route: What is driven.
        metres: How far along it the ego is.
        speed: Of the ego [m/s].
        kind: The type.
        name: The hazard's name.

    Raises:
        UnknownName: no such type.
    """
    for index in _places(route, metres + _LEAD * max(speed, 0.0)):
        found = suggestion(town, route, index, kind, GENERATION, name)
        if found is not None and _is_met_at(route, found.spec, index):
            return found
    return None


def _places(route: Route, metres: float) -> Iterator[int]:
    first, last, step = _REACH
    for ahead in np.arange(first, last, step):
        if metres + ahead > route.length - step:
            return
        yield int(np.searchsorted(route.distance, metres + ahead))


def _is_met_at(route: Route, spec: ScenarioSpec, index: int) -> bool:
    """Whether the trigger is found there again, and not where the route passed before."""
    found = trigger_index(route, spec)
    return found is not None and abs(found - index) <= _SAME
