"""Where on a route hazards can stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lavsim.errors import ConfigError, ScenarioError
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.scenarios.base import SCENARIOS, ScenarioSpec
from lavsim.scenarios.place import Site


@dataclass(frozen=True)
class Suggestion:
    """A place for a hazard.

    Attributes:
        index: Point of the route at its trigger.
        spec: The hazard as a route file has it.
    """

    index: int
    spec: ScenarioSpec


def fits_at(town: TownMap, route: Route, index: int, kind: str, generation: str = "2.x") -> str | None:
    """Why a hazard of type `kind` should not be set off at point `index` of `route`; None when it may.

    Raises:
        UnknownName: no such hazard.
    """
    return None if parameters_at(town, route, index, kind, generation) is not None else "no room for it there"


def parameters_at(
    town: TownMap, route: Route, index: int, kind: str, generation: str = "2.x"
) -> Mapping[str, Any] | None:
    """Parameters with which a hazard can be set off at point `index` of `route`; None where it can't."""
    try:
        return SCENARIOS[generation, kind].suggest(Site(town, route, index))
    except (ConfigError, ScenarioError, TypeError):  # a type whose parameters have no defaults and that finds none
        return None


def suggestion(town: TownMap, route: Route, index: int, kind: str, generation: str, name: str) -> Suggestion | None:
    """The hazard `name` at point `index` of `route`; None where it can't stand."""
    parameters = parameters_at(town, route, index, kind, generation)
    if parameters is None:
        return None
    x, y, z = route.points[index].tolist()
    trigger = (x, y, z, float(route.yaw[index]))
    return Suggestion(index, ScenarioSpec(name, kind, generation, trigger, parameters))
