"""One drive of one route: what is in the world, and the order within a tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, UnknownName
from lavsim.map.planner import get_planner
from lavsim.map.rise import pitch_on, rise_along
from lavsim.map.route import RouteTracker
from lavsim.map.scenery import SCENERY_VERSION
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.scenarios.base import ScenarioSpec
from lavsim.scenarios.director import Director
from lavsim.traffic.parked import park_cars
from lavsim.traffic.population import Traffic
from lavsim.traffic.profiles import TRAFFIC_PROFILES, Population, population_of
from lavsim.traffic.walkers import Walkers
from lavsim.types import DT, ActorClass, ActorIds, Control, Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.dynamics import road_grip
from lavsim.world.lights import LightCycle, TrafficLights
from lavsim.world.snapshot import Snapshot
from lavsim.world.weather import Weather, WeatherKeyframe, weather_at
from lavsim.world.weather_redrawn import RedrawnWeather
from lavsim.world.world import World

EGO_BLUEPRINTS = {"1.0": "vehicle.lincoln.mkz_2017", "2.x": "vehicle.lincoln.mkz_2020"}
_EGO_COLOUR = (40, 80, 160)
_TRIGGER_WINDOW = 5  # route points ahead that may become the nearest one
_FLAT = 0.1  # [m] towns whose lanes differ by less in z are one plane
_HISTORY = 101  # snapshots kept for sensors that look back


@dataclass(frozen=True)
class LaterHazard:
    """A hazard that somebody adds while the drive is under way.

    Attributes:
        tick: The newest tick when it is added.
        spec: The hazard.
    """

    tick: int
    spec: ScenarioSpec


@dataclass(frozen=True)
class DriveSpec:
    """Everything that decides a drive, apart from the agent.

    Attributes:
        town: Name of the town.
        route_id: Of the route file, for the log.
        keypoints: (K, 3) what the route is traced through [m].
        weather: Keyframes over the route, empty means the default weather; or weather that is drawn anew in time.
        scenarios: Hazards in the order of the route file.
        seed: Root of all draws.
        traffic: A name of `TRAFFIC_PROFILES`.
        vehicles: Background vehicles instead of the profile's number; None takes the profile's.
        walkers: The same of walkers.
        parked: Share of parking spaces taken instead of the profile's.
        jaywalking: Share of walkers that also cross away from crosswalks.
        light_cycle: Durations of the traffic lights' phases.
        wet_friction: Whether rain and puddles make the road slippery; CARLA's weather does not.
        rules: Rule set, for the log.
        generation: "1.0" or "2.x": which ego drives.
        ego: Blueprint of the ego instead of the generation's.
        town_path: Folders searched for towns that are not bundled.
        later: Hazards that are added under way, by tick; numbered after `scenarios`.
    """

    town: str
    route_id: str
    keypoints: NDArray[np.float64]
    weather: tuple[WeatherKeyframe, ...] | RedrawnWeather = ()
    scenarios: tuple[ScenarioSpec, ...] = ()
    seed: int = 0
    traffic: str = "leaderboard"
    vehicles: int | None = None
    walkers: int | None = None
    parked: float | None = None
    jaywalking: float = 0.0
    light_cycle: LightCycle = LightCycle()  # noqa: RUF009 - frozen
    wet_friction: bool = False
    rules: str = "1.0"
    generation: str = "1.0"
    ego: str | None = None
    town_path: tuple[Path, ...] = ()
    later: tuple[LaterHazard, ...] = ()

    def __post_init__(self) -> None:
        if self.traffic not in TRAFFIC_PROFILES:
            raise UnknownName("traffic profile", self.traffic, TRAFFIC_PROFILES)
        if self.generation not in EGO_BLUEPRINTS:
            raise ConfigError(f"generation must be one of {', '.join(EGO_BLUEPRINTS)}, got {self.generation!r}.")
        if self.ego is not None and not find_blueprint(self.ego).actor_class.is_vehicle:
            raise ConfigError(f"the ego must be a vehicle, got {self.ego!r}.")
        for name in ("vehicles", "walkers"):
            count = getattr(self, name)
            if count is not None and count < 0:
                raise ConfigError(f"{name} must not be negative, got {count}.")
        for name in ("parked", "jaywalking"):
            share = getattr(self, name)
            if share is not None and not 0.0 <= share <= 1.0:
                raise ConfigError(f"{name} must lie in 0 to 1, got {share}.")

    def population(self, town: TownMap) -> Population:
        """Who is in town: the profile's population with what this drive sets itself."""
        population = population_of(self.traffic, self.generation, town)
        own = {name: getattr(self, name) for name in ("vehicles", "walkers", "parked")}
        return replace(population, **{name: value for name, value in own.items() if value is not None})

    @staticmethod
    def from_header(header: Mapping[str, Any], town_path: tuple[Path, ...] = ()) -> DriveSpec:
        """The drive that a log's header tells of (`Simulation.header`)."""
        plain = ("town", "route_id", "seed", "traffic", "vehicles", "walkers", "parked", "jaywalking", "wet_friction",
                 "rules", "generation", "ego")  # fmt: skip
        return DriveSpec(
            **{name: header[name] for name in plain},
            keypoints=np.array(header["keypoints"], dtype=np.float64).reshape(-1, 3),
            weather=_weather_of(header["weather"]),
            scenarios=tuple(_hazard_of(entry) for entry in header["scenarios"] if "tick" not in entry),
            later=tuple(
                LaterHazard(entry["tick"], _hazard_of(entry)) for entry in header["scenarios"] if "tick" in entry
            ),
            light_cycle=LightCycle(**header["light_cycle"]),
            town_path=town_path,
        )


def _hazard_of(entry: Mapping[str, Any]) -> ScenarioSpec:
    """The hazard that `_hazard_entry` tells of."""
    return ScenarioSpec(entry["name"], entry["type"], entry["generation"], tuple(entry["trigger"]), entry["parameters"])


def _hazard_entry(hazard: ScenarioSpec) -> dict[str, Any]:
    """A hazard in JSON types."""
    return {
        "name": hazard.name,
        "type": hazard.type,
        "generation": hazard.generation,
        "trigger": list(hazard.trigger),
        "parameters": dict(hazard.parameters),
    }


def _weather_of(entry: Any) -> tuple[WeatherKeyframe, ...] | RedrawnWeather:
    """The weather that `_weather_entry` tells of."""
    if isinstance(entry, Mapping):
        return RedrawnWeather(**entry["redrawn"])
    keyframes = (dict(fields) for fields in entry)
    return tuple(WeatherKeyframe(fields.pop("percentage"), Weather(**fields)) for fields in keyframes)


def _weather_entry(weather: tuple[WeatherKeyframe, ...] | RedrawnWeather) -> Any:
    """A drive's weather in JSON types."""
    if isinstance(weather, RedrawnWeather):
        return {"redrawn": asdict(weather)}
    return [{"percentage": k.percentage, **asdict(k.weather)} for k in weather]


class Simulation:
    """A world with an ego on a route; `tick` moves it.

    Args:
        spec: What is driven.

    Attributes:
        town: The town's map.
        route: The dense route.
        snapshot: The newest tick.
        controls: (5,) float32 `Snapshot.control` of every tick so far: with the header all it takes to come here again.

    Raises:
        RouteError: the route can't be traced, or a hazard doesn't fit where its trigger is.
        UnknownName: no such town or hazard.
    """

    def __init__(self, spec: DriveSpec) -> None:
        self.spec = spec
        self.town: TownMap = load_town(spec.town, spec.town_path)
        self.route = get_planner(self.town).trace(spec.keypoints)
        self.draws = Draws.of_seed(spec.seed)
        self._lights = TrafficLights(len(self.town.lights), self.town.light_groups, spec.light_cycle)
        self._has_slopes = float(np.ptp(self.town.lanes.points[:, 2])) > _FLAT
        self._rise = rise_along(self.town) if self._has_slopes else np.zeros(0)
        walls, wall_z = _walls(self.town)
        self._world = World(walls, self._has_slopes, wall_z)
        self._spawn_ego()
        self._population = spec.population(self.town)
        population = self._population
        self._traffic = Traffic(
            self.town, self._world, self.draws, population.vehicles, follows_ego=population.follows_ego
        )
        self._walkers = Walkers(self.town, self._world, self.draws, self._population.walkers, spec.jaywalking)
        park_cars(self.town, self._world, self.draws, self._population.parked)
        # Nearest point in the window ahead, later ones win ties (reference `leaderboard.md` 3.2).
        self._tracker = RouteTracker(self.route, _TRIGGER_WINDOW)
        self._director = Director(
            self.town, self.route, self._world, self.draws, spec.scenarios, spec.route_id, self._tracker.metres,
            self._lights, self._traffic, spec.rules,
        )  # fmt: skip
        self._later, self._added = list(spec.later), 0
        self._recent: deque[Snapshot] = deque(maxlen=_HISTORY)
        self.controls: list[NDArray[np.float32]] = []
        self._director.place()
        self.tick(Control())  # CARLA's leaderboard ticks once before it asks the agent

    @property
    def snapshot(self) -> Snapshot:
        return self._recent[-1]

    def recent(self, count: int) -> Sequence[Snapshot]:
        """The last `count` snapshots, newest last; fewer at the start."""
        return list(islice(self._recent, max(0, len(self._recent) - count), None))

    def tick(self, control: Control) -> Snapshot:
        """Applies `control` for one tick and returns what came of it."""
        while self._added < len(self._later) and self._later[self._added].tick <= self._world.tick:
            self._director.add(self._later[self._added].spec)
            self._added += 1
        self._director.tick(self.route.points[self._tracker.index, :2])
        lights = self._lights.states(self._world.tick * DT)
        self._traffic.control(lights)
        self._walkers.control(lights)
        if self.spec.wet_friction:
            self._world.grip = road_grip(self._weather())
        self._world.drive_ego(control, self._director.disturbance)
        self._world.step()
        self._follow_ground()
        self._tracker.update(self._world.ego.xy)
        snapshot = self._publish()
        self.controls.append(snapshot.control)
        return snapshot

    @property
    def hazard_types(self) -> list[str]:
        """Types of the hazards so far, by number."""
        return [spec.type for spec in (*self.spec.scenarios, *(h.spec for h in self._later[: self._added]))]

    def add_hazard(self, spec: ScenarioSpec) -> None:
        """Adds a hazard from the next tick on; `header` tells of it from then on.

        Raises:
            RouteError: it doesn't fit where its trigger is.
            UnknownName: no such hazard.
        """
        self._director.add(spec)
        self._later.insert(self._added, LaterHazard(self._world.tick, spec))
        self._added += 1

    def header(self) -> dict[str, Any]:
        """What a log says about the drive, in JSON types."""
        spec = self.spec
        return {
            "town": self.town.name,
            "town_digest": self.town.digest,
            "scenery_version": SCENERY_VERSION,
            "route_id": spec.route_id,
            "keypoints": np.asarray(spec.keypoints, dtype=float).tolist(),
            "weather": _weather_entry(spec.weather),
            "scenarios": [
                *(_hazard_entry(hazard) for hazard in spec.scenarios),
                *({**_hazard_entry(later.spec), "tick": later.tick} for later in self._later),
            ],
            "seed": spec.seed,
            "traffic": spec.traffic,
            "vehicles": self._population.vehicles,
            "walkers": self._population.walkers,
            "parked": self._population.parked,
            "jaywalking": spec.jaywalking,
            "light_cycle": asdict(spec.light_cycle),
            "wet_friction": spec.wet_friction,
            "rules": spec.rules,
            "generation": spec.generation,
            "ego": spec.ego,
        }  # fmt: skip

    def _spawn_ego(self) -> None:
        self._world.spawn(
            int(ActorIds.EGO),
            find_blueprint(self.spec.ego or EGO_BLUEPRINTS[self.spec.generation]),
            self.route.points[0],
            float(self.route.yaw[0]),
            Role.EGO,
            _EGO_COLOUR,
        )

    def _follow_ground(self) -> None:
        """Lets vehicles lean with their lane, and sets the ego and the actors of hazards on it; others know theirs."""
        if not self._has_slopes:
            return
        world, n = self._world, self._world.count
        roles = world.table.roles[:n]
        own = (roles == Role.EGO) | (roles == Role.SCENARIO) | (roles == Role.PROP)
        leans = world.table.classes[:n] <= ActorClass.BICYCLE
        rows = np.flatnonzero(world.present[:n] & (own | leans))
        points = np.column_stack([world.pose[rows, :2], world.height[rows]])
        hits = self.town.nearest(points)
        pitch = pitch_on(self.town, self._rise, hits, world.pose[rows, 2])
        world.pitch[rows] = np.where(leans[rows], pitch, 0.0)
        world.height[rows[own[rows]]] = hits.points[own[rows], 2]

    def _weather(self) -> Weather:
        if isinstance(self.spec.weather, RedrawnWeather):
            return self.spec.weather.at(self._world.tick)
        return weather_at(self.spec.weather, 100.0 * self._tracker.metres() / self.route.length)

    def _publish(self) -> Snapshot:
        states = self._lights.states(self._world.tick * DT)
        self._recent.append(self._world.publish(states, self._weather(), self._director.active))
        return self._recent[-1]


def _walls(town: TownMap) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Footprints of the scenery that stops a car, and bottom and top of each (W, 2) [m]."""
    prisms = town.scenery.prisms
    solid = np.flatnonzero(prisms.solid)
    footprints = [prisms.vertices[k, : prisms.count[k]] for k in solid]
    return footprints, np.stack([prisms.z0[solid], prisms.z1[solid]], axis=1).astype(np.float64)
