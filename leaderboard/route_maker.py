"""Makes routes through a town: random ways, of which those are kept that show the most of it.

A way goes from lane to lane as the lanes lead, takes a random branch at each crossing, and changes lanes here and there
where the marks allow it. It never drives a lane twice. Of many ways the next route is always the one with the most
lanes and commands that the routes before it lack, so that a few routes see most of a town; their lengths spread over
what is wished. Everything follows from the town and the seed.

Hazards are set where they can be met fairly: on a straight piece of a street with at most 60 km/h, in the lane beside
the kerb, 50 m after the start or later and 60 m before a junction.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, LavsimError, RouteError
from lavsim.map.planner import RoutePlanner, get_planner
from lavsim.map.route import Route
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.scenarios.base import ScenarioSpec, make_scenario
from lavsim.scenarios.place import Site
from lavsim.types import LaneType, RoadOption
from lavsim.world.weather import Weather, WeatherKeyframe
from leaderboard.route_check import detours
from leaderboard.routes import RouteEntry

AFTER_START = 50.0  # [m] before a hazard's trigger
BEFORE_JUNCTION = 60.0  # [m] behind it
APART = 120.0  # [m] between two hazards
WALKER_AHEAD = 25.0  # [m] from the trigger to the walker
STRAIGHT = 40.0  # [m] of straight street from the trigger on
STRAIGHT_CURVATURE = 1e-3  # [1/m]
HAZARD_SPEED = 60.0 / 3.6  # [m/s] walkers don't step onto faster roads
HAZARD_SPACING = 500.0  # [m] of route for each hazard
MOST_HAZARDS = 3
HAZARD = "DynamicObjectCrossing"

FROM_END = 12.0  # [m] of the first and last lane that start and goal keep clear of
CHANGE_LANE = 60.0  # [m] shortest lane on which lanes are changed
CHANGE_CHANCE = 0.35
LENGTHS = 4  # classes of length that routes are made of in turn
WAYS_A_ROUTE = 200  # ways to choose each route from
LONGEST_WAY = 500  # lanes


def _weather(
    clouds: float = 30.0, rain: float = 0.0, puddles: float = 0.0, wet: float = 0.0, sun: float = 70.0, **more: float
) -> Weather:
    return Weather(
        cloudiness=clouds,
        precipitation=rain,
        precipitation_deposits=puddles,
        wetness=wet,
        sun_altitude_angle=sun,
        **more,
    )


# In the manner of CARLA's presets.
WEATHERS: Mapping[str, Weather] = {
    "clear noon": _weather(5, sun_azimuth_angle=45),
    "cloudy": _weather(60, sun=45, wind_intensity=20, sun_azimuth_angle=300),
    "wet noon": _weather(20, puddles=50, wet=40, sun=60),
    "soft rain": _weather(70, 30, 40, 50, 50),
    "hard rain": _weather(100, 80, 90, 100, 40, wind_intensity=60, fog_density=7),
    "sunset": _weather(10, sun=12, sun_azimuth_angle=270),
    "fog": _weather(80, wet=20, sun=30, fog_density=30, fog_distance=20),
    "clear night": _weather(5, sun=-40, sun_azimuth_angle=120),
}


@dataclass(frozen=True)
class RouteWish:
    """What a set of routes through one town shall be like.

    Attributes:
        count: Routes.
        shortest, longest: Along the dense route [m].
        seed: Of everything that is drawn.
        most_stops: Stop signs on a route; None: any number.
        weathers: Names in `WEATHERS` of the weather at the start and at the end; one pair is drawn for each route.
    """

    count: int
    shortest: float = 500.0
    longest: float = 2000.0
    seed: int = 0
    most_stops: int | None = None
    weathers: Sequence[tuple[str, str]] = tuple((a, b) for a in WEATHERS for b in WEATHERS)

    def __post_init__(self) -> None:
        if not 1 <= self.count <= 1000:
            raise ConfigError(f"count must lie in 1 to 1000, got {self.count}.")
        if not 50.0 <= self.shortest <= self.longest:
            raise ConfigError(f"length must be at least 50 m and rise, got {self.shortest:g}-{self.longest:g} [m].")


@dataclass(frozen=True)
class Way:
    """A way over lanes.

    Attributes:
        lanes: In the order they are driven; a lane change goes to the neighbour.
        places: (lane, u) to pass: start, one on each road, two at a lane change, goal.
        length: About [m].
    """

    lanes: tuple[int, ...]
    places: tuple[tuple[int, float], ...]
    length: float


def make_routes(town: TownMap, wish: RouteWish, first_id: int = 0) -> list[RouteEntry]:
    """Routes through a town, with hazards where they fit.

    Raises:
        RouteError: the town has too few ways of that length.
    """
    planner, draws = get_planner(town), Draws.of_seed(wish.seed).stream(f"routes of {town.name}")
    ways = list(random_ways(town, wish, draws, WAYS_A_ROUTE * wish.count))
    seen: set[int] = set()
    told: Counter[RoadOption] = Counter()
    entries: list[RouteEntry] = []
    while len(entries) < wish.count:
        if not ways:
            raise RouteError(
                f"{town.name} has ways for {len(entries)} routes of {wish.shortest:g} to {wish.longest:g} m, "
                f"not for {wish.count}."
            )
        fitting = _of_length(ways, wish, len(entries))
        way = ways.pop(max(fitting, key=lambda k: _worth(town, ways[k], seen, told)))
        route = driven_way(town, planner, way, wish)
        if route is None:
            continue
        seen.update(way.lanes)
        told.update({option for option, _ in route.commands()})
        number = first_id + len(entries)
        pair = wish.weathers[draws.stream("weather").integer(0, len(wish.weathers), len(entries))]
        frames = tuple(WeatherKeyframe(at, WEATHERS[name]) for at, name in zip((0.0, 100.0), pair, strict=True))
        entry = entry_of(town, str(number), route.keypoints, frames)
        count = max(1, min(round(route.length / HAZARD_SPACING), MOST_HAZARDS))
        entries.append(with_hazards(town, entry, count, draws.stream("hazards", len(entries))))
    return entries


def _of_length(ways: Sequence[Way], wish: RouteWish, number: int) -> list[int]:
    """The ways that are about as long as route `number` shall be; all of them if there are none."""
    parts = min(wish.count, LENGTHS)
    step = (wish.longest - wish.shortest) / parts
    low = wish.shortest + (number % parts) * step
    return [k for k, way in enumerate(ways) if low <= way.length <= low + step] or list(range(len(ways)))


def entry_of(
    town: TownMap, route_id: str, keypoints: NDArray[np.float64], weather: tuple[WeatherKeyframe, ...]
) -> RouteEntry:
    """A route without hazards."""
    return RouteEntry(
        id=route_id,
        town=town.name,
        keypoints=keypoints,
        weather=weather,
        scenarios=(),
        generation="2.x",
        traffic=None,
        file="",
        line=0,
    )


def with_hazards(town: TownMap, entry: RouteEntry, count: int, draws: Draws) -> RouteEntry:
    """The route with up to `count` walkers that step out; one in four comes from the left, where that is the kerb."""
    route = get_planner(town).trace(entry.keypoints)
    specs: list[ScenarioSpec] = []
    for at in hazard_places(town, route):
        if len(specs) == count:
            break
        one_lane = town.lanes.left[route.lane[at]] < 0
        from_left = one_lane and draws.uniform(len(specs), 1)[0] < 0.25
        spec = hazard_spec(route, at, len(specs) + 1, "left" if from_left else "right")
        if make_scenario(spec).fits(Site(town, route, at)) is None:
            specs.append(spec)
    return replace(entry, scenarios=tuple(specs))


def hazard_spec(route: Route, at: int, number: int, side: str) -> ScenarioSpec:
    """A walker that waits `WALKER_AHEAD` beyond a route point."""
    x, y, z = route.points[at].tolist()
    return ScenarioSpec(
        name=f"{HAZARD}_{number}",
        type=HAZARD,
        generation="2.x",
        trigger=(x, y, z, float(route.yaw[at])),
        parameters={"distance": WALKER_AHEAD, "direction": side},
    )


def hazard_places(town: TownMap, route: Route) -> list[int]:
    """Route points at which hazards may be triggered, far enough apart."""
    lanes = town.lanes
    junction = lanes.junction[route.lane] >= 0
    curvature = np.abs(town.centre(route.lane, route.u)[:, 4])
    slow = lanes.speed_limit[route.lane] <= HAZARD_SPEED + 0.01
    outer = lanes.right[route.lane] < 0
    changing = np.isin(route.command, (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT))
    steady = slow & outer & ~changing
    found: list[int] = []
    for k in range(len(route)):
        here = route.distance[k]
        if here < (route.distance[found[-1]] + APART if found else AFTER_START):
            continue
        if route.length - here <= BEFORE_JUNCTION:
            break
        ahead = (route.distance >= here) & (route.distance <= here + BEFORE_JUNCTION)
        bend = (route.distance >= here) & (route.distance <= here + STRAIGHT)
        if not junction[ahead].any() and steady[bend].all() and curvature[bend].max() < STRAIGHT_CURVATURE:
            found.append(k)
    return found


def stop_signs_on(town: TownMap, lanes: Sequence[int]) -> int:
    """Stop signs that a way over `lanes` must obey."""
    driven = set(lanes)
    return sum(1 for sign in town.signs if sign.kind == "stop" and driven & set(sign.lanes))


def random_ways(town: TownMap, wish: RouteWish, draws: Draws, tries: int) -> Iterator[Way]:
    """Random ways about as long as wished, from up to `tries` starts; some starts lead nowhere."""
    lanes = town.lanes
    starts = lanes.where(int(LaneType.DRIVING))
    starts = starts[(lanes.junction[starts] < 0) & (lanes.length[starts] > 3.0 * FROM_END)]
    if not len(starts):
        return
    edges = np.cumsum(lanes.length[starts])
    for number in range(tries):
        dice = iter(draws.stream("way", number).uniform(0, 3 * LONGEST_WAY).tolist())
        lane = int(starts[min(int(np.searchsorted(edges, next(dice) * edges[-1])), len(starts) - 1)])
        wanted = wish.shortest + next(dice) * (wish.longest - wish.shortest)
        way = _way(town, lane, wanted, dice)
        if way is not None and (wish.most_stops is None or stop_signs_on(town, way.lanes) <= wish.most_stops):
            yield way


def _way(town: TownMap, lane: int, wanted: float, dice: Iterator[float]) -> Way | None:
    """A random way of about `wanted` metres from somewhere on `lane`; None where it runs into a dead end."""
    lanes = town.lanes
    u = FROM_END + next(dice) * (float(lanes.length[lane]) - 2.0 * FROM_END)
    way, places, driven = [lane], [(lane, u)], float(lanes.length[lane]) - u
    passed = True  # a place on this road is among `places`
    while driven < wanted or lanes.junction[lane] >= 0 or lanes.length[lane] < 3.0 * FROM_END:
        following = [k for k in lanes.successors(lane).tolist() if k not in way and lanes.type[k] & LaneType.DRIVING]
        if not following or len(way) >= LONGEST_WAY:
            return None
        lane = following[min(int(next(dice) * len(following)), len(following) - 1)]
        way.append(lane)
        length = float(lanes.length[lane])
        driven += length
        if lanes.junction[lane] >= 0:
            passed = False
            continue
        beside = [
            int(k)
            for k, allowed in (
                (lanes.left[lane], lanes.change_left[lane]),
                (lanes.right[lane], lanes.change_right[lane]),
            )
            if k >= 0 and allowed and k not in way and len(lanes.successors(int(k)))
        ]
        if beside and length >= CHANGE_LANE and next(dice) < CHANGE_CHANCE:
            other = beside[min(int(next(dice) * len(beside)), len(beside) - 1)]
            places += [(lane, 0.3 * length), (other, 0.7 * float(lanes.length[other]))]
            lane, passed = other, True
            way.append(lane)
        elif not passed and length >= FROM_END:
            places.append((lane, 0.5 * length))
            passed = True
    goal = (lane, float(lanes.length[lane]) - FROM_END)
    while places and places[-1][0] == lane and len(places) > 1:
        goal = places.pop()
    return Way(tuple(way), (*places, goal), driven)


def _worth(town: TownMap, way: Way, seen: set[int], told: Counter[RoadOption]) -> float:
    """How much that is new a way shows: kilometres of lanes, and commands that are still rare."""
    length = town.lanes.length
    fresh = sum(float(length[lane]) for lane in way.lanes if lane not in seen)
    commands = {RoadOption(int(town.lanes.turn[lane])) for lane in way.lanes}
    for before, after in pairwise(way.lanes):
        if after == town.lanes.left[before]:
            commands.add(RoadOption.CHANGELANELEFT)
        elif after == town.lanes.right[before]:
            commands.add(RoadOption.CHANGELANERIGHT)
    rare = sum(1.0 / (1 + told[command]) for command in commands)
    return fresh / 1000.0 + 0.2 * rare


def driven_way(town: TownMap, planner: RoutePlanner, way: Way, wish: RouteWish) -> Route | None:
    """The way as CARLA's planner drives its places; None if it is not the same way or not as long as wished."""
    try:
        route = planner.trace(np.round([town.waypoint_at(lane, u).xyz for lane, u in way.places], 3))
    except LavsimError:
        return None
    order = [int(route.lane[0])] + [int(b) for a, b in pairwise(route.lane.tolist()) if a != b]
    if len(set(order)) != len(order) or not set(order) <= set(way.lanes):
        return None
    if detours(planner, route.keypoints) or not wish.shortest <= route.length <= wish.longest:
        return None
    return route
