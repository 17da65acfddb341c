"""The agent protocol: CARLA's contract, the handle a drive holds an agent by, and what can go wrong with one.

An agent is a class with `setup`, `sensors()`, `set_global_plan`, `run_step(input_data, timestamp)` and `destroy()`.
`Agent` is the base class of our own; published ones derive from `leaderboard.autoagents.autonomous_agent`, which is the
same class under CARLA's name. Handles: `lavsim.agent_runner.InProcessAgent`, and `lavsim.isolation.ChildAgent` for code
that is not ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from enum import Enum, IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lavsim.carla_types import Location, Rotation, Transform
from lavsim.drawings import Drawing
from lavsim.errors import ConfigError
from lavsim.geometry import geolocation
from lavsim.types import Control, RoadOption

if TYPE_CHECKING:
    from lavsim.map.route import Route
    from lavsim.map.town_map import TownMap

__all__ = [
    "Agent",
    "AgentFailure",
    "AgentHandle",
    "AgentPlan",
    "AgentShell",
    "AgentSpec",
    "AgentStatus",
    "Location",
    "Rotation",
    "SensorInterface",
    "Track",
    "Transform",
    "downsample_route",
    "parse_control",
    "plan_of",
]

PLAN_SPACING = {"1.0": 50.0, "2.x": 200.0}  # [m] between kept plan points, by generation of the leaderboard

Readings = Mapping[str, tuple[int, Any]]


class AgentStatus(IntEnum):
    """How an agent stands; the values are those of `Snapshot.agent_status`."""

    DRIVING = 0
    CRASHED = 1
    SETUP_FAILED = 2
    SENSORS_INVALID = 3
    TIMED_OUT = 4


class AgentFailure(Exception):  # noqa: N818 - an outcome of the drive, not a user's mistake
    """The agent is out: it raised, died, hung, or returned what no vehicle can apply. Ends its route, not the run."""

    def __init__(self, status: AgentStatus, message: str) -> None:
        line = " ".join(message.split())
        self.status = status
        self.message = line if len(line) <= 400 else line[:399] + "…"
        super().__init__(self.message)


class Track(Enum):
    """What an agent may sense; CARLA's names and values, and ours for agents that read privileged sensors."""

    SENSORS = "SENSORS"
    MAP = "MAP"
    SENSORS_QUALIFIER = "SENSORS_QUALIFIER"
    MAP_QUALIFIER = "MAP_QUALIFIER"
    PRIVILEGED = "PRIVILEGED"


@dataclass(frozen=True)
class AgentSpec:
    """Which agent to run and within what limits; plain JSON values.

    Attributes:
        target: "module:Class", "file.py" or "file.py:Class" (`lavsim.agent_source`).
        config_path: Handed to `setup` as it is.
        generation: "1.0" or "2.x": constructor, order of set-up, and spacing of the plan.
        step_timeout: Wall-clock seconds one step may take; the first has five times as long.
        setup_timeout: The same for import, construction and `setup`.
        memory_limit: Resident bytes of the agent's processes together.
        output_limit: Bytes of its output that are kept.
        drawings: Whether it is asked after each step what it shows of its inner view.
    """

    target: str
    config_path: str | None = None
    generation: str = "1.0"
    step_timeout: float = 60.0
    setup_timeout: float = 600.0
    memory_limit: int = 16 * 2**30
    output_limit: int = 10 * 10**6
    drawings: bool = False

    def __post_init__(self) -> None:
        if self.generation not in PLAN_SPACING:
            raise ConfigError(f"agent generation must be '1.0' or '2.x', got {self.generation!r}.")

    @property
    def plan_spacing(self) -> float:
        """Distance between kept plan points [m]."""
        return PLAN_SPACING[self.generation]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> AgentSpec:
        return AgentSpec(**{f.name: values[f.name] for f in fields(AgentSpec) if f.name in values})


@dataclass(frozen=True)
class AgentPlan:
    """The dense route as an agent gets it, one row a route point.

    Attributes:
        points: (R, 3) float64, world [m].
        yaw: (R,) float64 [deg].
        options: (R,) int8, `RoadOption` values.
        geo: (R, 3) float64, latitude, longitude [deg], z [m]; free of noise.
    """

    points: NDArray[np.float64]
    yaw: NDArray[np.float64]
    options: NDArray[np.int8]
    geo: NDArray[np.float64]

    @cached_property
    def gps(self) -> list[tuple[dict[str, float], RoadOption]]:
        """CARLA's list of ({"lat", "lon", "z"}, option)."""
        return [
            ({"lat": lat, "lon": lon, "z": z}, RoadOption(option))
            for (lat, lon, z), option in zip(self.geo.tolist(), self.options.tolist(), strict=True)
        ]

    @cached_property
    def world(self) -> list[tuple[Any, RoadOption]]:
        """CARLA's list of (transform, option), in the classes of `carla_classes()`: in single precision, as CARLA's own
        are, whichever they are."""
        location, rotation, transform = carla_classes()
        points, yaws = self.points.astype(np.float32).tolist(), self.yaw.astype(np.float32).tolist()
        return [
            (transform(location(x=x, y=y, z=z), rotation(yaw=yaw)), RoadOption(option))
            for (x, y, z), yaw, option in zip(points, yaws, self.options.tolist(), strict=True)
        ]

    def to_message(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}


def plan_of(route: Route, town: TownMap) -> AgentPlan:
    """The plan an agent gets for `route`."""
    points = np.asarray(route.points, dtype=np.float64)
    lat, lon = geolocation(points[:, 0], points[:, 1], *town.geo_reference)
    return AgentPlan(
        points=points,
        yaw=np.degrees(route.yaw),
        options=np.asarray(route.command, dtype=np.int8),
        geo=np.stack([lat, lon, points[:, 2]], axis=1),
    )


def carla_classes() -> tuple[type[Any], type[Any], type[Any]]:
    """Location, Rotation, Transform: CARLA's own where its package is installed, ours otherwise."""
    try:
        import carla  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        return Location, Rotation, Transform
    return carla.Location, carla.Rotation, carla.Transform


def downsample_route(route: Sequence[tuple[Any, Any]], sample_factor: float) -> list[int]:
    """Indices of the plan points an agent keeps.

    Args:
        route: (transform, option) pairs, dense.
        sample_factor: Distance after which a point is kept [m]. Summed over points that are NOT kept only, so
            on a 1 m route points lie 52 m apart for 50.

    Source: the leaderboard's `route_manipulation` (reference `leaderboard.md` 3.5); both generations give the same.
    """
    kept: list[int] = []
    previous: Any = None
    distance = 0.0
    for index, (transform, option) in enumerate(route):
        is_change = option in (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)
        was_change = previous in (RoadOption.CHANGELANELEFT, RoadOption.CHANGELANERIGHT)
        if is_change or (previous != option and not was_change) or distance > sample_factor or index == len(route) - 1:
            kept.append(index)
            distance = 0.0
        else:
            distance += _single_distance(transform.location, route[index - 1][0].location)
        previous = option
    return kept


def _single_distance(a: Any, b: Any) -> float:
    """What `carla.Location.distance` says [m], in single precision; ours would keep other points where metres add up to
    the very limit."""
    ahead, aside, up = (np.float32(getattr(a, axis)) - np.float32(getattr(b, axis)) for axis in "xyz")
    return float(np.sqrt(ahead * ahead + aside * aside + up * up))


class SensorInterface:
    """Where `Agent.__call__` takes its readings from: the tick's, complete, put there by the handle."""

    def __init__(self) -> None:
        self._readings: dict[str, tuple[int, Any]] = {}
        self._time = 0.0

    def feed(self, readings: dict[str, tuple[int, Any]], time: float) -> None:
        """Takes in the readings of the tick at `time` [s]."""
        self._readings, self._time = readings, time

    def get_data(self, frame: int | None = None) -> dict[str, tuple[int, Any]]:
        """{id: (frame, data)}; `frame` is accepted as in 2.x, where all readings belong to it anyway."""
        return self._readings

    @property
    def time(self) -> float:
        """Simulation time of the readings [s]."""
        return self._time


class Agent:
    """Base class of agents, with CARLA's contract.

    Constructed as in 1.0, `Agent(path_to_conf_file)`, it calls `setup` at once; as in 2.x, `Agent(carla_host,
    carla_port, debug)`, it waits: the plan comes first there, then `setup`.
    """

    plan_spacing = PLAN_SPACING["1.0"]

    def __init__(self, path_or_host: str | None = "", carla_port: int | None = None, debug: bool = False) -> None:
        self.track = Track.SENSORS
        self._global_plan: list[tuple[dict[str, float], RoadOption]] | None = None
        self._global_plan_world_coord: list[tuple[Any, RoadOption]] | None = None
        self.sensor_interface = SensorInterface()
        self.wallclock_t0: float | None = None
        if carla_port is None:
            self.setup(path_or_host)

    def setup(self, path_to_conf_file: str | None) -> None:
        """Loads what the agent needs; sets `self.track`."""

    def sensors(self) -> list[dict[str, Any]]:
        """The sensors it wants, in the leaderboard's dictionaries."""
        return []

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Any:
        """The control for this tick: anything with throttle, steer and brake."""
        raise NotImplementedError(f"{type(self).__name__} has no run_step")

    def drawings(self) -> dict[str, Drawing]:
        """What to show of its inner view after a step, by name (`lavsim.drawings`); asked only with `--drawings`."""
        return {}

    def destroy(self) -> None:
        """Called once after the route."""

    def __call__(self) -> Any:
        """One step on the readings of the tick."""
        control = self.run_step(self.sensor_interface.get_data(), self.sensor_interface.time)
        if hasattr(control, "manual_gear_shift"):
            control.manual_gear_shift = False
        return control

    def set_global_plan(
        self, global_plan_gps: list[tuple[dict[str, float], Any]], global_plan_world_coord: list[tuple[Any, Any]]
    ) -> None:
        """Keeps a subset of the dense plan, by `downsample_route`."""
        kept = downsample_route(global_plan_world_coord, self.plan_spacing)
        self._global_plan_world_coord = [global_plan_world_coord[i] for i in kept]
        self._global_plan = [global_plan_gps[i] for i in kept]


def parse_control(value: Any) -> Control:
    """What an agent returned as a `Control`, clipped to the ranges of CARLA's `VehicleControl`.

    Raises:
        AgentFailure: `value` is None, lacks an attribute, or holds text or NaN.
    """
    if value is None:
        raise AgentFailure(AgentStatus.CRASHED, "run_step returned None instead of a control")
    return Control(
        throttle=_number(value, "throttle", 0.0),
        steer=_number(value, "steer", -1.0),
        brake=_number(value, "brake", 0.0),
        hand_brake=_flag(value, "hand_brake"),
        reverse=_flag(value, "reverse"),
    )


def _number(control: Any, name: str, low: float) -> float:
    try:
        value = getattr(control, name)
    except AttributeError:
        kind = type(control).__name__
        raise AgentFailure(
            AgentStatus.CRASHED, f"run_step returned {kind}, which has no {name!r}; a vehicle control is expected"
        ) from None
    if isinstance(value, str | bytes) or value is None:
        raise AgentFailure(AgentStatus.CRASHED, f"run_step returned a control with {name}={value!r}, not a number")
    try:
        number = float(value)
    except (TypeError, ValueError):
        kind = type(value).__name__
        raise AgentFailure(
            AgentStatus.CRASHED, f"run_step returned a control whose {name} is a {kind}, not a number"
        ) from None
    if math.isnan(number):
        raise AgentFailure(AgentStatus.CRASHED, f"run_step returned a control with {name}=nan")
    return min(max(number, low), 1.0)


def _flag(control: Any, name: str) -> bool:
    value = getattr(control, name, False)
    try:
        return bool(value)
    except (TypeError, ValueError):
        raise AgentFailure(
            AgentStatus.CRASHED, f"run_step returned a control whose {name} is a {type(value).__name__}, not a flag"
        ) from None


class AgentHandle(Protocol):
    """How a drive holds an agent: `start`, then `track` and `sensors()`, then `step` each tick, and always `close`.

    Every method but `close` may raise `AgentFailure`; after that only `close` is called.
    """

    @property
    def track(self) -> Track:
        """The track the agent chose in `setup`; known once started."""

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        """Constructs the agent for one route and gives it the plan; `spacing` [m] overrides its generation's."""

    def sensors(self) -> list[dict[str, Any]]:
        """The sensors it asks for; known once started."""

    def step(self, readings: Readings, time: float) -> Control:
        """The control for the tick at `time` [s]; the agent may keep and change what it was given."""

    def close(self) -> None:
        """Destroys the agent; nothing of it is left running. May be called twice."""


class AgentShell:
    """What stands around an agent and passes everything on; the step is for who derives from it.

    Args:
        agent: Who is inside.
    """

    def __init__(self, agent: AgentHandle) -> None:
        self._agent = agent

    @property
    def track(self) -> Track:
        return self._agent.track

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        self._agent.start(plan, spacing)

    def sensors(self) -> list[dict[str, Any]]:
        return self._agent.sensors()

    def close(self) -> None:
        self._agent.close()
