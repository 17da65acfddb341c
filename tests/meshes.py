"""What sensors should see, as triangle meshes for Embree: a second builder, which shares no code with the kernels.

Prisms come from the town's scenery, actors from their list of boxes, the ground from its heights or as a plane, decks
from the curves of their road. Each solid is turned into triangles in plain numpy; who owns a triangle is kept beside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from lavsim.geometry import box_corners
from lavsim.map.prisms import Prisms
from lavsim.render.heights import CELL
from lavsim.render.kerbs import BURIED, HEIGHT
from lavsim.render.scene import Scene
from lavsim.render.shapes import Look, parts_of
from lavsim.render.solids import Solids
from lavsim.render.terrain import DECK_DEPTH
from lavsim.world.snapshot import Snapshot

Floats = NDArray[np.float64]

GROUND = -1
needs_embree = pytest.mark.skipif(not trimesh.ray.has_embree, reason="needs embreex, of the extra dev")


@dataclass(frozen=True)
class Solid:
    """A convex body: rings of its underside and top (n, 3), what cameras call it, and whose it is."""

    under: Floats
    top: Floats
    tag: int
    actor: int
    is_deck: bool = False


@dataclass(frozen=True)
class View:
    """What rays met.

    Attributes:
        distance: (N,) [m], infinite for nothing.
        owner: (N,) index of the solid, `GROUND`, or -2 for nothing.
        cosine: (N,) between the ray and the normal.
    """

    distance: Floats
    owner: NDArray[np.int64]
    cosine: Floats


class Meshes:
    """A moment of a scene as one mesh around a place.

    Args:
        scene: Town, terrain and scenery.
        snapshot: Who is where.
        eye: (3,) where rays start; solids around it are left out, as sensors see through what they are in.
        reach: How far solids are taken [m].
    """

    def __init__(self, scene: Scene, snapshot: Snapshot, eye: Floats, reach: float = 130.0) -> None:
        prisms = scene.town.scenery.prisms
        near = np.hypot(*(prisms.vertices[:, 0] - eye[:2]).T) < reach + 40.0
        solids = _upright(prisms.select(near)) + _slabs(scene.terrain.decks, DECK_DEPTH, True) + _actors(snapshot)
        solids += _slabs(scene.terrain.kerbs, HEIGHT + BURIED, False)
        self.solids = [solid for solid in solids if not _is_inside(solid, eye)]
        corners, faces, owner = [], [], []
        for number, solid in enumerate(self.solids):
            points, triangles = _triangles(solid)
            faces.append(triangles + sum(map(len, corners)))
            corners.append(points)
            owner.append(np.full(len(triangles), number))
        points, triangles = _ground(scene, eye, reach)
        faces.append(triangles + sum(map(len, corners)))
        corners.append(points)
        owner.append(np.full(len(triangles), GROUND))
        self.eye, self._owner = eye, np.concatenate(owner)
        # Embree counts in float32: near the eye that is exact to micrometres.
        self._mesh = trimesh.Trimesh(np.concatenate(corners) - eye, np.concatenate(faces), process=False)
        self._corners: Floats = self._mesh.vertices[self._mesh.faces]

    @property
    def tags(self) -> NDArray[np.int64]:
        return np.array([solid.tag for solid in self.solids], np.int64)

    @property
    def actors(self) -> NDArray[np.int64]:
        return np.array([solid.actor for solid in self.solids], np.int64)

    @property
    def owners(self) -> NDArray[np.int64]:
        """Index of the solid of each triangle, `GROUND` for the ground."""
        return self._owner

    @property
    def corners(self) -> Floats:
        """(T, 3, 3) of the triangles, from the eye."""
        return self._corners

    def first(self, directions: Floats) -> NDArray[np.int64]:
        """Triangle that each ray (N, 3) from the eye meets first, -1 for none."""
        found: NDArray[np.int64] = self._mesh.ray.intersects_first(np.zeros_like(directions), directions)
        return found

    def cast(self, directions: Floats) -> View:
        """First hits of rays (N, 3) of length 1 from the eye; distances in float64, from the triangles' planes."""
        first = self.first(directions)
        met = first >= 0
        a, b, c = np.moveaxis(self._corners[first], 1, 0)
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        cosine = np.sum(normal * directions, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(met, np.sum(normal * a, axis=1) / cosine, np.inf)
        return View(distance, np.where(met, self._owner[first], -2), np.abs(cosine))


def _upright(prisms: Prisms) -> list[Solid]:
    found = []
    for k in range(len(prisms)):
        ring = prisms.vertices[k, : prisms.count[k]]
        under = np.column_stack([ring, np.full(len(ring), prisms.z0[k])])
        found.append(Solid(under, under + np.array([0.0, 0.0, prisms.z1[k] - prisms.z0[k]]), int(prisms.tag[k]), 0))
    return found


def _actors(snapshot: Snapshot) -> list[Solid]:
    found = []
    table = snapshot.table
    for i, row in enumerate(snapshot.rows.tolist()):
        length, width, height = (float(v) for v in table.sizes[row])
        red, green, blue = (int(v) for v in table.colours[row])
        look = Look(length, width, height, (red, green, blue), table.blueprints[row], int(table.ids[row]))
        yaw, rise = float(snapshot.yaw[i]), float(np.tan(snapshot.pitch[i]))
        ahead, right = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        for part in parts_of(int(table.classes[row]), look):
            if not part.is_there(int(snapshot.state[i, 1])):
                continue
            middle = snapshot.xy[i] + part.ahead(int(snapshot.state[i, 2])) * ahead + part.y * right
            ring = box_corners(middle[:1], middle[1:], [yaw], [part.length], [part.width])[0]
            ground = snapshot.xyz[i, 2] + rise * ((ring - snapshot.xy[i]) @ ahead)
            under, top = (np.column_stack([ring, ground + z]) for z in (part.z0, part.z1))
            found.append(Solid(under, top, int(part.tag), int(table.ids[row])))
    return found


def _slabs(slabs: Solids | None, depth: float, is_deck: bool) -> list[Solid]:
    """Decks or kerb stones: their corners, at the heights of their planes, and the same `depth` lower."""
    found = []
    for k in range(0 if slabs is None else len(slabs.corners)):
        ring = slabs.xy[k, : slabs.corners[k]]  # type: ignore[union-attr]
        height = slabs.z1[k] + (ring - slabs.centre[k]) @ slabs.tilt[k]  # type: ignore[union-attr]
        top = np.column_stack([ring, height])
        found.append(Solid(top - np.array([0.0, 0.0, depth]), top, int(slabs.tag[k]), 0, is_deck))  # type: ignore[union-attr]
    return found


def _is_inside(solid: Solid, point: Floats) -> bool:
    both = np.concatenate([solid.under, solid.top])
    if (point < both.min(axis=0)).any() or (point > both.max(axis=0)).any():
        return False
    ring = solid.under[:, :2]
    edge, step = np.roll(ring, -1, axis=0) - ring, point[:2] - ring
    side = edge[:, 0] * step[:, 1] - edge[:, 1] * step[:, 0]
    return bool((side >= 0.0).all() or (side <= 0.0).all())


def _triangles(solid: Solid) -> tuple[Floats, NDArray[np.int64]]:
    n = len(solid.under)
    fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
    walls = []
    for k in range(n):
        f = (k + 1) % n
        walls += [(k, f, n + f), (k, n + f, n + k)]
    return np.concatenate([solid.under, solid.top]), np.concatenate([fan, fan + n, np.array(walls)])


def _ground(scene: Scene, eye: Floats, reach: float) -> tuple[Floats, NDArray[np.int64]]:
    heights = scene.terrain.heights
    if heights.is_level:
        far = 2000.0
        plane = np.array([[x, y, 0.0] for x, y in ((-far, -far), (far, -far), (far, far), (-far, far))])
        return plane + np.array([eye[0], eye[1], heights.level]), np.array([(0, 1, 2), (0, 2, 3)])
    low = np.floor((eye[:2] - reach - (heights.x0, heights.y0)) / CELL).astype(int)
    count = int(2.0 * reach / CELL) + 2
    i, j = np.meshgrid(low[0] + np.arange(count), low[1] + np.arange(count))
    rows, columns = heights.nodes.shape
    z = heights.nodes[np.clip(j, 0, rows - 1), np.clip(i, 0, columns - 1)]
    points = np.stack([heights.x0 + CELL * i, heights.y0 + CELL * j, z], axis=-1).reshape(-1, 3)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    across = np.stack([first, first + 1, first + count + 1], axis=1)
    down = np.stack([first, first + count + 1, first + count], axis=1)
    return points.astype(np.float64), np.concatenate([across, down])


def neighbours(directions: Floats, distance: Floats, offset: float) -> list[Floats]:
    """Four rays that pass each of `directions` (N, 3) at `offset` metres where it ends."""
    aside = np.cross(directions, np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    upward = np.cross(aside, directions)
    share = (offset / np.clip(distance, 0.5, 1000.0))[:, None]
    rays: list[Any] = [directions + s * share * axis for axis in (aside, upward) for s in (-1.0, 1.0)]
    return [ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays]
