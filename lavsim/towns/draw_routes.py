"""Draws the bundled route files: `python -m lavsim.towns.draw_routes` writes them into the `routes` package.

A route is a list of streets of a bundled town, driven from somewhere on the first to somewhere on the last. Hazards
are set where they can be met fairly: on a straight piece, well after the start and well before the next junction.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from lxml import etree

from lavsim.errors import RouteError
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap, Waypoint, load_town

AFTER_START = 50.0  # [m] before a hazard's trigger
BEFORE_JUNCTION = 60.0  # [m] behind it
APART = 120.0  # [m] between two hazards
WALKER_AHEAD = 25.0  # [m] from the trigger to the walker
STRAIGHT = 40.0  # [m] of straight street from the trigger on
STRAIGHT_CURVATURE = 1e-3  # [1/m]

# CARLA's presets where they exist; azimuth and altitude of the sun [deg], the rest in percent.
WEATHERS: dict[str, dict[str, float]] = {
    "clear noon": {"cloudiness": 5, "sun_azimuth_angle": 45, "sun_altitude_angle": 70},
    "cloudy": {"cloudiness": 60, "wind_intensity": 20, "sun_azimuth_angle": 300, "sun_altitude_angle": 45},
    "wet noon": {"cloudiness": 20, "precipitation_deposits": 50, "wetness": 40, "sun_altitude_angle": 60},
    "soft rain": {
        "cloudiness": 70, "precipitation": 30, "precipitation_deposits": 40, "wetness": 50, "sun_altitude_angle": 50,
    },
    "hard rain": {
        "cloudiness": 100, "precipitation": 80, "precipitation_deposits": 90, "wind_intensity": 60, "wetness": 100,
        "fog_density": 7, "sun_altitude_angle": 40,
    },
    "sunset": {"cloudiness": 10, "sun_azimuth_angle": 270, "sun_altitude_angle": 12},
    "fog": {"cloudiness": 80, "fog_density": 30, "fog_distance": 20, "wetness": 20, "sun_altitude_angle": 30},
}  # fmt: skip


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


FILES: dict[str, tuple[str, tuple[RouteSketch, ...]]] = {
    "quick": (
        "eu_small_a",
        (
            RouteSketch(
                ("Harbour Wall", "Bridge Street", "Orchard Street", "High Street"),
                0.22, 0.85, ("right",), ("clear noon", "clear noon"),
            ),
            RouteSketch(
                ("North Wall", "Library Street", "Theatre Street", "Garden Street"),
                0.3, 0.6, ("right",), ("cloudy", "soft rain"),
            ),
        ),
    ),
    "devtest": (
        "eu_small_a",
        (
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
                ("North West Wall", "High Street West", "Orchard Street", "Bridge Street", "South Wall",
                 "Station Street"),
                0.15, 0.6, ("right", "right"), ("soft rain", "hard rain"),
            ),
        ),
    ),
}  # fmt: skip


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


def keypoints_of(town: TownMap, sketch: RouteSketch) -> list[Waypoint]:
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


def hazard_places(town: TownMap, route: Route, count: int) -> list[int]:
    """Route points at which hazards may be triggered.

    Raises:
        RouteError: the route has fewer such places.
    """
    junction = town.lanes.junction[route.lane] >= 0
    curvature = np.abs(town.centre(route.lane, route.u)[:, 4])
    found: list[int] = []
    for k in range(len(route)):
        here = route.distance[k]
        if here < (route.distance[found[-1]] + APART if found else AFTER_START):
            continue
        ahead = (route.distance >= here) & (route.distance <= here + BEFORE_JUNCTION)
        bend = (route.distance >= here) & (route.distance <= here + STRAIGHT)
        fair = route.length - here > BEFORE_JUNCTION and not junction[ahead].any()
        if fair and curvature[bend].max() < STRAIGHT_CURVATURE:
            found.append(k)
    if len(found) < count:
        raise RouteError(f"the route has room for {len(found)} hazards, not {count}.")
    return found[:count]


def _number(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def draw_route(town: TownMap, number: int, sketch: RouteSketch) -> etree._Element:
    """The `route` element of a sketch."""
    places = keypoints_of(town, sketch)
    points = np.array([place.xyz for place in places])
    route = get_planner(town).trace(points)
    element = etree.Element("route", id=str(number), town=town.name)
    weathers = etree.SubElement(element, "weathers")
    for percentage, name in zip((0, 100), sketch.weather, strict=True):
        values = {key: f"{value:g}" for key, value in WEATHERS[name].items()}
        etree.SubElement(weathers, "weather", {"route_percentage": str(percentage), **values})
    waypoints = etree.SubElement(element, "waypoints")
    for x, y, z in points:
        etree.SubElement(waypoints, "position", x=_number(x), y=_number(y), z=_number(z))
    scenarios = etree.SubElement(element, "scenarios")
    for k, (at, side) in enumerate(zip(hazard_places(town, route, len(sketch.hazards)), sketch.hazards, strict=True)):
        kind = "DynamicObjectCrossing"
        scenario = etree.SubElement(scenarios, "scenario", name=f"{kind}_{k + 1}", type=kind)
        x, y, z = route.points[at]
        yaw = float(np.degrees(route.yaw[at]) % 360.0)
        etree.SubElement(
            scenario, "trigger_point", x=_number(x), y=_number(y), z=_number(z), yaw=_number(yaw)
        )  # fmt: skip
        etree.SubElement(scenario, "distance", value=f"{WALKER_AHEAD:g}")
        etree.SubElement(scenario, "direction", value=side)
    return element


def draw_file(town: TownMap, sketches: Sequence[RouteSketch]) -> bytes:
    """A 2.x route file."""
    root = etree.Element("routes", traffic="lav")
    for number, sketch in enumerate(sketches):
        root.append(draw_route(town, number, sketch))
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def main(folder: Path | None = None) -> None:
    """Writes every route file into `folder`, by default the `routes` package."""
    folder = folder or Path(str(resources.files("routes")))
    for name, (town, sketches) in FILES.items():
        (folder / f"{name}.xml").write_bytes(draw_file(load_town(town), sketches))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
