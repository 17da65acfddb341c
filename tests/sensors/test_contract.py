"""What every registered sensor keeps: its spec, finite values, no state, no effect on others."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import MISSING, fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.sensors.base import SENSORS, ArraySpec, Sensor, SensorSuite, make_sensor
from lavsim.types import ActorClass
from lavsim.world.snapshot import Snapshot
from tests.scenes import street
from tests.snapshots import EGO, Body, snapshot_of

DRAWS = Draws.of_seed(3)
CAMERA = {"width": 48, "height": 40, "fov": 70.0}


class _Town:
    name, digest, xodr, geo_reference, lights, marks = "Street", "0", "<OpenDRIVE/>", (0.0, 0.0), (), ()
    bounds, crosswalks, signs = np.array([-50.0, -20.0, 50.0, 20.0]), (), ()
    lanes = SimpleNamespace(type=np.zeros(0, np.int32), speed_limit=np.zeros(0), junction=np.zeros(0, np.int32))


def scene() -> Scene:
    known = street()
    known._town = _Town()  # type: ignore[assignment]
    return known


def dict_of(kind: str) -> dict[str, Any]:
    mount = {"x": 0.7, "y": -0.2, "z": 2.2, "roll": 2.0, "pitch": -3.0, "yaw": 30.0}
    values = {"type": kind, "id": "probe", **mount, "sensor_tick": 0.05}
    known = SENSORS[kind].config_type
    required = {f.name for f in fields(known) if f.default is MISSING}
    return values | {key: value for key, value in CAMERA.items() if key in required}


def drive(count: int = 4) -> list[Snapshot]:
    walker = Body(100000, 9.0, 3.0, kind=ActorClass.WALKER, size=(0.4, 0.4, 1.8), blueprint="walker.pedestrian.0001")
    return [
        snapshot_of([EGO, Body(1000, 14.0 + tick, 0.0, yaw=0.2, speed=6.0), walker], tick=tick, lights=[tick % 3],
                    ego_motion=(0.5, -0.2, 0.0, 0.0, 0.0, 0.1))
        for tick in range(count)
    ]  # fmt: skip


def mismatches(sensor: Sensor, data: Any) -> list[str]:
    if isinstance(sensor.spec, ArraySpec):
        return [m for m in [sensor.spec.mismatch(data)] if m]
    assert isinstance(data, Mapping)
    assert set(data) == set(sensor.spec)
    return [f"{key}: {m}" for key, spec in sensor.spec.items() if (m := spec.mismatch(data[key]))]


def numbers(data: Any) -> list[np.ndarray]:
    values = list(data.values()) if isinstance(data, Mapping) else [data]
    arrays = [np.asarray(v) for v in values if not isinstance(v, str)]
    return [a for a in arrays if a.dtype.kind == "f"]


def same(a: Any, b: Any) -> bool:
    return pickle.dumps(a) == pickle.dumps(b)


@pytest.mark.parametrize("kind", list(SENSORS))
def test_reading_matches_its_spec_and_is_finite(kind: str) -> None:
    sensor = make_sensor(dict_of(kind))
    history = drive(1 + sensor.history)
    data = sensor.read(history, scene(), DRAWS)
    assert mismatches(sensor, data) == []
    assert all(np.isfinite(a).all() for a in numbers(data))


@pytest.mark.parametrize("kind", list(SENSORS))
def test_readings_are_the_same_in_any_order_and_again(kind: str) -> None:
    snapshots = drive(4)
    forward = {t: make_sensor(dict_of(kind)).read(snapshots[: t + 1], scene(), DRAWS) for t in range(4)}
    sensor = make_sensor(dict_of(kind))
    for t in (3, 0, 2, 1, 3):
        assert same(sensor.read(snapshots[: t + 1], scene(), DRAWS), forward[t])


@pytest.mark.parametrize("kind", list(SENSORS))
def test_another_sensor_changes_no_reading(kind: str) -> None:
    alone = SensorSuite(scene(), [dict_of(kind)], DRAWS).read(drive(2))
    others = [dict_of(k) | {"id": f"other {i}"} for i, k in enumerate(SENSORS)]
    assert same(SensorSuite(scene(), [*others, dict_of(kind)], DRAWS).read(drive(2))["probe"], alone["probe"])


@pytest.mark.parametrize("kind", list(SENSORS))
def test_a_reading_is_its_takers_to_change(kind: str) -> None:
    sensor, snapshots = make_sensor(dict_of(kind)), drive(2)
    first = sensor.read(snapshots, scene(), DRAWS)
    kept = pickle.dumps(first)
    for array in first.values() if isinstance(first, Mapping) else [first]:
        if isinstance(array, np.ndarray) and array.size:
            array.fill(0) if array.dtype.names is None else None
    assert pickle.dumps(sensor.read(snapshots, scene(), DRAWS)) == kept


def test_noise_belongs_to_the_sensors_id_and_the_drives_seed() -> None:
    values, snapshots = dict_of("sensor.other.gnss"), drive(1)
    read = [
        make_sensor(values | {"id": name}).read(snapshots, scene(), Draws.of_seed(seed))
        for name, seed in (("a", 0), ("b", 0), ("a", 1))
    ]
    assert len({r.tobytes() for r in read}) == 3
