"""What a dataset is made of: episode k of a plan is a pure function of the plan and k.

So the dataset is the same on any number of workers and after any interruption: the shortest run of episodes 0, 1, 2 …
whose kept frames reach the number that was asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from lavsim.agent import AgentSpec
from lavsim.config import Config, parse_config, resolved
from lavsim.dataset.hazards import generation_of, hazards_along
from lavsim.dataset.noise import ControlNoise
from lavsim.dataset.schema import TICKS_PER_FRAME
from lavsim.errors import ConfigError, LavsimError, RouteError, UnknownName
from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town, town_names
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.simulation import DriveSpec
from lavsim.towns.facts import bundled_facts
from lavsim.traffic.profiles import TRAFFIC_PROFILES
from lavsim.types import LaneType
from lavsim.world.weather import WeatherKeyframe
from lavsim.world.weather_presets import find_weather
from lavsim.world.weather_redrawn import RedrawnWeather

PLAN_SCHEMA = 1
PLAN_KEY = "plan_schema"  # in `meta/plan.json`
REDRAWN = "lav"  # the weather that is drawn anew every 10 s
MOST_FRAMES = 400  # of an episode, as in LAV's dataset
FRAMES_PER_HOUR = 4 * 3600

_TRIES = 1000  # routes drawn until one is as long as wished
_FROM_END = 8.0  # [m] of its first and last lane that a route keeps clear of
_SEED_BITS = 63


class CollectPlan(Config):
    """All that decides a dataset.

    Each episode draws its route, weather, hazards and numbers of actors for itself; towns take turns.
    """

    towns: tuple[str, ...] = Field(
        default_factory=lambda: named_towns("training"), min_length=1, description="episode k drives in town k modulo n"
    )
    frames: int = Field(default=1000, ge=1, description="kept frames (4 a second) that the dataset has at least")
    seed: int = Field(default=0, ge=0, description="root of all draws")
    weathers: tuple[str, ...] = Field(default=(REDRAWN,), min_length=1, description="'lav', or presets of CARLA 0.9.10")
    traffic: str = Field(default="lav", description="traffic profile")
    vehicles: tuple[int, int] | None = Field(default=None, description="fewest and most; None: the profile's number")
    walkers: tuple[int, int] | None = Field(default=None, description="fewest and most; None: the profile's number")
    hazards: tuple[str, ...] = Field(
        default=(), description="types of hazards, one is drawn for each place that has room"
    )
    hazards_per_km: float = Field(default=3.0, ge=0.0, le=20.0, description="places for hazards along a route")
    length: tuple[float, float] = Field(default=(150.0, 1000.0), description="of routes, shortest and longest [m]")
    episode_frames: int = Field(default=MOST_FRAMES, ge=1, le=MOST_FRAMES, description="an episode ends after so many")
    suite: str = Field(default="lav_data", description="name of the sensor suite")
    look: str = Field(default="fast", description="of the cameras: fast or full")
    noise: ControlNoise | None = Field(default=None, description="how the expert's control is disturbed")
    agent: str = Field(default="agents.behavior:BehaviorAgent", description="who drives: module:Class")
    agent_config: str | None = Field(default=None, description="handed to the agent's setup as it is")
    log_only: bool = Field(default=False, description="keep the log alone; tables and blobs are rendered later")

    @field_validator("weathers")
    @classmethod
    def _known_weathers(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        for name in values:
            if name != REDRAWN:
                find_weather(name, "1.0")
        return values

    @field_validator("traffic")
    @classmethod
    def _known_traffic(cls, value: str) -> str:
        if value not in TRAFFIC_PROFILES:
            raise UnknownName("traffic profile", value, TRAFFIC_PROFILES)
        return value

    @field_validator("hazards")
    @classmethod
    def _known_hazards(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        for name in values:
            generation_of(name)
        return values

    @field_validator("vehicles", "walkers", "length")
    @classmethod
    def _rising(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not 0 <= value[0] <= value[1]:
            raise ValueError("a range must rise and not be negative")
        return value

    def check(self, town_path: tuple[Path, ...] = ()) -> dict[str, str]:
        """Digests of the towns by name, once it is known that all towns are there and have routes of that length.

        Raises:
            LavsimError: a mistake in the plan.
        """
        known = town_names(town_path)
        for name in self.towns:
            if name not in known:
                raise UnknownName("town", name, known)
        self.agent_spec()
        for number in range(len(self.towns)):
            self.episode(number, town_path)
        return {name: load_town(name, town_path).digest for name in self.towns}

    def agent_spec(self) -> AgentSpec:
        """Who drives."""
        return AgentSpec(self.agent, self.agent_config)

    def episode(self, number: int, town_path: tuple[Path, ...] = ()) -> EpisodePlan:
        """Episode `number` of the plan.

        Raises:
            RouteError: the town has no route of that length.
        """
        town = load_town(self.towns[number % len(self.towns)], town_path)
        draws = Draws.of_seed(self.seed).stream("episode", number)
        route = _route(town, self.length, draws.stream("route"))
        weather = self.weathers[draws.integer(0, len(self.weathers))]
        spec = DriveSpec(
            town=town.name,
            route_id=str(number),
            keypoints=route.keypoints,
            weather=_weather(weather, draws),
            scenarios=hazards_along(town, route, self.hazards, self.hazards_per_km, draws.stream("hazards")),
            seed=draws.key % 2**_SEED_BITS,
            traffic=self.traffic,
            vehicles=_count(self.vehicles, draws.stream("vehicles")),
            walkers=_count(self.walkers, draws.stream("walkers")),
            town_path=town_path,
        )
        return EpisodePlan(number, spec, weather, self.episode_frames)

    def to_json(self) -> dict[str, Any]:
        """The plan in JSON types, as `meta/plan.json` holds it."""
        return {"schema": PLAN_SCHEMA, **resolved(self)}

    def command(self) -> str:
        """The `lavsim collect` that makes this dataset, but for its folder: what is not as by default."""
        parts = ["lavsim collect"]
        for name in CollectPlan.model_fields:
            value = getattr(self, name)
            if name in ("towns", "frames") or value != getattr(_DEFAULT, name):
                parts += _options(name, value)
        return " ".join(parts)

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> CollectPlan:
        """The plan that `to_json` gave.

        Raises:
            ConfigError: another schema, or no plan.
        """
        fields = dict(values)
        schema = fields.pop("schema", None)
        if schema != PLAN_SCHEMA:
            raise ConfigError(f"the plan has schema {schema!r}, this version of lavsim reads {PLAN_SCHEMA}.")
        return parse_config(CollectPlan, fields)


@dataclass(frozen=True)
class EpisodePlan:
    """One drive of a dataset.

    Attributes:
        number: Its place in the plan.
        spec: What is driven.
        weather: Name of its weather.
        frames: It ends after so many kept frames.
    """

    number: int
    spec: DriveSpec
    weather: str
    frames: int

    @property
    def name(self) -> str:
        """Names its files."""
        return episode_name(self.number)

    @property
    def max_ticks(self) -> int:
        """It ends after so many ticks, kept or not."""
        return TICKS_PER_FRAME * self.frames


def episode_name(number: int) -> str:
    """`ep_000012`."""
    return f"ep_{number:06d}"


def named_towns(text: str) -> tuple[str, ...]:
    """Towns by name, separated by commas; "training", "test" and "full" stand for the bundled towns of that split."""
    found: list[str] = []
    for name in (part.strip() for part in text.split(",")):
        found += [town for town, facts in bundled_facts().items() if facts.split == name] or [name]
    return tuple(dict.fromkeys(filter(None, found)))


_DEFAULT = CollectPlan()
_SPELLED = {"suite": "sensors"}  # fields whose option is called otherwise


def _options(name: str, value: Any) -> list[str]:
    """The options that give a plan's field this value."""
    option = f"--{_SPELLED.get(name, name).replace('_', '-')}"
    if isinstance(value, ControlNoise):
        own = [n for n in ControlNoise.model_fields if getattr(value, n) != getattr(ControlNoise(), n)]
        return [option, *(f"--set {name}.{n}={getattr(value, n):g}" for n in own)]
    if name == "episode_frames":
        return [f"--set {name}={value}"]
    if value is True:
        return [option]
    if name in ("vehicles", "walkers", "length"):
        return [option, "-".join(f"{number:g}" for number in value)]
    return [option, ",".join(value) or "none" if isinstance(value, tuple) else str(value)]


def _weather(name: str, draws: Draws) -> tuple[WeatherKeyframe, ...] | RedrawnWeather:
    if name == REDRAWN:
        return RedrawnWeather(draws.stream("weather").key % 2**_SEED_BITS)
    return (WeatherKeyframe(0.0, find_weather(name, "1.0")),)


def _count(limits: tuple[int, int] | None, draws: Draws) -> int | None:
    return None if limits is None else limits[0] + draws.integer(0, limits[1] - limits[0] + 1)


def _route(town: TownMap, length: tuple[float, float], draws: Draws) -> Route:
    """A route between two random places, `length` metres long.

    Source: LAV's collector drives between two random spawn points (reference `lav.md` 3.6).

    Raises:
        RouteError: none was found.
    """
    lanes, ends = _places(town)
    if len(lanes):
        planner = get_planner(town)
        for number in range(_TRIES):
            dice = draws.uniform(number, 4)
            chosen = np.minimum(np.searchsorted(ends, dice[:2] * ends[-1]), len(lanes) - 1)
            at = lanes[chosen]
            u = _FROM_END + dice[2:] * (town.lanes.length[at] - 2.0 * _FROM_END)
            keypoints = np.round(town.centre(at, u)[:, :3], 3)
            # No route is shorter than the straight line between its ends.
            if np.hypot(*(keypoints[1] - keypoints[0])[:2]) > length[1]:
                continue
            try:
                route = planner.trace(keypoints)
            except LavsimError:
                continue
            if length[0] <= route.length <= length[1]:
                return route
    raise RouteError(f"{town.name} has no route of {length[0]:g} to {length[1]:g} m between two places drawn.")


@lru_cache(maxsize=8)
def _places(town: TownMap) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Driving lanes outside junctions, and their lengths added up [m]."""
    lanes = town.lanes
    found = lanes.where(int(LaneType.DRIVING))
    found = found[(lanes.junction[found] < 0) & (lanes.length[found] > 3.0 * _FROM_END)]
    return found, np.cumsum(lanes.length[found])
