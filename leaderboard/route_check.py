"""What is wrong in a route file, in words, without driving it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import LavsimError
from lavsim.map.planner import RoutePlanner, get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.scenarios.base import ScenarioSpec, make_scenario
from lavsim.scenarios.director import trigger_index
from lavsim.scenarios.place import Site
from leaderboard.routes import RouteEntry, read_routes

DETOUR = 3.0  # ways between key points longer than so many times the straight line are worth a word
DETOUR_FROM = 200.0  # [m]
SHORTEST = 30.0  # [m] of a route worth driving
TRIGGER_RADIUS = 2.0  # [m] of a hazard's trigger from the route, else it is ignored


def check_routes(source: str | Path, town_path: Sequence[Path] = ()) -> list[str]:
    """Everything wrong in a route file, a sentence each; empty: it can be driven as it is meant.

    Args:
        source: Name of a packaged file, or a path.
        town_path: Folders with towns.

    Raises:
        RouteError: the file can't be read.
    """
    found: list[str] = []
    for entry in read_routes(source):
        found += [f"{entry.source}: {sentence}" for sentence in check_entry(entry, tuple(town_path))]
    return found


def check_entry(entry: RouteEntry, town_path: tuple[Path, ...] = ()) -> list[str]:
    """Everything wrong with one route."""
    try:
        town = load_town(entry.town, town_path)
        planner = get_planner(town)
        route = planner.trace(entry.keypoints)
    except LavsimError as error:
        return [str(error), *_check_weather(entry)]
    found = _check_way(entry, town, planner, route) + _check_weather(entry)
    names: set[str] = set()
    for spec in entry.scenarios:
        if spec.name in names:
            found.append(f"two scenarios are called {spec.name}.")
        names.add(spec.name)
        found += [f"scenario {spec.name}: {sentence}" for sentence in _check_scenario(spec, town, route)]
    return found


def _check_way(entry: RouteEntry, town: TownMap, planner: RoutePlanner, route: Route) -> list[str]:
    found = []
    if route.length < SHORTEST:
        found.append(f"the way is only {route.length:.1f} m long.")
    places = planner.locate(entry.keypoints)
    for k, place in enumerate(places):
        if place.is_junction:
            found.append(f"{_waypoint(entry, k)} lies inside a junction; CARLA's planner drops the command there.")
    for k in range(len(places) - 1):
        if places[k].lane == places[k + 1].lane and places[k + 1].u < places[k].u - 1.0:
            back = places[k].u - places[k + 1].u
            found.append(f"{_waypoint(entry, k + 1)} lies {back:.1f} m behind waypoint {k} in the same lane.")
    for k, length, straight in detours(planner, entry.keypoints):
        found.append(
            f"from waypoint {k} to {_waypoint(entry, k + 1)} the way is {length:.0f} m long for {straight:.0f} m "
            "of distance; is one of them in the opposite lane?"
        )
    return found


def detours(planner: RoutePlanner, keypoints: NDArray[np.float64]) -> list[tuple[int, float, float]]:
    """Key points (K, 3) from which the way to the next is suspiciously long: index, length, straight line [m]."""
    found = []
    for k in range(len(keypoints) - 1):
        straight = float(np.linalg.norm(keypoints[k + 1] - keypoints[k]))
        length = planner.trace(keypoints[k : k + 2]).length
        if length > max(DETOUR * straight, DETOUR_FROM):
            found.append((k, length, straight))
    return found


def _waypoint(entry: RouteEntry, k: int) -> str:
    x, y, _ = entry.keypoints[k]
    return f"waypoint {k} ({x:.1f}, {y:.1f})"


def _check_weather(entry: RouteEntry) -> list[str]:
    found = []
    for frame in entry.weather:
        if not 0.0 <= frame.percentage <= 100.0:
            found.append(f"route_percentage of a weather must lie in 0 to 100, got {frame.percentage:g}.")
        weather = frame.weather
        for name in (
            "cloudiness",
            "precipitation",
            "precipitation_deposits",
            "wind_intensity",
            "fog_density",
            "wetness",
        ):
            value = getattr(weather, name)
            if not 0.0 <= value <= 100.0:
                found.append(f"{name} of the weather must lie in 0 to 100, got {value:g}.")
        if not -90.0 <= weather.sun_altitude_angle <= 90.0:
            found.append(f"sun_altitude_angle must lie in -90 to 90 [deg], got {weather.sun_altitude_angle:g}.")
    return found


def _check_scenario(spec: ScenarioSpec, town: TownMap, route: Route) -> list[str]:
    try:
        scenario = make_scenario(spec)
    except LavsimError as error:
        return [str(error)]
    x, y, _, yaw = spec.trigger
    at = trigger_index(route, spec)
    if at is None:
        off = np.hypot(route.points[:, 0] - x, route.points[:, 1] - y)
        turned = np.abs(np.mod(route.yaw - yaw + math.pi, 2.0 * math.pi) - math.pi)
        near = off < TRIGGER_RADIUS
        k = int(np.argmin(off))
        if not near[k]:
            why = f"its trigger ({x:.1f}, {y:.1f}) is {off[k]:.1f} m off the route"
        else:
            k = int(np.flatnonzero(near)[np.argmin(turned[near])])
            why = (
                f"its trigger looks to {math.degrees(yaw) % 360.0:.0f} degrees, the route to "
                f"{math.degrees(float(route.yaw[k])) % 360.0:.0f}"
            )
        return [f"{why}; it is ignored."]
    reason = scenario.fits(Site(town, route, at))
    return [] if reason is None else [f"{spec.type} does not fit at ({x:.1f}, {y:.1f}): {reason}."]
