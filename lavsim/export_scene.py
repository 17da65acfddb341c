"""A town, or a moment of a drive in it, as a GLB file for other programs: what the sensors see, as meshes by class.

Frame: glTF is right-handed with y up, CARLA left-handed with z up. A point (x, y, z) of ours becomes (x, z, y): x stays
east, y points up, z points south, and nothing is mirrored to the eye. Lengths stay metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lavsim.cache import replace_atomically
from lavsim.errors import OutputError
from lavsim.render.ground import DASH, GAP
from lavsim.render.scene import Scene, get_scene
from lavsim.render.solids import Solids
from lavsim.types import ActorClass, LaneType, Role, Tag
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.marks import MarkLine
    from lavsim.map.town_map import TownMap

Floats = NDArray[np.float64]
Rgb = tuple[int, int, int]

LANE_STEP = 2  # lane points, 0.5 m apart or less, between the corners of a lane's mesh
LIFT = 0.01  # [m] from one layer of ground to the next, so that none shines through another

# Layers of the ground from below: name, lanes, colour.
_LAYERS: tuple[tuple[str, int, Rgb], ...] = (
    ("median", LaneType.MEDIAN | LaneType.BORDER | LaneType.NONE, (168, 192, 144)),
    ("sidewalk", LaneType.SIDEWALK, (204, 200, 192)),
    ("shoulder", LaneType.SHOULDER | LaneType.RESTRICTED, (140, 138, 134)),
    ("parking", LaneType.PARKING, (122, 122, 128)),
    ("road", LaneType.DRIVING | LaneType.BIDIRECTIONAL | LaneType.STOP | LaneType.BIKING | LaneType.ENTRY
     | LaneType.EXIT | LaneType.OFF_RAMP | LaneType.ON_RAMP, (106, 108, 112)),
)  # fmt: skip
_CROSSWALK: Rgb = (226, 226, 222)
_PAINT: Mapping[str, Rgb] = {"mark white": (250, 250, 246), "mark yellow": (244, 196, 60), "curb": (160, 156, 150)}
_SOLID: Mapping[int, tuple[str, Rgb]] = {
    Tag.BUILDING: ("building", (198, 184, 164)),
    Tag.VEGETATION: ("vegetation", (92, 128, 72)),
    Tag.POLE: ("pole", (110, 112, 115)),
    Tag.TRAFFIC_LIGHT: ("traffic light", (70, 72, 60)),
    Tag.TRAFFIC_SIGN: ("traffic sign", (214, 190, 60)),
    Tag.SIDEWALK: ("kerb stone", (160, 156, 150)),
    Tag.BRIDGE: ("bridge", (150, 140, 132)),
}
_OTHER: tuple[str, Rgb] = ("other", (160, 152, 142))
_ACTOR: Mapping[int, Rgb] = {
    ActorClass.CAR: (91, 125, 168), ActorClass.VAN: (59, 143, 149), ActorClass.TRUCK: (154, 106, 66),
    ActorClass.BUS: (207, 122, 28), ActorClass.MOTORCYCLE: (152, 80, 184), ActorClass.BICYCLE: (60, 154, 78),
    ActorClass.WALKER: (209, 51, 91), ActorClass.PROP: (138, 133, 120),
}  # fmt: skip
_EGO: Rgb = (11, 87, 208)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one class.

    Attributes:
        vertices: (V, 3) in our frame: x east, y south, z up [m].
        faces: (F, 3) corners, counter-clockwise when seen from outside in glTF's frame.
        colour: Red, green, blue.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    colour: Rgb


def scene_meshes(town: TownMap, snapshot: Snapshot | None = None) -> dict[str, Mesh]:
    """Meshes by class: ground, paint, everything that stands, and the actors of `snapshot`."""
    scene = get_scene(town)
    found = {**_ground(town), **_paint(town), **_statics(scene)}
    if snapshot is not None:
        found |= _actors(scene, snapshot)
    return {name: mesh for name, mesh in found.items() if len(mesh.faces)}


def write_glb(meshes: Mapping[str, Mesh], path: Path) -> None:
    """Writes `meshes` as nodes of one GLB file.

    Raises:
        OutputError: it can't be written.
    """
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    scene = trimesh.Scene()
    for name, mesh in meshes.items():
        material = PBRMaterial(name=name, baseColorFactor=[*mesh.colour, 255], metallicFactor=0.0, roughnessFactor=0.9)
        solid = trimesh.Trimesh(
            to_gltf(mesh.vertices), mesh.faces, process=False, visual=TextureVisuals(material=material)
        )
        scene.add_geometry(solid, node_name=name, geom_name=name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_atomically(path, scene.export(file_type="glb"))
    except OSError as error:
        raise OutputError(f"can't write {path}: {error.strerror}") from None


def to_gltf(points: Floats) -> Floats:
    """Points (N, 3) of our frame in glTF's."""
    return np.ascontiguousarray(points[:, [0, 2, 1]])


def _ground(town: TownMap) -> dict[str, Mesh]:
    """Lanes as strips, layer by layer, and crosswalks."""
    lanes = town.lanes
    found = {}
    for layer, (name, types, colour) in enumerate(_LAYERS):
        strips = []
        for lane in np.flatnonzero(lanes.type & int(types)):
            rows = np.arange(lanes.first[lane], lanes.first[lane + 1])
            rows = np.unique(np.append(rows[::LANE_STEP], rows[-1:]))
            x, y, z, yaw = lanes.points[rows, :4].T
            aside = np.stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)], axis=1) * lanes.width[rows, None] / 2.0
            middle = np.stack([x, y, z + LIFT * layer], axis=1)
            strips.append((middle - aside, middle + aside))
        found[name] = _strips(strips, colour)
    lift = LIFT * len(_LAYERS)
    corners = [np.asarray(polygon, np.float64)[:, :2] for polygon in town.crosswalks]
    areas = [np.column_stack([area, _heights(town, area) + lift]) for area in corners]
    found["crosswalk"] = _fans(areas, _CROSSWALK)
    return found


def _heights(town: TownMap, points: Floats) -> Floats:
    """(N,) heights of the nearest lanes [m]."""
    return np.asarray(town.nearest(points).points[:, 2], np.float64)


def _paint(town: TownMap) -> dict[str, Mesh]:
    """Marks and kerb lines as strips; broken ones in dashes."""
    strips: dict[str, list[tuple[Floats, Floats]]] = {name: [] for name in _PAINT}
    for mark in town.marks:
        if mark.kind in ("none", "grass") or len(mark.points) < 2:
            continue
        name = "curb" if mark.kind == "curb" else f"mark {'yellow' if mark.colour == 'yellow' else 'white'}"
        strips[name] += [_strip_about(line, max(mark.width, 0.1)) for line in _lines_of(mark)]
    return {name: _strips(strips[name], colour) for name, colour in _PAINT.items()}


def _lines_of(mark: MarkLine) -> Iterator[Floats]:
    """The painted pieces of a mark, (M, 3) each."""
    z = np.zeros(len(mark.points)) if mark.z is None else mark.z
    points = np.column_stack([mark.points, z + LIFT * (len(_LAYERS) + 1)])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(mark.points, axis=0).T))])
    if mark.kind not in ("broken", "broken broken", "botts dots"):
        yield points
        return
    for begin in np.arange(0.0, along[-1], DASH + GAP):
        end = min(begin + DASH, along[-1])
        inside = along[(along > begin) & (along < end)]
        at = np.concatenate([[begin], inside, [end]])
        yield np.stack([np.interp(at, along, points[:, axis]) for axis in range(3)], axis=1)


def _strip_about(line: Floats, width: float) -> tuple[Floats, Floats]:
    """Left and right edge of a strip about a line (M, 3), seen from above in our frame."""
    heading = np.gradient(line[:, :2], axis=0)
    heading /= np.maximum(np.hypot(heading[:, 0], heading[:, 1]), 1e-9)[:, None]
    aside = np.column_stack([-heading[:, 1], heading[:, 0], np.zeros(len(line))]) * width / 2.0
    return line - aside, line + aside


def _strips(strips: Sequence[tuple[Floats, Floats]], colour: Rgb) -> Mesh:
    """Strips between left and right edges, facing up."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for left, right in strips:
        n = len(left)
        at = count + np.arange(n - 1)
        vertices += [left, right]
        faces += [np.stack([at, at + 1, at + n], axis=1), np.stack([at + 1, at + n + 1, at + n], axis=1)]
        count += 2 * n
    return Mesh(np.concatenate(vertices), np.concatenate(faces)[:, ::-1], colour)


def _fans(areas: Sequence[Floats], colour: Rgb) -> Mesh:
    """Convex areas (M, 3), facing up."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for area in areas:
        x, y = area[:, 0], area[:, 1]
        turn = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        ring = area if turn > 0.0 else area[::-1]
        at = np.arange(1, len(ring) - 1)
        vertices.append(ring)
        faces.append(count + np.stack([np.zeros_like(at), at + 1, at], axis=1))
        count += len(ring)
    return Mesh(np.concatenate(vertices), np.concatenate(faces), colour)


def _statics(scene: Scene) -> dict[str, Mesh]:
    """Everything that stands still, by its class tag."""
    solids = scene.statics
    found = {}
    for name, colour in (*_SOLID.values(), _OTHER):
        tags = [tag for tag, (known, _) in _SOLID.items() if known == name]
        rows = np.isin(solids.tag, tags) if tags else ~np.isin(solids.tag, list(_SOLID))
        found[name] = solid_mesh(_chosen(solids, rows), colour)
    return found


def _actors(scene: Scene, snapshot: Snapshot) -> dict[str, Mesh]:
    """The actors' boxes, by actor class; the ego apart."""
    solids = scene.actors(snapshot)
    order = np.argsort(snapshot.ids)
    row = order[np.searchsorted(snapshot.ids, solids.instance, sorter=order)]
    is_ego = snapshot.roles[row] == Role.EGO
    found = {"ego": solid_mesh(_chosen(solids, is_ego), _EGO)}
    for kind, colour in _ACTOR.items():
        rows = (snapshot.classes[row] == kind) & ~is_ego
        found[ActorClass(kind).name.lower()] = solid_mesh(_chosen(solids, rows), colour)
    return found


def _chosen(solids: Solids, rows: NDArray[np.bool_]) -> Solids:
    columns: tuple[Any, ...] = tuple(solids)
    return Solids(*(column[rows] for column in columns))


def solid_mesh(solids: Solids, colour: Rgb) -> Mesh:
    """Closed prisms with their sloping tops and undersides."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for corners in np.unique(solids.corners).tolist():
        rows = np.flatnonzero(solids.corners == corners)
        xy = solids.xy[rows, :corners]
        slope = np.sum((xy - solids.centre[rows, None]) * solids.tilt[rows, None], axis=2)
        rings = [np.dstack([xy, z[rows, None] + slope]) for z in (solids.z0, solids.z1)]
        vertices.append(np.concatenate(rings, axis=1).reshape(-1, 3))
        offsets = count + 2 * corners * np.arange(len(rows))
        faces.append((_prism_faces(corners)[None] + offsets[:, None, None]).reshape(-1, 3))
        count += 2 * corners * len(rows)
    return Mesh(np.concatenate(vertices), np.concatenate(faces), colour)


def _prism_faces(corners: int) -> NDArray[np.int64]:
    """Faces of a prism: underside 0 … corners-1, then the top, its footprint in the order of positive area."""
    low = np.arange(corners)
    high, after = low + corners, (low + 1) % corners
    fan = np.arange(1, corners - 1)
    zero = np.zeros_like(fan)
    sides = [np.stack([low, after + corners, after], axis=1), np.stack([low, high, after + corners], axis=1)]
    top = np.stack([zero + corners, fan + 1 + corners, fan + corners], axis=1)
    bottom = np.stack([zero, fan, fan + 1], axis=1)
    return np.concatenate([*sides, top, bottom])
