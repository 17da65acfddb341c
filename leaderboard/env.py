"""Routes as a gymnasium environment: sensors and state in, controls or waypoints out, rewards from the criteria.

A step is a few ticks of the world. An episode ends as a drive does: at the target, or when a criterion ends it
(terminated), or when its time is spent (truncated).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lavsim.errors import ConfigError, UnknownName
from lavsim.map.route import Route, RouteTracker
from lavsim.render.scene import get_scene
from lavsim.sensors.base import ArraySpec, SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT, LightState
from leaderboard.criteria.base import COMPLETED, Criterion, Infraction, criteria_of
from leaderboard.env_actions import ACTIONS, ActionSpace
from leaderboard.routes import RouteEntry, read_routes, select_routes
from leaderboard.rules import Rules, get_rules

OBSERVATIONS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "state": (),
    "bev": (
        {
            "type": "sensor.lavsim.bev",
            "id": "bev",
            "attributes": {"width": 96, "height": 96, "pixels_per_metre": 2.0, "ahead": 16.0},
        },
    ),
    "lidar": ({"type": "sensor.lavsim.lidar_raster", "id": "lidar", "z": 2.4},),
    "camera": (
        {"type": "sensor.camera.rgb", "id": "camera", "x": 1.5, "z": 2.4, "width": 160, "height": 120, "fov": 90},
    ),
}
PREVIEW = tuple(float(s) for s in range(4, 44, 4))  # [m] along the route: points of the state
LIGHT_REACH = 40.0  # [m] before a stop line its light is part of the state
_FAR = 1e3  # bounds of the state: places are within a route's reach


@dataclass(frozen=True)
class Reward:
    """What a step is worth.

    Attributes:
        progress: For each metre along the route.
        completed: For reaching the target.
        infractions: Of each kind, by its key in the results; kinds not named cost `other`.
        other: Of an infraction not named.
        offset: For each metre beside the lane's middle, each second.
    """

    progress: float = 0.1
    completed: float = 10.0
    infractions: Mapping[str, float] = field(
        default_factory=lambda: {
            "collisions_pedestrian": -10.0,
            "collisions_vehicle": -8.0,
            "collisions_layout": -7.0,
            "red_light": -6.0,
            "stop_infraction": -4.0,
            "min_speed_infractions": 0.0,
        }
    )
    other: float = -5.0
    offset: float = -0.1


class RouteEnv(gymnasium.Env[dict[str, Any], NDArray[np.float32]]):
    """Drives the routes of a file, one an episode.

    Args:
        routes: Name of a packaged route file, or a path.
        route_ids: Some routes of the file: "0,3-5".
        observe: Names of `OBSERVATIONS`, or dicts of the leaderboard's sensors; "state" is a vector of `STATE` numbers.
        actions: "controls" (acceleration pedal and wheel) or "waypoints" (four points to be driven to).
        reward: What a step is worth.
        rules: Version of the rules whose criteria judge and end an episode.
        traffic: Profile instead of the file's.
        hazards: Whether the routes' hazards are there.
        frame_skip: Ticks of 0.05 s in a step.
        max_seconds: An episode longer than this is truncated [s]; None leaves it to the criteria.
        town_path: Folders with towns.
        render_mode: "rgb_array" for a view from above, or None.

    Raises:
        LavsimError: no such route file, town, rules, observation or action.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - as gymnasium has it

    def __init__(
        self,
        routes: str | Path = "quick",
        route_ids: str | None = None,
        observe: Sequence[str | Mapping[str, Any]] = ("state", "bev"),
        actions: Literal["controls", "waypoints"] = "controls",
        reward: Reward | None = None,
        rules: str = "1.0",
        traffic: str | None = None,
        hazards: bool = True,
        frame_skip: int = 2,
        max_seconds: float | None = 120.0,
        town_path: Sequence[Path] = (),
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"render_mode must be 'rgb_array' or None, got {render_mode!r}.")
        if frame_skip < 1:
            raise ConfigError(f"frame_skip must be at least 1, got {frame_skip}.")
        if actions not in ACTIONS:
            raise UnknownName("action", actions, ACTIONS)
        self._entries = select_routes(read_routes(routes), route_ids)
        self._rules: Rules = get_rules(rules)
        self._reward = reward or Reward()
        self._traffic, self._hazards, self._town_path = traffic, hazards, tuple(town_path)
        self._skip, self._max_seconds = frame_skip, max_seconds
        self._sensors, self._has_state = _sensors_of(observe)
        self._actions: ActionSpace = ACTIONS[actions]()
        self.render_mode = render_mode
        self.action_space: spaces.Space[NDArray[np.float32]] = self._actions.space
        self.observation_space = self._observation_space()
        self._simulation: Simulation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins a drive; `options` may name the route: {"route": "3"}."""
        super().reset(seed=seed)
        entry = self._entry((options or {}).get("route"))
        self._simulation = Simulation(self._spec(entry, int(self.np_random.integers(2**31))))
        simulation = self._simulation
        self._suite = SensorSuite(get_scene(simulation.town), self._sensors, simulation.draws)
        self._criteria: list[Criterion] = [kind(self._rules) for kind in criteria_of(self._rules)]
        for criterion in self._criteria:
            criterion.start(simulation.town, simulation.route)
        self._tracker = RouteTracker(simulation.route)
        self._tracker.update(simulation.snapshot.ego.xy)
        self._ending: str | None = None
        self._judge()
        return self._observation(), {"route": entry.id, "town": entry.town}

    def step(self, action: NDArray[np.float32]) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Applies `action` for `frame_skip` ticks, or fewer if the drive ends before."""
        simulation = self._running()
        before = self._metres()
        found: list[Infraction] = []
        offset = 0.0
        for _ in range(self._skip):
            snapshot = simulation.tick(self._actions.control(action, simulation.snapshot.ego))
            found += self._judge()
            self._tracker.update(snapshot.ego.xy)
            offset += abs(self._offset()) * DT
            if self._ending is not None:
                break
        worth = self._reward
        reward = worth.progress * (self._metres() - before) + worth.offset * offset
        reward += sum(worth.infractions.get(infraction.key, worth.other) for infraction in found)
        reward += worth.completed * (self._ending == COMPLETED)
        late = self._max_seconds is not None and simulation.snapshot.time >= self._max_seconds
        info = {
            "infractions": [infraction.key for infraction in found],
            "ending": self._ending,
            "completion": 100.0 * self._metres() / simulation.route.length,
        }
        over = self._ending is not None
        return self._observation(), float(reward), over, late and not over, info

    def render(self) -> Any:
        """A view from above around the ego, `(H, W, 3)` uint8 RGB."""
        if self.render_mode is None:
            return None
        from lavsim.render.birdseye import draw_snapshot

        simulation = self._running()
        image: NDArray[np.uint8] = draw_snapshot(get_scene(simulation.town), simulation.snapshot).image
        return np.ascontiguousarray(image[:, :, ::-1])

    def _running(self) -> Simulation:
        if self._simulation is None:
            raise ConfigError("call reset() before step() or render().")
        return self._simulation

    def _entry(self, wanted: str | None) -> RouteEntry:
        if wanted is None:
            return self._entries[int(self.np_random.integers(len(self._entries)))]
        return select_routes(self._entries, str(wanted))[0]

    def _spec(self, entry: RouteEntry, seed: int) -> DriveSpec:
        return DriveSpec(
            town=entry.town,
            route_id=entry.id,
            keypoints=entry.keypoints,
            weather=entry.weather,
            scenarios=entry.scenarios if self._hazards else (),
            seed=seed,
            traffic=self._traffic or entry.traffic or "leaderboard",
            rules=self._rules.version,
            generation=self._rules.generation,
            town_path=self._town_path,
        )

    def _judge(self) -> list[Infraction]:
        """What the criteria find in this tick; the first that ends the drive says how."""
        found: list[Infraction] = []
        for criterion in self._criteria:
            found += criterion.update(self._running().snapshot)
            self._ending = self._ending or criterion.ending
        return found

    def _metres(self) -> float:
        return float(self._running().route.distance[self._tracker.index])

    def _offset(self) -> float:
        """Distance of the ego to the right of the route [m]."""
        simulation = self._running()
        ego, index = simulation.snapshot.ego, self._tracker.index
        x, y = simulation.route.points[index, :2]
        yaw = simulation.route.yaw[index]
        return float((ego.y - y) * math.cos(yaw) - (ego.x - x) * math.sin(yaw))

    def _observation(self) -> dict[str, Any]:
        simulation = self._running()
        readings = self._suite.read(simulation.recent(self._suite.history + 1))
        observation = {name: data for name, (_, data) in readings.items()}
        if self._has_state:
            observation["state"] = self._state()
        return observation

    def _state(self) -> NDArray[np.float32]:
        """See `STATE`."""
        simulation = self._running()
        snapshot, route = simulation.snapshot, simulation.route
        ego = snapshot.ego
        ahead = _preview(route, self._tracker.index)
        gap = ahead - (ego.x, ego.y)
        cos, sin = math.cos(ego.yaw), math.sin(ego.yaw)
        points = np.stack([gap[:, 0] * cos + gap[:, 1] * sin, gap[:, 1] * cos - gap[:, 0] * sin], axis=1)
        command = np.zeros(6)
        command[max(int(route.command[self._tracker.index]), 1) - 1] = 1.0
        heading = math.remainder(ego.yaw - float(route.yaw[self._tracker.index]), 2.0 * math.pi)
        motion = [ego.forward_speed, float(snapshot.ego_motion[5]), self._offset(), heading]
        light = _light_ahead(simulation, self._tracker.index)
        parts = [np.array(motion), points.ravel(), command, np.array(light)]
        return np.clip(np.concatenate(parts), -_FAR, _FAR).astype(np.float32)

    def _observation_space(self) -> spaces.Dict:
        """The spaces of what is observed; sensors say themselves what they give."""
        simulation = Simulation(self._spec(self._entries[0], 0))
        suite = SensorSuite(get_scene(simulation.town), self._sensors, simulation.draws)
        found: dict[str, spaces.Space[Any]] = {
            sensor.config.id: _space_of(sensor.config.id, sensor.spec) for sensor in suite.sensors
        }
        if self._has_state:
            found["state"] = spaces.Box(-_FAR, _FAR, (STATE,), np.float32)
        return spaces.Dict(found)


# Speed ahead [m/s], yaw rate [rad/s], offset to the right of the route [m], heading against it [rad]; points of the
# route ahead and right of the ego [m]; the command, one of six; whether a light ahead is red, yellow, green, and how
# far it is [m].
STATE = 4 + 2 * len(PREVIEW) + 6 + 4


def _sensors_of(observe: Sequence[str | Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], bool]:
    sensors: list[Mapping[str, Any]] = []
    for wanted in observe:
        if isinstance(wanted, str) and wanted not in OBSERVATIONS:
            raise UnknownName("observation", wanted, OBSERVATIONS)
        sensors += OBSERVATIONS[wanted] if isinstance(wanted, str) else [wanted]
    return sensors, "state" in [wanted for wanted in observe if isinstance(wanted, str)]


def _space_of(name: str, spec: Any) -> spaces.Space[Any]:
    if isinstance(spec, Mapping):
        return spaces.Dict({key: _space_of(f"{name}.{key}", part) for key, part in spec.items()})
    if not isinstance(spec, ArraySpec) or None in spec.shape or spec.dtype is str:
        raise ConfigError(f"sensor {name!r} has no fixed size: an environment can't observe it; use a raster of it.")
    shape, dtype = tuple(int(size or 0) for size in spec.shape), np.dtype(spec.dtype)
    if dtype == np.uint8:
        return spaces.Box(0, 255, shape, np.uint8)
    return spaces.Box(-np.inf, np.inf, shape, dtype.type)


def _preview(route: Route, index: int) -> NDArray[np.float64]:
    """`(len(PREVIEW), 2)` points of the route ahead [m]; beyond its end straight on."""
    wanted = route.distance[index] + np.array(PREVIEW)
    places = np.minimum(np.searchsorted(route.distance, wanted), len(route.points) - 1)
    beyond = np.maximum(wanted - route.distance[-1], 0.0)
    yaw = route.yaw[-1]
    points: NDArray[np.float64] = route.points[places, :2] + beyond[:, None] * (math.cos(yaw), math.sin(yaw))
    return points


def _light_ahead(simulation: Simulation, index: int) -> list[float]:
    """Red, yellow, green (one of them 1, or none) and the distance to the line [m] of the next light on the route."""
    route, table = simulation.route, simulation.town.lanes
    last = int(np.searchsorted(route.distance, route.distance[index] + LIGHT_REACH))
    governed = np.flatnonzero(table.light[route.lane[index:last]] >= 0)
    if not len(governed):
        return [0.0, 0.0, 0.0, LIGHT_REACH]
    at = index + int(governed[0])
    state = int(simulation.snapshot.lights[table.light[route.lane[at]]])
    lamps = [float(state == lamp) for lamp in (LightState.RED, LightState.YELLOW, LightState.GREEN)]
    return [*lamps, float(route.distance[at] - route.distance[index])]
