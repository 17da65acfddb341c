"""One drive of one route: what is in the world, and the order within a tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.errors import ConfigError, RouteError, ScenarioError, UnknownName
from lavsim.map.planner import get_planner
from lavsim.map.scenery import SCENERY_VERSION
from lavsim.map.town_map import TownMap, load_town
from lavsim.random import Draws
from lavsim.scenarios.base import Scenario, ScenarioSpec, Script, Stage, make_scenario
from lavsim.traffic.population import Traffic
from lavsim.types import ActorIds, Control, Role
from lavsim.world.blueprints import find_blueprint
from lavsim.world.lights import TrafficLights
from lavsim.world.snapshot import HAZARD_DTYPE, Snapshot
from lavsim.world.weather import Weather, WeatherKeyframe, weather_at
from lavsim.world.world import World

# Background vehicles by profile. `leaderboard` is what the rules say, `lav` what collection and our routes use.
TRAFFIC_PROFILES: Mapping[str, int] = {"leaderboard": 40, "lav": 40, "empty": 0}
EGO_BLUEPRINTS = {"1.0": "vehicle.lincoln.mkz_2017", "2.x": "vehicle.lincoln.mkz_2020"}
_EGO_COLOUR = (40, 80, 160)
_TRIGGER_WINDOW = 5  # route points ahead that may become the nearest one
_PLACE_RANGE = 500.0  # [m] from the ego within which a hazard's actors appear
_FLAT = 0.1  # [m] towns whose lanes differ by less in z are one plane
_HISTORY = 8  # snapshots kept for sensors that look back


@dataclass(frozen=True)
class DriveSpec:
    """Everything that decides a drive, apart from the agent.

    Attributes:
        town: Name of the town.
        route_id: Of the route file, for the log.
        keypoints: (K, 3) what the route is traced through [m].
        weather: Keyframes over the route; empty means the default weather.
        scenarios: Hazards in the order of the route file.
        seed: Root of all draws.
        traffic: A name of `TRAFFIC_PROFILES`.
        vehicles: Background vehicles instead of the profile's number; None takes the profile's.
        rules: Rule set, for the log.
        generation: "1.0" or "2.x": which ego drives.
        town_path: Folders searched for towns that are not bundled.
    """

    town: str
    route_id: str
    keypoints: NDArray[np.float64]
    weather: tuple[WeatherKeyframe, ...] = ()
    scenarios: tuple[ScenarioSpec, ...] = ()
    seed: int = 0
    traffic: str = "leaderboard"
    vehicles: int | None = None
    rules: str = "1.0"
    generation: str = "1.0"
    town_path: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        if self.traffic not in TRAFFIC_PROFILES:
            raise UnknownName("traffic profile", self.traffic, TRAFFIC_PROFILES)
        if self.generation not in EGO_BLUEPRINTS:
            raise ConfigError(f"generation must be one of {', '.join(EGO_BLUEPRINTS)}, got {self.generation!r}.")


@dataclass
class _Hazard:
    """A hazard of the route and where it stands in its life."""

    spec: ScenarioSpec
    scenario: Scenario
    stage: Stage
    route_index: int
    is_placed: bool = False
    is_over: bool = False
    script: Script | None = field(default=None)


class Simulation:
    """A world with an ego on a route; `tick` moves it.

    Args:
        spec: What is driven.

    Attributes:
        town: The town's map.
        route: The dense route.
        snapshot: The newest tick.

    Raises:
        RouteError: the route can't be traced, or a hazard doesn't fit where its trigger is.
        UnknownName: no such town or hazard.
    """

    def __init__(self, spec: DriveSpec) -> None:
        self.spec = spec
        self.town: TownMap = load_town(spec.town, spec.town_path)
        self.route = get_planner(self.town).trace(spec.keypoints)
        self.draws = Draws.of_seed(spec.seed)
        self._lights = TrafficLights(len(self.town.lights), self.town.light_groups)
        self._has_slopes = float(np.ptp(self.town.lanes.points[:, 2])) > _FLAT
        self._world = World(_walls(self.town), has_levels=self._has_slopes)
        self._spawn_ego()
        vehicles = TRAFFIC_PROFILES[spec.traffic] if spec.vehicles is None else spec.vehicles
        self._traffic = Traffic(self.town, self._world, self.draws, vehicles)
        self._index = 0  # nearest route point, see `_track_route`
        self._hazards = [h for k, s in enumerate(spec.scenarios) if (h := self._prepare(k, s)) is not None]
        self._recent: deque[Snapshot] = deque(maxlen=_HISTORY)
        self._place_hazards()
        self._publish()
        self.tick(Control())  # CARLA's leaderboard ticks once before it asks the agent

    @property
    def snapshot(self) -> Snapshot:
        return self._recent[-1]

    def recent(self, count: int) -> Sequence[Snapshot]:
        """The last `count` snapshots, newest last; fewer at the start."""
        return list(islice(self._recent, max(0, len(self._recent) - count), None))

    def tick(self, control: Control) -> Snapshot:
        """Applies `control` for one tick and returns what came of it."""
        self._place_hazards()
        self._run_hazards()
        self._traffic.control(self._lights.states(self._world.tick * 0.05))
        self._world.drive_ego(_as_logged(control))
        self._world.step()
        self._follow_ground()
        self._track_route()
        return self._publish()

    def header(self) -> dict[str, Any]:
        """What a log says about the drive, in JSON types."""
        spec = self.spec
        return {
            "town": self.town.name,
            "town_digest": self.town.digest,
            "scenery_version": SCENERY_VERSION,
            "route_id": spec.route_id,
            "keypoints": np.asarray(spec.keypoints, dtype=float).tolist(),
            "weather": [{"percentage": k.percentage, **asdict(k.weather)} for k in spec.weather],
            "scenarios": [
                {"name": s.name, "type": s.type, "generation": s.generation, "trigger": list(s.trigger),
                 "parameters": dict(s.parameters)}
                for s in spec.scenarios
            ],
            "seed": spec.seed,
            "traffic": spec.traffic,
            "vehicles": len(self._traffic),
            "rules": spec.rules,
            "generation": spec.generation,
        }  # fmt: skip

    def _spawn_ego(self) -> None:
        self._world.spawn(
            int(ActorIds.EGO),
            find_blueprint(EGO_BLUEPRINTS[self.spec.generation]),
            self.route.points[0],
            float(self.route.yaw[0]),
            Role.EGO,
            _EGO_COLOUR,
        )

    def _prepare(self, instance: int, spec: ScenarioSpec) -> _Hazard | None:
        """The hazard of `spec`; None when its trigger is not on the route, as the leaderboard ignores it then."""
        scenario = make_scenario(spec)
        index = self._trigger_index(spec)
        if index is None:
            return None
        anchor = self.town.waypoint_at(int(self.route.lane[index]), float(self.route.u[index]))
        reason = scenario.fits(anchor)
        if reason is not None:
            where = f"({spec.trigger[0]:.1f}, {spec.trigger[1]:.1f})"
            raise RouteError(
                f"route {self.spec.route_id}, scenario {spec.name}: {spec.type} does not fit at {where}: {reason}."
            )
        stage = Stage(
            self._world,
            self.route,
            anchor,
            instance,
            lambda: float(self.route.distance[self._index]),
            self.draws.stream("scenario", instance),
        )
        return _Hazard(spec, scenario, stage, index)

    def _trigger_index(self, spec: ScenarioSpec) -> int | None:
        """First route point within 2 m and 10 degrees of the trigger (reference `leaderboard.md` 3.3)."""
        x, y, z, yaw = spec.trigger
        near = np.hypot(self.route.points[:, 0] - x, self.route.points[:, 1] - y) < 2.0
        level = self.route.points[:, 2] - z < 2.0
        turned = np.abs(np.mod(self.route.yaw - yaw + np.pi, 2.0 * np.pi) - np.pi) < np.radians(10.0)
        found = np.flatnonzero(near & level & turned)
        return int(found[0]) if len(found) else None

    def _place_hazards(self) -> None:
        for hazard in self._hazards:
            if hazard.is_placed:
                continue
            trigger = np.array(hazard.spec.trigger[:2])
            if np.hypot(*(trigger - self._world.ego.xy)) < _PLACE_RANGE:
                hazard.is_placed = True
                try:
                    hazard.scenario.place(hazard.stage)
                except ScenarioError:
                    hazard.scenario.clear()  # no room: left out, as the leaderboard skips a class that can't be set up
                    hazard.is_over = True

    def _run_hazards(self) -> None:
        for hazard in self._hazards:
            if hazard.is_over or not hazard.is_placed:
                continue
            if hazard.script is None:
                gap = self.route.points[self._index, :2] - np.array(hazard.spec.trigger[:2])
                if np.hypot(*gap) >= hazard.scenario.trigger_radius:
                    continue
                hazard.script = hazard.scenario.script(hazard.stage)
            try:
                next(hazard.script)
            except StopIteration:
                hazard.scenario.clear()
                hazard.is_over = True

    def _follow_ground(self) -> None:
        """Sets actors of the ego and of hazards on the lane below them; traffic knows its own."""
        if not self._has_slopes:
            return
        world = self._world
        here = world.present[: world.count].copy()
        here[self._traffic.rows] = False
        rows = np.flatnonzero(here)
        points = np.column_stack([world.pose[rows, :2], world.height[rows]])
        world.height[rows] = self.town.nearest(points).points[:, 2]

    def _track_route(self) -> None:
        """Nearest route point in the window ahead, later ones win ties (reference `leaderboard.md` 3.2)."""
        last = min(self._index + _TRIGGER_WINDOW, len(self.route.points) - 1)
        window = self.route.points[self._index : last + 1, :2] - self._world.ego.xy
        distance = np.hypot(window[:, 0], window[:, 1])
        self._index += len(distance) - 1 - int(np.argmin(distance[::-1]))

    def _weather(self) -> Weather:
        if not self.spec.weather:
            return Weather()
        return weather_at(self.spec.weather, 100.0 * self.route.distance[self._index] / self.route.length)

    def _publish(self) -> Snapshot:
        active = [(h.stage.instance, 0) for h in self._hazards if h.script is not None and not h.is_over]
        states = self._lights.states(self._world.tick * 0.05)
        self._recent.append(self._world.publish(states, self._weather(), np.array(active, dtype=HAZARD_DTYPE)))
        return self._recent[-1]


def _walls(town: TownMap) -> list[NDArray[np.float64]]:
    """Footprints of the scenery that stops a car: what stands on the ground and is solid."""
    prisms = town.scenery.prisms
    solid = np.flatnonzero(prisms.solid & (prisms.z0 < 1.0))
    return [prisms.vertices[k, : prisms.count[k]] for k in solid]


def _as_logged(control: Control) -> Control:
    """The control with float32 values: what the log will hold is exactly what the world applies."""
    return Control(
        float(np.float32(control.throttle)),
        float(np.float32(control.steer)),
        float(np.float32(control.brake)),
        bool(control.hand_brake),
        bool(control.reverse),
    )
