"""Scenes as GLB: read back, they have the extents, the classes and the outsides of what the sensors see."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lavsim.cli import main
from lavsim.export_scene import scene_meshes, to_gltf, write_glb
from lavsim.render.scene import get_scene
from tests.drives import TOWN, straight_route
from tests.viewer import drives


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> trimesh.Scene:
    """The town with the actors of a drive made by hand, written and read back."""
    path = tmp_path_factory.mktemp("scene") / "a.glb"
    write_glb(scene_meshes(drives.town(), drives.snapshots()[60]), path)
    return trimesh.load_scene(path)


def test_extents_are_those_of_the_world_in_gltfs_frame(loaded: trimesh.Scene) -> None:
    statics = get_scene(drives.town()).statics
    used = np.arange(8)[None, :] < statics.corners[:, None]
    low = [statics.xy[used][:, 0].min(), statics.z0.min(), statics.xy[used][:, 1].min()]
    high = [statics.xy[used][:, 0].max(), statics.z1.max(), statics.xy[used][:, 1].max()]
    solid = np.array([loaded.geometry[n].bounds for n in ("building", "vegetation", "pole") if n in loaded.geometry])
    assert (solid[:, 0].min(axis=0) >= np.array(low) - 1e-3).all()
    assert (solid[:, 1].max(axis=0) <= np.array(high) + 1e-3).all()
    assert loaded.bounds[:, [0, 2]] == pytest.approx(_plan_bounds(), abs=0.05)


def _plan_bounds() -> np.ndarray:
    meshes = scene_meshes(drives.town()).values()
    points = np.concatenate([mesh.vertices for mesh in meshes])
    return np.array([points[:, :2].min(axis=0), points[:, :2].max(axis=0)])


def test_actors_are_where_the_snapshot_has_them(loaded: trimesh.Scene) -> None:
    snapshot = drives.snapshots()[60]
    ego = loaded.geometry["ego"].bounds
    assert (ego[0] + ego[1])[[0, 2]] / 2.0 == pytest.approx(snapshot.xy[0], abs=0.1)
    assert ego[1, 1] - ego[0, 1] == pytest.approx(snapshot.ego.height, abs=0.05)
    assert {"car", "truck", "bicycle", "walker", "van", "prop", "ego"} <= set(loaded.geometry)


def test_solids_show_their_outside_and_ground_faces_up(loaded: trimesh.Scene) -> None:
    for name in ("building", "pole", "ego", "truck"):
        assert loaded.geometry[name].volume > 0.0, name
    for name in ("road", "sidewalk", "mark white", "crosswalk"):
        if name in loaded.geometry:
            mesh = loaded.geometry[name]
            up = mesh.face_normals[:, 1] * mesh.area_faces
            assert up.sum() > 0.99 * mesh.area, name


def test_road_lies_under_the_route_and_carries_its_colour(loaded: trimesh.Scene) -> None:
    road = loaded.geometry["road"]
    places = to_gltf(straight_route().points[5:-5:20, :3])
    gaps = np.linalg.norm(road.triangles_center[None, :, [0, 2]] - places[:, None, [0, 2]], axis=2).min(axis=1)
    assert gaps.max() < 3.0
    assert road.visual.material.baseColorFactor[:3].tolist() == [106, 108, 112]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([TOWN, "a.obj"], "*.glb"),
        (["nowhere", "a.glb"], "no town"),
        (["none.lavlog@3", "a.glb"], "none.lavlog"),
        (["none.lavlog@x", "a.glb"], "tick"),
    ],
)
def test_mistakes_are_one_line(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export-scene", *arguments]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
