"""Scenario files of 1.0: which of their hazards a route meets, and which of those are set up.

The choice is the original's to the draw (reference `leaderboard.md` 3.2): where several hazards share a trigger the
highest number wins; where a chosen one stands on another's place, others of its region are drawn from numpy's legacy
generator with seed 0, as there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.errors import RouteError
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import ScenarioSpec
from lavsim.types import RoadOption
from leaderboard.routes import RouteEntry

REACH = 2.0  # [m] of a trigger from the route, of triggers of one region, and of places that collide
TURN = math.radians(10.0)
SEED = 0
_ON = (RoadOption.LANEFOLLOW, RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)
_TURNS = {RoadOption.LEFT: "left", RoadOption.RIGHT: "right", RoadOption.STRAIGHT: "opposite"}
# What the route must do at the next junction, where a hazard asks for a turn; others are always valid.
_WAYS: Mapping[str, tuple[RoadOption, ...]] = {
    "Scenario4": (RoadOption.LEFT, RoadOption.RIGHT),
    "Scenario7": (RoadOption.LEFT, RoadOption.RIGHT, RoadOption.STRAIGHT),
    "Scenario8": (RoadOption.LEFT,),
    "Scenario9": (RoadOption.RIGHT,),
}

Place = tuple[float, float, float, float]  # x, y, z [m], yaw [rad]


@dataclass(frozen=True)
class Candidate:
    """A hazard that a scenario file offers.

    Attributes:
        type: "Scenario3".
        trigger: Where it is set off.
        others: Places of other actors by the side they come from; empty where the file names none.
        way: What the route does at the next junction, for hazards that ask.
    """

    type: str
    trigger: Place
    others: Mapping[str, tuple[Place, ...]]
    way: str | None = None

    @property
    def number(self) -> int:
        """Its rank among hazards that share a trigger."""
        digits = self.type.removeprefix("Scenario")
        return int(digits) if digits.isdigit() else -1

    @property
    def places(self) -> list[Place]:
        """Where its trigger and its actors are."""
        return [self.trigger, *(place for places in self.others.values() for place in places)]


def read_scenarios(path: Path) -> dict[str, list[Candidate]]:
    """The hazards of the file at `path` by town, in file order.

    Raises:
        RouteError: it can't be read, or is no scenario file; the message says where in it.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise RouteError(f"can't read the scenario file {path}: {error}") from None
    except json.JSONDecodeError as error:
        raise RouteError(f"{path.name}, line {error.lineno}: {error.msg}") from None
    found: dict[str, list[Candidate]] = {}
    try:
        for towns in content["available_scenarios"]:
            for town, kinds in towns.items():
                found.setdefault(town, []).extend(_candidates(kinds, f"{path.name}, {town}"))
    except (KeyError, TypeError, AttributeError) as error:
        raise RouteError(f"{path.name} is no scenario file of the leaderboard: {error!r}") from None
    return found


def with_scenarios(
    entries: Sequence[RouteEntry], offered: Mapping[str, Sequence[Candidate]], town_path: Sequence[Path] = ()
) -> list[RouteEntry]:
    """The routes with the hazards they meet, after those they have.

    Args:
        entries: The routes.
        offered: Hazards by town, from `read_scenarios`.
        town_path: Folders with towns.
    """
    result = []
    for entry in entries:
        specs: list[ScenarioSpec] = []
        if offered.get(entry.town):
            route = get_planner(load_town(entry.town, tuple(town_path))).trace(entry.keypoints)
            specs = choose(offered[entry.town], route)
        result.append(replace(entry, scenarios=(*entry.scenarios, *specs)))
    return result


def choose(candidates: Sequence[Candidate], route: Route) -> list[ScenarioSpec]:
    """The hazards set up on `route`, in the order in which their regions were opened."""
    regions: list[list[Candidate]] = []
    for candidate in candidates:
        met = _match(candidate, route)
        if met is not None:
            region = next((r for r in regions if _same_trigger(r[0].trigger, met.trigger)), None)
            if region is None:
                regions.append([met])
            else:
                region.append(met)
    generator = np.random.RandomState(SEED)
    chosen: list[Candidate] = []
    for region in regions:
        choice = _choose(region, chosen, generator)
        if choice is not None:
            chosen.append(choice)
    return [_spec(candidate, number) for number, candidate in enumerate(chosen)]


def _match(candidate: Candidate, route: Route) -> Candidate | None:
    """The candidate as `route` meets it; None where it does not."""
    x, y, z, yaw = candidate.trigger
    near = np.linalg.norm(route.points - (x, y, z), axis=1) < REACH
    turned = np.abs(np.mod(route.yaw - yaw + np.pi, 2.0 * np.pi) - np.pi) < TURN
    found = np.flatnonzero(near & turned)
    if not len(found):
        return None
    ways = _WAYS.get(candidate.type)
    if ways is None:
        return candidate
    ahead = (RoadOption(int(value)) for value in route.command[found[0] :])
    way = next((option for option in ahead if option not in _ON), None)
    return replace(candidate, way=_TURNS[way]) if way is not None and way in ways else None


def matches(candidate: Candidate, route: Route) -> bool:
    """Whether `route` meets the candidate, and turns at the next junction as it asks."""
    return _match(candidate, route) is not None


def _same_trigger(first: Place, second: Place) -> bool:
    apart = math.hypot(first[0] - second[0], first[1] - second[1])
    return apart < REACH and abs(math.remainder(first[3] - second[3], 2.0 * math.pi)) < TURN


def _choose(region: Sequence[Candidate], chosen: Sequence[Candidate], generator: Any) -> Candidate | None:
    """Who of `region` is set up: the highest number, the last among equals, unless its place is taken."""
    left = list(region)
    choice = max(reversed(left), key=lambda candidate: candidate.number)
    left.remove(choice)
    while _is_taken(choice, chosen):
        if not left:
            return None
        choice = left.pop(int(generator.randint(0, len(left))))
    return choice


def _is_taken(choice: Candidate, chosen: Sequence[Candidate]) -> bool:
    return any(
        math.dist(place[:3], other[:3]) < REACH
        for candidate in chosen
        for place in choice.places
        for other in candidate.places
    )


def _spec(candidate: Candidate, number: int) -> ScenarioSpec:
    parameters: dict[str, Any] = {}
    if candidate.way is not None:
        parameters["way"] = candidate.way
    if candidate.others:
        parameters["other_actors"] = {side: [list(p) for p in places] for side, places in candidate.others.items()}
    return ScenarioSpec(f"{candidate.type}_{number}", candidate.type, "1.0", candidate.trigger, parameters)


def _candidates(kinds: Sequence[Mapping[str, Any]], where: str) -> Iterator[Candidate]:
    for kind in kinds:
        name = str(kind["scenario_type"])
        for number, configuration in enumerate(kind["available_event_configurations"]):
            here = f"{where}, {name} {number}"
            others = configuration.get("other_actors") or {}
            yield Candidate(
                name,
                _place(configuration["transform"], here),
                {side: tuple(_place(actor, here) for actor in actors) for side, actors in others.items()},
            )


def _place(transform: Mapping[str, Any], where: str) -> Place:
    """Numbers stand in the file as texts."""
    try:
        x, y, z, yaw = (float(transform[name]) for name in ("x", "y", "z", "yaw"))
    except (KeyError, TypeError, ValueError) as error:
        raise RouteError(f"{where}: a transform needs the numbers x, y, z, yaw: {error!r}") from None
    if not all(map(math.isfinite, (x, y, z, yaw))):
        raise RouteError(f"{where}: a transform's x, y, z, yaw must be finite")
    return x, y, z, math.radians(yaw)
