"""Cameras: their geometry, their formats, and what their dicts may hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.errors import SensorError
from lavsim.random import Draws
from lavsim.render.scene import Scene
from lavsim.render.tags import NEW_TAG
from lavsim.sensors.base import make_sensor
from lavsim.sensors.camera import ColourCamera
from lavsim.sensors.suites import LAV, with_look
from lavsim.types import ActorClass, Tag
from tests.prisms import box
from tests.scenes import plain, street
from tests.snapshots import EGO, Body, snapshot_of

DRAWS = Draws.of_seed(0)
LENS = {"x": 1.5, "z": 2.4, "width": 96, "height": 80, "fov": 70}


def image(kind: str, scene: Scene, bodies: list[Body] | None = None, **keys: Any) -> np.ndarray:
    sensor = make_sensor({"type": f"sensor.camera.{kind}", "id": "eye", **LENS, **keys})
    reading: np.ndarray = sensor.read([snapshot_of(bodies or [EGO])], scene, DRAWS)
    return reading


def depths(code: np.ndarray) -> np.ndarray:
    blue, green, red = (code[..., c].astype(np.float64) for c in range(3))
    metres: np.ndarray = (red + 256.0 * green + 65536.0 * blue) / (2**24 - 1) * 1000.0
    return metres


def test_rolling_to_the_right_turns_the_picture_to_the_left() -> None:
    tags = image("semantic_segmentation", street(), roll=30)[..., 2]
    slope = np.tan(np.radians(30.0))
    for column in (10, 48, 86):
        horizon = 40.0 - (column - 48.0) * slope  # right side down: the horizon rises to the right
        rows = np.arange(80)
        assert (tags[rows < horizon - 3, column] != Tag.ROAD).all()
        assert (tags[rows > horizon + 2, column] != Tag.SKY).all()


def test_pitching_up_lowers_the_horizon() -> None:
    for pitch, row in ((0.0, 40.0), (10.0, 40.0 + 68.55 * np.tan(np.radians(10.0)))):
        tags = image("semantic_segmentation", plain(), pitch=pitch)[..., 2]
        assert abs((tags[:, 48] == Tag.SKY).sum() - row) <= 1


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-60.0, 60.0), st.floats(-40.0, 40.0), st.floats(-180.0, 180.0), st.floats(20.0, 130.0),
    st.integers(20, 90), st.integers(20, 90),
)  # fmt: skip
def test_any_camera_sees_points_where_it_projects_them(
    roll: float, pitch: float, yaw: float, fov: float, width: int, height: int
) -> None:
    keys = {"width": width, "height": height, "fov": fov, "roll": roll, "pitch": pitch, "yaw": yaw, "z": 3.0}
    sensor = make_sensor({"type": "sensor.camera.rgb", "id": "eye", **keys})
    assert isinstance(sensor, ColourCamera)
    cubes = [box(12.0 * np.cos(a), 12.0 * np.sin(a), 2.0, 2.0, 2.0, 4.0) for a in np.arange(9) * 0.7]
    scene, snapshot = plain(*cubes), snapshot_of([EGO])
    centres = np.array([[12.0 * np.cos(a), 12.0 * np.sin(a), 3.0] for a in np.arange(9) * 0.7])
    depth, seen = sensor.view.depth(snapshot, scene), sensor.view.project(centres, snapshot)
    for column, row, ahead in seen:
        if ahead > 2.0 and 0 <= column < width and 0 <= row < height:
            assert depth[int(row), int(column)] < ahead  # the cube's near side
            assert depth[int(row), int(column)] > ahead - 2.5


def test_depth_camera_keeps_a_part_in_sixteen_million() -> None:
    scene = plain(box(31.5, 0.0, 2.0, 60.0, 0.0, 60.0))
    metres = depths(image("depth", scene, x=0.5))
    np.testing.assert_allclose(metres[:30, 48], 30.0, atol=1e-4)
    assert (depths(image("depth", plain(), pitch=60)) == 1000.0).all()


def test_new_ids_tell_kinds_of_vehicles_and_riders_apart() -> None:
    kinds = (ActorClass.CAR, ActorClass.TRUCK, ActorClass.BUS, ActorClass.MOTORCYCLE, ActorClass.BICYCLE,
             ActorClass.WALKER)  # fmt: skip
    for kind, new in zip(kinds, (14, 15, 16, 18, 19, 12), strict=True):
        size = (2.2, 0.9, 1.7) if kind >= ActorClass.MOTORCYCLE else (6.0, 2.2, 2.4)
        bodies = [EGO, Body(1000, 9.0, 0.5, kind=kind, size=size)]
        old = image("semantic_segmentation", street(), bodies)[..., 2]
        tags = image("semantic_segmentation", street(), bodies, attributes={"tags": "new"})[..., 2]
        actor = image("instance_segmentation", street(), bodies, attributes={"tags": "new"})
        hit = actor[..., 1] + 256 * actor[..., 0].astype(int) == 1000
        assert hit.sum() > 20
        assert (actor[..., 2] == tags).all()
        riding = kind in (ActorClass.MOTORCYCLE, ActorClass.BICYCLE)
        assert set(np.unique(tags[hit])) == ({new, 13} if riding else {new})
        assert (tags[~hit] == NEW_TAG[old[~hit]]).all()


def test_attributes_of_carlas_lens_are_taken() -> None:
    lens = {"lens_circle_multiplier": "3.0", "lens_circle_falloff": 3.0, "chromatic_aberration_intensity": 0.5}
    assert (image("rgb", street(), attributes=lens) == image("rgb", street())).all()


@pytest.mark.parametrize(
    ("kind", "attributes", "message"),
    [
        ("rgb", {"look": "fancy"}, r"sensor 'eye': 'look' must be one of fast, full, got 'fancy'\."),
        ("rgb", {"lens_cricle_falloff": 1}, r"'lens_cricle_falloff'\. Did you mean 'lens_circle_falloff'"),
        ("semantic_segmentation", {"tags": "latest"}, r"'tags' must be one of old, new, got 'latest'\."),
        ("depth", {"look": "full"}, r"no attribute of sensor 'eye' 'look'"),
    ],
)
def test_bad_attribute_gets_one_clear_line(kind: str, attributes: dict[str, Any], message: str) -> None:
    with pytest.raises(SensorError, match=message) as caught:
        make_sensor({"type": f"sensor.camera.{kind}", "id": "eye", **LENS, "attributes": attributes})
    assert "\n" not in str(caught.value)


def test_a_suite_takes_a_look_but_for_cameras_that_name_their_own() -> None:
    own = {"type": "sensor.camera.rgb", "id": "own", **LENS, "attributes": {"look": "fast"}}
    looks = [s.config.look for v in with_look([*LAV, own], "full")
             if isinstance(s := make_sensor(v), ColourCamera)]  # fmt: skip
    assert looks == ["full"] * 4 + ["fast"]
