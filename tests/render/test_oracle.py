"""LiDAR and cameras against Embree, over meshes from a second builder (`tests/meshes.py`), at random places of towns.

Bounds: ranges agree to 2 cm + 1 mm / sin(incidence) on 99.9 % of the beams farther than 5 mm from a silhouette; tags of
what stands on the ground on 99.5 % of the pixels away from a rim of one pixel, depth to 1 %.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from lavsim.map.town_files import load_town, town_names
from lavsim.map.town_map import TownMap
from lavsim.random import Draws
from lavsim.render.camera_view import CameraView
from lavsim.render.frame import Mount, Pose
from lavsim.render.hits import describe
from lavsim.render.scene import Scene
from lavsim.render.sheet import CAMERAS
from lavsim.render.sweep import GROUND_HIT, NO_HIT, LidarModel, cast_columns, new_scratch, send_beams
from lavsim.types import ActorClass, LaneType, Tag
from lavsim.world.blueprints import BLUEPRINTS
from lavsim.world.snapshot import Snapshot
from tests.map.shared import MAPS, needs_maps
from tests.meshes import GROUND, Meshes, needs_embree, neighbours
from tests.snapshots import EGO, Body, snapshot_of

pytestmark = needs_embree

ROOF = Mount(z=2.4)
BEAMS = LidarModel(general_drop=0.0, zero_drop=0.0, full_sweep=True)
SILHOUETTE = 0.005  # [m]
TOWNS = [name for name in town_names() if not name.startswith("Town")]
SCENES = 20


@cache
def scene_of(name: str) -> Scene:
    return Scene(load_town(name, [MAPS]))


def moments(town: TownMap, seed: int, count: int) -> Iterator[Snapshot]:
    """The ego on a lane with vehicles, walkers and open doors around it, leaning with the slope."""
    rng = np.random.default_rng(seed)
    lanes = town.lanes
    driving = np.flatnonzero((lanes.type == LaneType.DRIVING) & (lanes.length > 8.0))
    vehicles = [b for b in BLUEPRINTS.values() if b.actor_class.is_vehicle]
    walkers = [b for b in BLUEPRINTS.values() if b.actor_class == ActorClass.WALKER]
    middle = np.array([lanes.points[lanes.rows(k)][len(lanes.points[lanes.rows(k)]) // 2, :2] for k in driving])
    for tick in range(count):
        home = rng.choice(len(driving), p=lanes.length[driving] / lanes.length[driving].sum())
        near = np.flatnonzero(np.hypot(*(middle - middle[home]).T) < 90.0)
        bodies = [_on_lane(town, int(driving[home]), rng, EGO.id, BLUEPRINTS[EGO.blueprint], 0.0)]
        for number in range(45):
            kind = vehicles[rng.integers(len(vehicles))] if number < 30 else walkers[rng.integers(len(walkers))]
            aside = 0.0 if number < 30 else rng.uniform(2.5, 5.0)
            bodies.append(_on_lane(town, int(driving[rng.choice(near)]), rng, 1000 + number, kind, aside))
        yield snapshot_of(bodies, tick=tick, lights=[tick % 3] * len(town.lights))


def _on_lane(town: TownMap, lane: int, rng: np.random.Generator, number: int, kind, aside: float) -> Body:  # type: ignore[no-untyped-def]
    u = rng.uniform(1.0, town.lanes.length[lane] - 1.0)
    (x, y, z, yaw, _), (x1, y1, z1, *_) = town.centre([lane, lane], [u, u + 0.5])
    pitch = float(np.arctan2(z1 - z, max(np.hypot(x1 - x, y1 - y), 1e-3)))
    return Body(number, x - aside * np.sin(yaw), y + aside * np.cos(yaw), z, yaw + rng.normal(0.0, 0.1),
                0.0 if aside else pitch, kind=kind.actor_class, size=kind.size, blueprint=kind.name,
                doors=int(rng.integers(16)) if rng.random() < 0.2 else 0, gait=int(rng.integers(256)))  # fmt: skip


def check_lidar(scene: Scene, snapshot: Snapshot, tilt: float) -> tuple[int, int]:
    """Beams compared, and those out of bounds."""
    pose = Mount(z=2.4, roll=tilt, pitch=tilt / 2.0).pose(snapshot)
    meshes = Meshes(scene, snapshot, pose.origin)
    room = new_scratch(BEAMS)
    send_beams(BEAMS, snapshot.tick, Draws.of_seed(0), room)
    columns = slice(0, BEAMS.columns)
    actors = scene.actors(snapshot)
    cast_columns(BEAMS, pose, snapshot.tick, columns, scene.statics, actors, scene.terrain.heights, room)
    rays = _beams(pose, snapshot.tick)
    truth = meshes.cast(rays)
    reach = BEAMS.max_range
    expected = np.where(truth.distance <= reach, truth.distance, np.inf)
    ours = np.where(room.hit.ravel() == NO_HIT, np.inf, room.run.ravel())
    clear = np.abs(truth.distance - reach) > 0.05
    for offset in neighbours(rays, truth.distance, SILHOUETTE):
        clear &= meshes.cast(offset).owner == truth.owner
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.abs(ours - expected)
        allowed = 0.02 + 0.001 / np.maximum(truth.cosine, 1e-9)
    good = (error <= allowed) | (np.isinf(ours) & np.isinf(expected))
    return int(clear.sum()), int((clear & ~good).sum())


def _beams(pose: Pose, tick: int) -> np.ndarray:
    azimuth, elevation = BEAMS.azimuths(tick), np.radians(np.linspace(BEAMS.upper, BEAMS.lower, BEAMS.channels))
    flat = np.cos(elevation)[None, :]
    upward = np.broadcast_to(np.sin(elevation)[None, :], (len(azimuth), len(elevation)))
    local = np.stack([flat * np.cos(azimuth)[:, None], flat * np.sin(azimuth)[:, None], upward], axis=-1)
    return local.reshape(-1, 3) @ pose.axes.T


def check_camera(scene: Scene, snapshot: Snapshot, view: CameraView) -> np.ndarray:
    """Pixels of solids compared, those with another tag, all pixels compared, those with another depth."""
    pose = view.mount.pose(snapshot)
    reach = 400.0 if scene.terrain.heights.is_level else 150.0  # slopes have two triangles a square metre
    meshes = Meshes(scene, snapshot, pose.origin, reach)
    focal = view.width / (2.0 * np.tan(view.fov / 2.0))
    column, row = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    local = np.stack(
        [np.ones_like(column), (column - view.width / 2.0) / focal, -(row - view.height / 2.0) / focal], -1
    )
    stretch = np.linalg.norm(local, axis=-1).ravel()
    truth = meshes.cast((local.reshape(-1, 3) / stretch[:, None]) @ pose.axes.T)
    shape = column.shape
    owner, depth = truth.owner.reshape(shape), (truth.distance / stretch).reshape(shape)
    tags, _ = view.labels(snapshot, scene)
    known = np.append(meshes.tags, [255, 255])  # what owns nothing: ground (-1) and sky (-2)
    inner = maximum_filter(owner, 3) == minimum_filter(owner, 3)
    is_deck = np.append([solid.is_deck for solid in meshes.solids], [False, False])[owner]
    solid = inner & (owner >= 0) & ~is_deck & (depth < 0.75 * reach)
    wrong_tag = solid & (tags != known[owner])
    seen = inner & np.isfinite(depth) & (depth < 0.75 * reach)
    with np.errstate(invalid="ignore"):
        wrong_depth = seen & ~(np.abs(view.depth(snapshot, scene) - depth) <= 0.01 * depth)
    return np.array([solid.sum(), wrong_tag.sum(), seen.sum(), wrong_depth.sum()])


def check_projection(scene: Scene, snapshot: Snapshot, view: CameraView) -> np.ndarray:
    """LiDAR returns in the image away from edges, and those on a pixel of another class."""
    pose = view.mount.pose(snapshot)
    room = new_scratch(BEAMS)
    send_beams(BEAMS, snapshot.tick, Draws.of_seed(0), room)
    actors = scene.actors(snapshot)
    cast_columns(
        BEAMS, pose, snapshot.tick, slice(0, BEAMS.columns), scene.statics, actors, scene.terrain.heights, room
    )
    met = np.flatnonzero(room.hit.ravel() != NO_HIT)
    points = pose.origin + _beams(pose, snapshot.tick)[met] * room.run.ravel()[met, None]
    hits = describe(points, room.hit.ravel()[met], pose.origin, scene.statics, actors, scene.terrain)
    tags, _ = view.labels(snapshot, scene)
    column, row, depth = view.project(points, snapshot).T
    shown = (depth > 0.5) & (column >= 1) & (column < view.width - 1) & (row >= 1) & (row < view.height - 1)
    at = row[shown].astype(int), column[shown].astype(int)
    inner = (maximum_filter(tags, 3) == minimum_filter(tags, 3))[at]
    return np.array([inner.sum(), (inner & (tags[at] != hits.tag[shown])).sum()])


def check_place(name: str, seed: int, count: int) -> None:
    scene = scene_of(name)
    lidar, camera, projected = np.zeros(2), np.zeros(4), np.zeros(2)
    for number, snapshot in enumerate(moments(scene.town, seed, count)):
        lidar += check_lidar(scene, snapshot, 0.03 if number % 2 else 0.0)
        camera += check_camera(scene, snapshot, CAMERAS[number % 4][1])
        projected += check_projection(scene, snapshot, CAMERAS[number % 3][1])
    shares = lidar[1] / lidar[0], camera[1] / camera[0], camera[3] / camera[2], projected[1] / projected[0]
    print(f"{name}: out of bounds: beams {shares[0]:.1e}, tags {shares[1]:.1e}, depths {shares[2]:.1e}, "
          f"points of another class {shares[3]:.1e}; of {lidar[0]:.0f}, {camera[0]:.0f}, {camera[2]:.0f}, "
          f"{projected[0]:.0f}")  # fmt: skip
    assert shares[0] <= 0.001
    assert shares[1] <= 0.005
    assert shares[2] <= 0.005
    assert shares[3] <= 0.01


def test_sensors_agree_with_embree_in_a_small_town() -> None:
    check_place("eu_small_a", 1, 2)


@needs_maps
def test_sensors_agree_with_embree_around_the_bridge_of_town04() -> None:
    scene = scene_of("Town04")
    lidar, camera = np.zeros(2), np.zeros(4)
    lanes = scene.town.lanes
    rows = {road: np.flatnonzero((lanes.road_id == road) & (lanes.type == LaneType.DRIVING))[0] for road in (39, 47)}
    for tick, (road, near) in enumerate(((47, (5.0, 22.0)), (39, (-25.0, 22.0)))):
        points = lanes.points[lanes.rows(int(rows[road]))]
        x, y, z, yaw, _ = points[np.argmin(np.hypot(*(points[:, :2] - near).T))]
        others = [Body(1000 + k, *points[k, :3], yaw=points[k, 3]) for k in range(0, len(points), 25)]
        snapshot = snapshot_of([Body(EGO.id, x, y, z, yaw, role=EGO.role, size=EGO.size), *others], tick=tick)
        lidar += check_lidar(scene, snapshot, 0.0)
        camera += check_camera(scene, snapshot, CAMERAS[1][1])
    assert lidar[1] <= 0.001 * lidar[0]
    assert camera[1] <= 0.005 * camera[0]
    assert camera[3] <= 0.005 * camera[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", TOWNS)
def test_sensors_agree_with_embree_in_every_town(name: str) -> None:
    check_place(name, 7, SCENES)


@needs_maps
@pytest.mark.slow
def test_sensors_agree_with_embree_in_town04() -> None:
    check_place("Town04", 7, SCENES)


def test_the_oracle_sees_a_difference() -> None:
    """A car moved by 10 cm after the meshes were built must show."""
    scene = scene_of("eu_small_a")
    snapshot = next(moments(scene.town, 3, 1))
    near = int(np.argsort(np.hypot(*(snapshot.xy - snapshot.xy[0]).T))[1])
    moved = snapshot.pose.copy()
    moved[near, :2] += 150
    meshes = Meshes(scene, replace(snapshot, pose=moved), ROOF.pose(snapshot).origin)
    truth = meshes.cast(_beams(ROOF.pose(snapshot), snapshot.tick))
    room = new_scratch(BEAMS)
    send_beams(BEAMS, snapshot.tick, Draws.of_seed(0), room)
    cast_columns(BEAMS, ROOF.pose(snapshot), snapshot.tick, slice(0, BEAMS.columns), scene.statics,
                 scene.actors(snapshot), scene.terrain.heights, room)  # fmt: skip
    with np.errstate(invalid="ignore"):
        assert (np.abs(room.run.ravel() - truth.distance) > 0.05).sum() > 20
    assert GROUND == GROUND_HIT
    assert Tag.BRIDGE in Tag
