"""Which sensors an agent may have on its track."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from lavsim.agent import AgentFailure, AgentStatus, Track
from leaderboard.rules import Rules

_QUALIFIERS = (Track.SENSORS_QUALIFIER, Track.MAP_QUALIFIER)


def check_sensors(sensors: Sequence[Mapping[str, Any]], track: Track, expected: str | None, rules: Rules) -> None:
    """Refuses a suite that breaks the rules; on the track PRIVILEGED everything is allowed.

    Args:
        sensors: The agent's dictionaries.
        track: The agent's track.
        expected: The track the user asked for; None: any.
        rules: Give the limits.

    Raises:
        AgentFailure: SENSORS_INVALID, with the first thing that is wrong.
    """
    if expected is not None and track.value != expected:
        raise _invalid(f"the agent is on track {track.value}, {expected} was asked for")
    ids = [str(sensor.get("id", "")) for sensor in sensors]
    for sensor, name in zip(sensors, ids, strict=True):
        if not sensor.get("type") or not name:
            raise _invalid(f"a sensor without type or id: {dict(sensor)}")
        if ids.count(name) > 1:
            raise _invalid(f"two sensors have the id {name!r}")
    if track is Track.PRIVILEGED:
        return
    limits = rules.qualifier_limits if track in _QUALIFIERS else rules.sensor_limits
    for sensor, name in zip(sensors, ids, strict=True):
        kind = str(sensor["type"])
        if kind not in limits:
            raise _invalid(f"sensor {name!r}: {kind} is not allowed on track {track.value}")
        if kind == "sensor.opendrive_map" and track is Track.SENSORS:
            raise _invalid(f"sensor {name!r}: {kind} is not allowed on track SENSORS")
        if sensor.get("attributes"):
            raise _invalid(f"sensor {name!r}: its attributes are fixed on track {track.value}")
        reach = _mount_distance(sensor, name)
        if reach > rules.mount_radius:
            raise _invalid(f"sensor {name!r} is mounted {reach:.2f} m from the ego, {rules.mount_radius} m at most")
    for kind, count in Counter(str(sensor["type"]) for sensor in sensors).items():
        if count > limits[kind]:
            raise _invalid(f"{count} sensors of type {kind}, {limits[kind]} at most")


def _mount_distance(sensor: Mapping[str, Any], name: str) -> float:
    if not all(axis in sensor for axis in "xyz"):
        return 0.0
    try:
        return math.hypot(*(float(sensor[axis]) for axis in "xyz"))
    except (TypeError, ValueError):
        raise _invalid(f"sensor {name!r}: its mount is not three numbers") from None


def _invalid(message: str) -> AgentFailure:
    return AgentFailure(AgentStatus.SENSORS_INVALID, message)
