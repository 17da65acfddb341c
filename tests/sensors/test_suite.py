"""What is said to a malformed suite, and what a good one gives."""

from __future__ import annotations

from typing import Any

import pytest

from lavsim.errors import SensorError, UnknownName
from lavsim.random import Draws
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import LAV, find_suite
from tests.scenes import plain, street
from tests.snapshots import snapshot_of

DRAWS = Draws.of_seed(0)
CAMERA = {"type": "sensor.camera.rgb", "id": "eye", "width": 32, "height": 24, "fov": 90}


def without(key: str) -> dict[str, Any]:
    return {k: v for k, v in CAMERA.items() if k != key}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (CAMERA | {"width": 0}, r"sensor 'eye': 'width' must be 1 to 8192 pixels, got 0\."),
        (CAMERA | {"height": -5}, r"'height' must be 1 to 8192"),
        (CAMERA | {"width": 32.5}, r"'width' must be a whole number, got 32\.5"),
        (CAMERA | {"fov": 0}, r"'fov' must be more than 0 and less than 180 degrees, got 0"),
        (CAMERA | {"fov": 180}, r"less than 180 degrees, got 180"),
        (CAMERA | {"fov": "wide"}, r"'fov' must be a number, got 'wide'"),
        (CAMERA | {"x": float("nan")}, r"'x' must be finite, got nan"),
        (CAMERA | {"x": None}, r"'x' must be a number, got None"),
        (without("fov"), r"sensor 'eye' of type 'sensor\.camera\.rgb' has no 'fov'\."),
        (without("id"), r"a sensor of type 'sensor\.camera\.rgb' has no 'id'\."),
        (CAMERA | {"id": ""}, r"'id' must be a text"),
        (without("type"), r"sensor 'eye' has no 'type'\."),
        (CAMERA | {"type": "sensor.camera.rbg"}, r"no sensor .*rbg'\. Did you mean 'sensor\.camera\.rgb'"),
        ("sensor.camera.rgb", r"a sensor must be a dict"),
        ({"type": "sensor.lavsim.truth", "id": "t", "radius": 0}, r"'radius' must be positive"),
    ],
)  # fmt: skip
def test_malformed_dict_gets_one_clear_line(values: Any, message: str) -> None:
    with pytest.raises(SensorError, match=message) as caught:
        SensorSuite(plain(), [values], DRAWS)
    assert "\n" not in str(caught.value)


def test_two_sensors_may_not_share_an_id() -> None:
    with pytest.raises(SensorError, match="two sensors have the id 'eye'"):
        SensorSuite(plain(), [CAMERA, CAMERA | {"fov": 60}], DRAWS)


def test_lav_suite_reads_with_the_snapshots_tick() -> None:
    suite = SensorSuite(street(), LAV, DRAWS)
    readings = suite.read([snapshot_of(tick=6), snapshot_of(tick=7)])
    assert list(readings) == ["RGB_0", "RGB_1", "RGB_2", "TEL_RGB", "LIDAR", "GPS", "IMU", "EGO"]
    assert {frame for frame, _ in readings.values()} == {7}
    assert readings["RGB_0"][1].shape == (288, 256, 4)
    assert readings["TEL_RGB"][1].shape == (288, 480, 4)
    assert suite.history == 0


def test_unknown_suite_names_the_nearest() -> None:
    with pytest.raises(UnknownName, match="Did you mean 'lav'"):
        find_suite("lvav")
