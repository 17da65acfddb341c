"""Named sensor suites, as the dicts that an agent's `sensors()` returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lavsim.errors import UnknownName

SensorDict = dict[str, Any]


def _camera(name: str, yaw: float, width: int, height: int, fov: float) -> SensorDict:
    return {
        "type": "sensor.camera.rgb", "id": name, "x": 1.5, "y": 0.0, "z": 2.4, "roll": 0.0, "pitch": 0.0, "yaw": yaw,
        "width": width, "height": height, "fov": fov,
    }  # fmt: skip


def _mounted(kind: str, name: str) -> SensorDict:
    return {"type": kind, "id": name, "x": 0.0, "y": 0.0, "z": 2.4, "roll": 0.0, "pitch": 0.0, "yaw": 0.0}


# Source: LAV's agent, v1 (reference `lav.md` 2.1), with its ids.
LAV: tuple[SensorDict, ...] = (
    _camera("RGB_0", -60.0, 256, 288, 64.0),
    _camera("RGB_1", 0.0, 256, 288, 64.0),
    _camera("RGB_2", 60.0, 256, 288, 64.0),
    _camera("TEL_RGB", 0.0, 480, 288, 40.0),
    _mounted("sensor.lidar.ray_cast", "LIDAR"),
    {"type": "sensor.other.gnss", "id": "GPS", "x": 0.0, "y": 0.0, "z": 2.4},
    _mounted("sensor.other.imu", "IMU"),
    {"type": "sensor.speedometer", "id": "EGO"},
)

SUITES: dict[str, tuple[SensorDict, ...]] = {"lav": LAV}


def find_suite(name: str) -> tuple[SensorDict, ...]:
    """The suite called `name`.

    Raises:
        UnknownName: there is none; the message names the nearest.
    """
    try:
        return SUITES[name]
    except KeyError:
        raise UnknownName("sensor suite", name, SUITES) from None


def with_look(suite: Sequence[Mapping[str, Any]], look: str) -> tuple[SensorDict, ...]:
    """The suite with its colour cameras in `look`, but for those whose attributes name one."""
    return tuple(
        {**values, "attributes": {"look": look, **values.get("attributes", {})}}
        if values.get("type") == "sensor.camera.rgb"
        else dict(values)
        for values in suite
    )
