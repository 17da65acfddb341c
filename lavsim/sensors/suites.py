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


def _with_tags(colour: SensorDict, name: str) -> tuple[SensorDict, SensorDict]:
    """A colour camera and one of class tags on the same mount: one pass gives both."""
    tags = {**colour, "type": "sensor.camera.semantic_segmentation", "id": name}
    return colour, tags


# What a dataset keeps of every frame. Source: LAV's recorder (reference `lav.md` 2.1, 3.1). GNSS, IMU, speedometer and
# LiDAR have the ids of the agent's suite and so its noise.
LAV_DATA: tuple[SensorDict, ...] = (
    *(
        sensor
        for k in range(5)
        for sensor in _with_tags(_camera(f"RGB_{k}", -120.0 + 60.0 * k, 256, 288, 64.0), f"SEM_{k}")
    ),
    *_with_tags(_camera("TEL_RGB", 0.0, 480, 288, 40.0), "TEL_SEM"),
    _mounted("sensor.lidar.ray_cast", "LIDAR"),
    {"type": "sensor.lavsim.bev", "id": "BEV"},
    {"type": "sensor.other.gnss", "id": "GPS", "x": 0.0, "y": 0.0, "z": 2.4},
    _mounted("sensor.other.imu", "IMU"),
    {"type": "sensor.speedometer", "id": "EGO"},
)

SUITES: dict[str, tuple[SensorDict, ...]] = {"lav": LAV, "lav_data": LAV_DATA}


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
