"""What a sensor is, and the suite that reads many of them at one tick.

A sensor keeps no state: a reading is a function of snapshots, scene and draws, so any tick can be rendered in any
order, live or from a log, and comes out as the same bytes. A plug-in is one file in this package that registers a
class under CARLA's type string; it declares its own config, spec and history.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import DTypeLike

from lavsim.errors import SensorError, UnknownName
from lavsim.random import Draws
from lavsim.registry import Registry
from lavsim.render.frame import Mount
from lavsim.render.scene import Scene
from lavsim.world.snapshot import Snapshot

DEGREES = "degrees"  # metadata of config fields that are degrees in the dict and radians here
ATTRIBUTE = "attribute"  # metadata of config fields that stand in the dict's "attributes", and by which name


@dataclass(frozen=True)
class ArraySpec:
    """Shape and type of one array of a reading.

    Attributes:
        shape: Sizes; None where a size differs from reading to reading.
        dtype: Type of an entry; `str` for text.
        unit: Of the values, for people.
        codec: How blobs are stored: "npy", "png", "jpeg", "json", "text".
    """

    shape: tuple[int | None, ...]
    dtype: DTypeLike
    unit: str = ""
    codec: str = "npy"

    def mismatch(self, data: Any) -> str | None:
        """Why `data` is not of this spec; None if it is."""
        if self.dtype is str:
            return None if isinstance(data, str) else f"expected text, got {type(data).__name__}"
        array = np.asarray(data)
        if array.dtype != np.dtype(self.dtype):
            return f"expected {np.dtype(self.dtype)}, got {array.dtype}"
        fits = array.ndim == len(self.shape) and all(
            want is None or want == got for want, got in zip(self.shape, array.shape, strict=True)
        )
        return None if fits else f"expected shape {self.shape}, got {array.shape}"


Spec = ArraySpec | Mapping[str, ArraySpec]  # a dict of arrays has a dict of specs


@dataclass(frozen=True)
class SensorConfig:
    """What every sensor's dict has; keys that no field is named after are ignored, as the leaderboard does.

    What the leaderboard's wrapper fixes (a LiDAR's channels, the range of a radar …) is no key of the dict either: such
    keys are ignored. To choose it all the same, give CARLA's names in a dict of their own:
    `{"type": "sensor.lidar.ray_cast", "id": "top", "attributes": {"channels": 32, "range": 50}}`; there an unknown name
    is an error.

    Attributes:
        type: CARLA's type string.
        id: Name of the reading in the agent's input.
        x, y, z: Mount ahead, right, up of the ego's origin (box centre in plan, ground level) [m].
        roll, pitch, yaw: [rad] (degrees in the dict), as in `lavsim.render.frame.rotation`.
    """

    type: str
    id: str
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = field(default=0.0, metadata={DEGREES: True})
    pitch: float = field(default=0.0, metadata={DEGREES: True})
    yaw: float = field(default=0.0, metadata={DEGREES: True})

    @classmethod
    def parse(cls, values: Mapping[str, Any]) -> Self:
        """The config in a sensor dict.

        Raises:
            SensorError: a key is missing or its value is out of range.
        """
        name = f"sensor {values.get('id')!r}" if "id" in values else "a sensor"
        extra = _attributes(name, cls, values.get("attributes", {}))
        found: dict[str, Any] = {}
        for item in fields(cls):
            source, key = (extra, item.metadata[ATTRIBUTE]) if ATTRIBUTE in item.metadata else (values, item.name)
            if key not in source:
                if item.default is MISSING:
                    raise SensorError(f"{name} of type {values.get('type')!r} has no {item.name!r}.")
                continue
            found[item.name] = _value(name, key, item.type, source[key])
            if item.metadata.get(DEGREES):
                found[item.name] = math.radians(found[item.name])
        config = cls(**found)
        problem = config.problem()
        if problem is not None:
            raise SensorError(f"{name}: {problem}.")
        return config

    def problem(self) -> str | None:
        """What is wrong with the values; None if nothing is."""
        return None

    @property
    def mount(self) -> Mount:
        return Mount(self.x, self.y, self.z, self.roll, self.pitch, self.yaw)


def attribute(name: str, default: Any) -> Any:
    """A config field that is given as `name` in a dict's "attributes"."""
    return field(default=default, kw_only=True, metadata={ATTRIBUTE: name})


def _attributes(sensor: str, config: type[SensorConfig], given: Any) -> dict[str, Any]:
    """The dict's "attributes"; numbers may be texts, as CARLA's `set_attribute` takes them."""
    if not isinstance(given, Mapping):
        raise SensorError(f"{sensor}: 'attributes' must be a dict, got {given!r}.")
    known = [item.metadata[ATTRIBUTE] for item in fields(config) if ATTRIBUTE in item.metadata]
    found: dict[str, Any] = {}
    for key, value in given.items():
        if key not in known:
            raise SensorError(str(UnknownName(f"attribute of {sensor}", str(key), known)))
        found[key] = _number(value) if isinstance(value, str) else value
    return found


def _number(text: str) -> Any:
    words = {"true": True, "false": False}
    try:
        return words[text.lower()] if text.lower() in words else float(text)
    except ValueError:
        return text


def _value(sensor: str, key: str, kind: Any, value: Any) -> Any:
    """`value` as the type a config field is annotated with."""
    if kind == "bool":
        if not isinstance(value, bool):
            raise SensorError(f"{sensor}: {key!r} must be true or false, got {value!r}.")
        return value
    if kind == "str":
        if not isinstance(value, str) or not value:
            raise SensorError(f"{sensor}: {key!r} must be a text, got {value!r}.")
        return value
    if isinstance(value, bool | str) or not np.isscalar(value):
        raise SensorError(f"{sensor}: {key!r} must be a number, got {value!r}.")
    number = float(value)  # type: ignore[arg-type]
    if not math.isfinite(number):
        raise SensorError(f"{sensor}: {key!r} must be finite, got {value!r}.")
    if kind == "int":
        if number != int(number):
            raise SensorError(f"{sensor}: {key!r} must be a whole number, got {value!r}.")
        return int(number)
    return number


class Sensor:
    """One sensor of a suite.

    Attributes:
        config_type: Fields of its dict.
        history: How many snapshots before the current one it reads.
        privileged: Whether it tells what no sensor could know; the SENSORS track refuses it.
        config: Its own values.
    """

    config_type: ClassVar[type[SensorConfig]] = SensorConfig
    history: int = 0
    privileged: ClassVar[bool] = False

    def __init__(self, config: SensorConfig) -> None:
        self.config = config

    @property
    def spec(self) -> Spec:
        """What `read` gives."""
        raise NotImplementedError

    def read(self, history: Sequence[Snapshot], scene: Scene, draws: Draws) -> Any:
        """The reading at the newest snapshot.

        Args:
            history: Snapshots, newest last; at least one, at most `self.history` + 1 are looked at.
            scene: What there is to see.
            draws: Root of the drive's draws; a sensor uses `self.draws(draws)`.
        """
        raise NotImplementedError

    def draws(self, root: Draws) -> Draws:
        """The stream of this sensor, by its id."""
        return root.stream(f"sensor:{self.config.id}")


SENSORS: Registry[type[Sensor]] = Registry("sensor", "lavsim.sensors")


def make_sensor(values: Mapping[str, Any]) -> Sensor:
    """The sensor that a dict asks for.

    Raises:
        SensorError: the dict is malformed or its type unknown; the message names the nearest type.
    """
    if not isinstance(values, Mapping):
        raise SensorError(f"a sensor must be a dict with 'type' and 'id', got {values!r}.")
    kind = values.get("type")
    if not isinstance(kind, str):
        raise SensorError(f"sensor {values.get('id')!r} has no 'type'.")
    try:
        sensor = SENSORS[kind]
    except UnknownName as unknown:
        raise SensorError(str(unknown)) from None
    return sensor(sensor.config_type.parse(values))


class SensorSuite:
    """The sensors of an agent.

    Args:
        scene: What they see.
        dicts: One dict a sensor, as `sensors()` of a CARLA agent returns them.
        draws: Root of the drive's draws.

    Raises:
        SensorError: a dict is malformed, or two sensors have one id.
    """

    def __init__(self, scene: Scene, dicts: Sequence[Mapping[str, Any]], draws: Draws) -> None:
        self.sensors = tuple(make_sensor(values) for values in dicts)
        self._scene, self._draws = scene, draws
        seen: set[str] = set()
        for sensor in self.sensors:
            if sensor.config.id in seen:
                raise SensorError(f"two sensors have the id {sensor.config.id!r}.")
            seen.add(sensor.config.id)

    @property
    def history(self) -> int:
        """How many snapshots before the current one `read` needs."""
        return max((sensor.history for sensor in self.sensors), default=0)

    @property
    def specs(self) -> dict[str, Spec]:
        """What each reading is, by id."""
        return {sensor.config.id: sensor.spec for sensor in self.sensors}

    def read(self, history: Sequence[Snapshot]) -> dict[str, tuple[int, Any]]:
        """All readings of the newest snapshot (last in `history`): {id: (frame, data)}, the frame being its tick."""
        frame = history[-1].tick
        return {s.config.id: (frame, s.read(history, self._scene, self._draws)) for s in self.sensors}
