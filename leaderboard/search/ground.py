"""The route on which a hazard is searched or certified, and the hazard with other values on it."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from lavsim.errors import LavsimError, RouteError, ScenarioError
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.scenarios.base import ScenarioSpec, make_scenario
from lavsim.scenarios.director import trigger_index
from lavsim.scenarios.place import Site
from lavsim.world.weather import Weather, WeatherKeyframe
from leaderboard.hazard_file import THROUGH_TRAFFIC, TRAFFIC
from leaderboard.hazard_maker import find_type, stands
from leaderboard.route_maker import entry_of
from leaderboard.route_writer import number, write_routes
from leaderboard.routes import RouteEntry, read_routes, select_routes
from leaderboard.search.ranges import TRIGGER

RULES = {"1.0": "1.0", "2.x": "2.1"}  # what a hazard of a generation is judged by unless told otherwise
WEATHER = Weather(cloudiness=5.0, sun_altitude_angle=70.0)


@dataclass(frozen=True)
class Ground:
    """A route with one hazard, exactly as a route file holds it.

    Attributes:
        entry: The route; its hazard is the only one.
        town: Its town.
        route: The dense route.
    """

    entry: RouteEntry
    town: TownMap
    route: Route

    @staticmethod
    def of(entry: RouteEntry, spec: ScenarioSpec, town_path: tuple[Path, ...] = ()) -> Ground:
        """The ground of `entry` with `spec` alone; traffic that the file leaves to the rules is theirs.

        Raises:
            LavsimError: no such town, or no route through the waypoints.
        """
        alone = replace(entry, scenarios=(spec,), traffic=entry.traffic or "leaderboard")
        kept = as_written(alone)
        town = load_town(kept.town, town_path)
        return Ground(kept, town, get_planner(town).trace(kept.keypoints))

    @property
    def hazard(self) -> ScenarioSpec:
        """The hazard with the route file's own values."""
        return self.entry.scenarios[0]

    def with_values(self, values: Mapping[str, float | str], route_id: str) -> RouteEntry:
        """The route, called `route_id`, with `values` in place of the hazard's own."""
        spec = self.hazard
        others = {name: value for name, value in values.items() if name != TRIGGER}
        spec = replace(spec, parameters={**spec.parameters, **others})
        if TRIGGER in values:
            spec = replace(spec, trigger=self._shifted(float(values[TRIGGER])))
        return replace(self.entry, id=route_id, scenarios=(spec,))

    def refusal(self, entry: RouteEntry) -> str | None:
        """Why the hazard of `entry` can't stand on this route; None when it can."""
        spec = entry.scenarios[0]
        try:
            scenario = make_scenario(spec)
            index = trigger_index(self.route, spec)
            return (
                "its trigger is off the route" if index is None else scenario.fits(Site(self.town, self.route, index))
            )
        except LavsimError as error:
            return str(error)

    def _shifted(self, metres: float) -> tuple[float, float, float, float]:
        """The hazard's trigger moved along the route, as a route file holds it."""
        route, index = self.route, trigger_index(self.route, self.hazard)
        if index is None:
            raise ScenarioError(f"{self.entry.source}: the trigger of {self.hazard.name} is off the route.")
        at = float(np.clip(route.distance[index] + metres, 0.0, route.length))
        index = min(int(np.searchsorted(route.distance, at)), len(route) - 1)
        x, y, z = (float(number(v)) for v in route.points[index].tolist())
        return x, y, z, math.radians(float(number(math.degrees(float(route.yaw[index])) % 360.0)))


def as_written(entry: RouteEntry) -> RouteEntry:
    """`entry` as it is read from a route file that holds it: rounded to the millimetre.

    Raises:
        RouteError: a hazard has parameters that our route files can't hold.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / (entry.file or "route.xml")
        try:
            path.write_bytes(write_routes([entry], entry.traffic))
        except (TypeError, ValueError):
            raise RouteError(f"{entry.source}: a hazard has parameters that a route file can't hold.") from None
        return read_routes(path)[0]


def find_ground(
    kind: str, routes: str = "hazards", route_id: str | None = None, town: str = "", town_path: tuple[Path, ...] = ()
) -> Ground:
    """The ground for a type: the first route of a file that has it, or the first place of a town.

    Args:
        kind: "Accident" or "1.0:Scenario3".
        routes: A route file.
        route_id: Of the route in it; None: the first with the type.
        town: Where to look for a place instead; empty: in the file.
        town_path: Folders with towns.

    Raises:
        LavsimError: no such type, file, route or town, or none with a place for it.
    """
    generation, name = find_type(kind)
    if town:
        return _in_town(town, generation, name, town_path)
    for entry in select_routes(read_routes(routes), route_id):
        for spec in entry.scenarios:
            if (spec.generation, spec.type) == (generation, name):
                return Ground.of(entry, spec, town_path)
    where = f"route {route_id} of {routes}" if route_id is not None else routes
    raise RouteError(f"{where} has no hazard of type {name}; --town finds a place for it in a town.")


def all_grounds(
    entries: Sequence[RouteEntry], kinds: Sequence[tuple[str, str]] | None, town_path: tuple[Path, ...] = ()
) -> list[Ground]:
    """A ground for each hazard of the routes, of `kinds` (generation, type) alone if given."""
    return [
        Ground.of(entry, spec, town_path)
        for entry in entries
        for spec in entry.scenarios
        if kinds is None or (spec.generation, spec.type) in kinds
    ]


def _in_town(name: str, generation: str, kind: str, town_path: tuple[Path, ...]) -> Ground:
    town = load_town(name, town_path)
    stand = next(islice(stands(town, kind, generation), 1), None)
    if stand is None:
        raise RouteError(f"{name} has no place for {kind} among the ways that were tried.")
    entry = entry_of(town, "0", stand.route.keypoints, (WeatherKeyframe(0.0, WEATHER),))
    traffic = "lav" if kind in THROUGH_TRAFFIC else TRAFFIC
    return Ground.of(replace(entry, traffic=traffic), stand.spec, town_path)
