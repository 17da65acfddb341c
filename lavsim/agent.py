"""The agent protocol: CARLA's contract, the handle a drive holds an agent by, and what can go wrong with one.

An agent is a class with `setup`, `sensors()`, `set_global_plan`, `run_step(input_data, timestamp)` and `destroy()`.
`Agent` is the base class of our own; published ones derive from `leaderboard.autoagents.autonomous_agent`, which is the
same class under CARLA's name. Handles: `InProcessAgent` here, `lavsim.isolation.ChildAgent` for code that is not ours.
"""

from __future__ import annotations

import copy
import inspect
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from enum import Enum, IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lavsim.agent_source import find_agent, load_agent_class
from lavsim.carla_types import Location, Rotation, Transform
from lavsim.drawings import Drawing, checked_all
from lavsim.errors import AgentError, ConfigError
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
    "AgentSpec",
    "AgentStatus",
    "InProcessAgent",
    "Location",
    "Rotation",
    "SensorInterface",
    "Track",
    "Transform",
    "downsample_route",
    "find_agent",
    "load_agent_class",
    "parse_control",
    "plan_of",
]

PLAN_SPACING = {"1.0": 50.0, "2.x": 200.0}  # [m] between kept plan points, by generation of the leaderboard

Readings = Mapping[str, tuple[int, Any]]
_IMMUTABLE = (bool, int, float, str, bytes, type(None))


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
        """CARLA's list of (transform, option), in the classes of `carla_classes()`."""
        location, rotation, transform = carla_classes()
        return [
            (transform(location(x=x, y=y, z=z), rotation(yaw=yaw)), RoadOption(option))
            for (x, y, z), yaw, option in zip(
                self.points.tolist(), self.yaw.tolist(), self.options.tolist(), strict=True
            )
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
            distance += transform.location.distance(route[index - 1][0].location)
        previous = option
    return kept


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


class AgentRunner:
    """One agent through one route, in the process that runs its code: what both handles share."""

    def __init__(self, spec: AgentSpec, agent_class: type[Any] | None = None) -> None:
        self.spec = spec
        self._class = agent_class
        self._agent: Any = None
        self._told = False
        self.track = Track.SENSORS
        self.sensors: list[dict[str, Any]] = []

    def start(self, plan: AgentPlan, spacing: float) -> None:
        """Loads, constructs, plans and sets up in the order of the spec's generation.

        Raises:
            AgentFailure: SETUP_FAILED, or SENSORS_INVALID for sensors that are no list of dictionaries.
        """
        try:
            agent_class = self._class or load_agent_class(self.spec.target)
            agent, waits_for_setup = _construct(agent_class, self.spec)
            self._agent = agent
            if hasattr(agent, "set_global_plan"):
                if isinstance(agent, Agent):
                    agent.plan_spacing = spacing
                agent.set_global_plan(plan.gps, plan.world)
            if waits_for_setup:
                agent.setup(self.spec.config_path)
            self.track = _track_of(getattr(agent, "track", Track.SENSORS))
            sensors = agent.sensors()
        except BaseException as error:
            raise _failure(AgentStatus.SETUP_FAILED, "set-up", error) from error
        if not isinstance(sensors, list | tuple) or not all(isinstance(s, Mapping) for s in sensors):
            raise AgentFailure(AgentStatus.SENSORS_INVALID, "sensors() returned no list of dictionaries")
        self.sensors = [dict(sensor) for sensor in sensors]

    def step(self, readings: dict[str, tuple[int, Any]], time: float) -> Control:
        agent = self._agent
        try:
            if isinstance(agent, Agent):
                agent.sensor_interface.feed(readings, time)
                control = agent()
            else:
                control = agent.run_step(readings, time)
        except BaseException as error:
            raise _failure(AgentStatus.CRASHED, "run_step", error) from error
        return parse_control(control)

    def drawings(self) -> dict[str, Drawing]:
        """What the agent shows after its step; nothing, and a word in its output, if that is no drawing."""
        if not self.spec.drawings or not hasattr(self._agent, "drawings"):
            return {}
        try:
            return checked_all(self._agent.drawings())
        except Exception as error:  # a picture that fails must not end a drive
            if not self._told:
                print(f"drawings() failed, nothing is shown: {type(error).__name__}: {error}", file=sys.stderr)
            self._told = True
            return {}

    def labels(self) -> Mapping[str, Any]:
        """What the agent says of its driving, of the last step; nothing if it has no `labels()`."""
        labels: Mapping[str, Any] = self._agent.labels() if hasattr(self._agent, "labels") else {}
        return labels

    def close(self) -> None:
        """Calls `destroy` of an agent that was constructed.

        Raises:
            AgentFailure: `destroy` raised.
        """
        agent, self._agent = self._agent, None
        if agent is not None and hasattr(agent, "destroy"):
            try:
                agent.destroy()
            except BaseException as error:
                raise _failure(AgentStatus.CRASHED, "destroy", error) from error


class InProcessAgent:
    """An agent of our own in this very process: for collection and tests. Foreign code goes into a `ChildAgent`."""

    def __init__(self, spec: AgentSpec | type[Any], config_path: str | None = None) -> None:
        if isinstance(spec, AgentSpec):
            self._runner = AgentRunner(spec)
        else:
            target = f"{spec.__module__}:{spec.__qualname__}"
            self._runner = AgentRunner(AgentSpec(target, config_path=config_path), spec)

    @property
    def track(self) -> Track:
        return self._runner.track

    def start(self, plan: AgentPlan, spacing: float | None = None) -> None:
        self._runner.start(plan, self._runner.spec.plan_spacing if spacing is None else spacing)

    def sensors(self) -> list[dict[str, Any]]:
        return copy.deepcopy(self._runner.sensors)

    def step(self, readings: Readings, time: float) -> Control:
        return self._runner.step({name: (frame, _copied(data)) for name, (frame, data) in readings.items()}, time)

    def drawings(self) -> dict[str, Drawing]:
        """What the agent shows after its last step."""
        return self._runner.drawings()

    def labels(self) -> Mapping[str, Any]:
        """What the agent says of its driving, of its last step: its `labels()`, for recorders."""
        return self._runner.labels()

    def close(self) -> None:
        self._runner.close()


def _copied(data: Any) -> Any:
    if isinstance(data, np.ndarray):
        return data.copy()
    if type(data) is dict:  # `deepcopy` of a dictionary of arrays takes five times as long
        return {key: _copied(value) for key, value in data.items()}
    return data if isinstance(data, _IMMUTABLE) else copy.deepcopy(data)


def _construct(agent_class: type[Any], spec: AgentSpec) -> tuple[Any, bool]:
    """A new agent, and whether `setup` is still to be called, after the plan.

    The rules' generation decides between the two constructors, unless the class's own fits only one of them.
    """
    accepted = required = 0
    for parameter in inspect.signature(agent_class).parameters.values():
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            accepted = 99
        elif parameter.kind in (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD):
            accepted += 1
            required += parameter.default is inspect.Parameter.empty
    if accepted == 0:
        return agent_class(), hasattr(agent_class, "setup")
    if required >= 2 or (accepted >= 2 and spec.generation == "2.x"):
        return agent_class(*("localhost", 2000, False)[:accepted]), True
    return agent_class(spec.config_path), False


def _track_of(value: Any) -> Track:
    text = getattr(value, "value", value)
    try:
        return Track(text)
    except ValueError:
        raise AgentError(f"track {text!r} is none of {', '.join(t.value for t in Track)}.") from None


def _failure(status: AgentStatus, where: str, error: BaseException) -> AgentFailure:
    if isinstance(error, AgentFailure):
        return error
    if isinstance(error, AgentError):
        return AgentFailure(status, str(error))
    text = str(error)
    return AgentFailure(status, f"{where} raised {type(error).__name__}{f': {text}' if text else ''}")
