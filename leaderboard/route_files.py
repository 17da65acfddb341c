"""The bundled route files: `python -m leaderboard.route_files [FOLDER]` writes them into the `routes` package.

- `quick`: two routes through eu_small_a, for a first look.
- `devtest`: eight routes of the training towns, for work on an agent.
- `training`: twelve routes through each training town, with the types of hazards of LAV's training.
- `validation`: the protocol of LAV's ablations: two routes through each of the two test towns in four weathers, at
  most one stop sign on a route, with the types of hazards of LAV's evaluation.

The first routes are told as lists of streets, the others are made by `route_maker` from the seeds below. The files
follow from this script and the towns alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np

from lavsim.errors import RouteError
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.map.waypoint import Waypoint
from lavsim.random import Draws
from lavsim.world.weather import Weather, WeatherKeyframe
from leaderboard.hazard_maker import put_hazards
from leaderboard.route_maker import WEATHERS, RouteWish, entry_of, hazard_places, hazard_spec, make_routes
from leaderboard.route_writer import write_routes
from leaderboard.routes import RouteEntry

TRAINING_TOWNS = ("eu_small_a", "us_large_a", "us_large_b", "us_highway")
TEST_TOWNS = {
    "eu_small_b": (800.0, 1050.0),
    "us_large_c": (1200.0, 1600.0),
}  # lengths [m] after LAV's validation routes

# Types of CARLA leaderboard 1.0. Source: LAV's evaluation took the stable scenario file (1, 3, 4), its training the
# larger one.
LAV_EVALUATION = ("Scenario1", "Scenario3", "Scenario4")
LAV_TRAINING = (*LAV_EVALUATION, "Scenario7", "Scenario8", "Scenario9", "Scenario10")
HAZARD_SPACING = 200.0  # [m]


@dataclass(frozen=True)
class RouteSketch:
    """A route as one would tell it.

    Attributes:
        streets: Names of the streets in order.
        start: Share of the first street already behind at the start.
        end: Share of the last street to drive.
        hazards: Walkers that step out, and from which side.
        weather: Names of the weather at the start and at the end.
    """

    streets: tuple[str, ...]
    start: float
    end: float
    hazards: tuple[str, ...]
    weather: tuple[str, str]


QUICK = (
    RouteSketch(
        ("Harbour Wall", "Bridge Street", "Orchard Street", "High Street"),
        0.22, 0.85, ("right",), ("clear noon", "clear noon"),
    ),
    RouteSketch(
        ("North Wall", "Library Street", "Theatre Street", "Garden Street"),
        0.3, 0.6, ("right",), ("cloudy", "soft rain"),
    ),
)  # fmt: skip
DEVTEST = (
    RouteSketch(
        ("Crescent", "Mill Wall", "High Street West", "School Street", "Library Street"),
        0.2, 0.5, ("right",), ("clear noon", "sunset"),
    ),
    RouteSketch(
        ("Vineyard Wall", "East Wall", "Park Lane", "Gallery Street", "High Street"),
        0.35, 0.4, ("right",), ("wet noon", "wet noon"),
    ),
    RouteSketch(
        ("South Wall", "Park Wall", "East Wall", "High Street East", "Garden Street", "Church Street"),
        0.3, 0.6, ("right", "left"), ("cloudy", "fog"),
    ),
    RouteSketch(
        ("North West Wall", "High Street West", "Orchard Street", "Bridge Street", "South Wall", "Station Street"),
        0.15, 0.6, ("right", "right"), ("soft rain", "hard rain"),
    ),
)  # fmt: skip


def _lav(clouds: float, rain: float, puddles: float, wind: float, azimuth: float, altitude: float) -> Weather:
    return Weather(
        cloudiness=clouds,
        precipitation=rain,
        precipitation_deposits=puddles,
        wind_intensity=wind,
        sun_azimuth_angle=azimuth,
        sun_altitude_angle=altitude,
    )


# Source: the validation routes of LAV's release, figures in the order of `_lav`.
LAV_WEATHERS = {
    "ClearNoon": _lav(15, 0, 0, 0.35, 0, 75),
    "CloudySunset": _lav(80, 0, 0, 0.35, 270, 15),
    "SoftRainDawn": _lav(90, 15, 50, 0.35, 315, 5),
    "HardRainNight": _lav(90, 60, 100, 1.0, 225, -80),
}


def quick() -> list[RouteEntry]:
    town = load_town("eu_small_a")
    return [sketched(town, str(k), sketch) for k, sketch in enumerate(QUICK)]


def devtest() -> list[RouteEntry]:
    town = load_town("eu_small_a")
    entries = [sketched(town, str(k), sketch) for k, sketch in enumerate(DEVTEST)]
    for name, count in (("us_large_a", 2), ("us_large_b", 1), ("us_highway", 1)):
        wish = RouteWish(count, shortest=600.0, longest=1500.0, seed=3)
        entries += make_routes(load_town(name), wish, len(entries))
    return entries


def training() -> list[RouteEntry]:
    entries: list[RouteEntry] = []
    for name in TRAINING_TOWNS:
        made = make_routes(load_town(name), RouteWish(12, seed=1), len(entries))
        entries += _with_hazards(made, LAV_TRAINING, seed=1)
    return entries


def validation() -> list[RouteEntry]:
    """Four routes in four weathers: ids 0 to 3 are the first route, 4 to 7 the second …"""
    routes: list[RouteEntry] = []
    for name, (shortest, longest) in TEST_TOWNS.items():
        made = make_routes(load_town(name), RouteWish(2, shortest, longest, seed=2, most_stops=1))
        routes += _with_hazards(made, LAV_EVALUATION, seed=2)
    return [
        replace(entry, id=str(len(LAV_WEATHERS) * k + w), weather=(WeatherKeyframe(0.0, weather),))
        for k, entry in enumerate(routes)
        for w, weather in enumerate(LAV_WEATHERS.values())
    ]


def _with_hazards(entries: Sequence[RouteEntry], types: Sequence[str], seed: int) -> list[RouteEntry]:
    """The routes with hazards of these types of 1.0 in place of their own."""
    kinds = [("1.0", name) for name in types]
    draws = Draws.of_seed(seed).stream("hazards of routes")
    return [put_hazards(load_town(e.town), e, kinds, HAZARD_SPACING, draws.stream(e.town, int(e.id))) for e in entries]


FILES: Mapping[str, Callable[[], list[RouteEntry]]] = {
    "quick": quick,
    "devtest": devtest,
    "training": training,
    "validation": validation,
}


def draw_file(name: str) -> bytes:
    """The bundled route file `name`."""
    return write_routes(FILES[name](), traffic="lav")


def sketched(town: TownMap, route_id: str, sketch: RouteSketch) -> RouteEntry:
    """The route of a sketch.

    Raises:
        RouteError: a street that is not there or not connected, or no room for the hazards.
    """
    keypoints = np.array([place.xyz for place in places_of(town, sketch)])
    frames = tuple(WeatherKeyframe(at, WEATHERS[name]) for at, name in zip((0.0, 100.0), sketch.weather, strict=True))
    entry = entry_of(town, route_id, keypoints, frames)
    route = get_planner(town).trace(keypoints)
    places = hazard_places(town, route)
    if len(places) < len(sketch.hazards):
        raise RouteError(f"the route has room for {len(places)} hazards, not {len(sketch.hazards)}.")
    specs = [hazard_spec(route, places[k], k + 1, side) for k, side in enumerate(sketch.hazards)]
    return replace(entry, scenarios=tuple(specs))


def places_of(town: TownMap, sketch: RouteSketch) -> list[Waypoint]:
    """A place on each street, in the lane that the route drives on."""
    ends = [street_ends(town, name) for name in sketch.streets]
    places = []
    for k, (road, start, end) in enumerate(ends):
        if k + 1 < len(ends):
            forward = end in ends[k + 1][1:]
            if not forward and start not in ends[k + 1][1:]:
                raise RouteError(f"{sketch.streets[k]} does not meet {sketch.streets[k + 1]}.")
        else:
            forward = start in ends[k - 1][1:]
        lane = town.lane_index(road, 0, -1 if forward else 1)
        share = sketch.start if k == 0 else sketch.end if k + 1 == len(ends) else 0.5
        places.append(town.waypoint_at(lane, share * float(town.lanes.length[lane])))
    return places


def street_ends(town: TownMap, name: str) -> tuple[int, int, int]:
    """Road id of a street and the junctions (ids) at its start and end.

    Raises:
        RouteError: the town has no such street.
    """
    for road in town.network.roads:
        if road.name == name and road.junction < 0:
            start, end = road.predecessor, road.successor
            return road.id, start.id if start else -1, end.id if end else -1
    raise RouteError(f"{town.name} has no street {name!r}.")


def main(names: Sequence[str] = (), folder: Path | None = None) -> None:
    """Writes route files into `folder`, by default the `routes` package; all of them by default."""
    folder = folder or Path(str(resources.files("routes")))
    for name in names or FILES:
        (folder / f"{name}.xml").write_bytes(draw_file(name))


if __name__ == "__main__":
    main(folder=Path(sys.argv[1]) if len(sys.argv) > 1 else None)
