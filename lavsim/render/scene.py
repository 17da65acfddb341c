"""A town and its actors as the solids and the ground that every sensor and picture is drawn from."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.map.prisms import Prisms
from lavsim.render.faces import balls_of
from lavsim.render.frame import Mount
from lavsim.render.ground import GroundRaster
from lavsim.render.shapes import GAIT_UNIT, Look, Part, parts_of
from lavsim.render.solids import Solids, joined, solids_of
from lavsim.render.terrain import Terrain, level_terrain, terrain_of
from lavsim.render.zbuffer import Balls, Buffers, Pinhole, Visibility, draw_visibility, new_buffers
from lavsim.world.snapshot import ActorTable, Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap

T = TypeVar("T")


class _Templates(NamedTuple):
    """Boxes of all rows of an actor table: those of row i are first[i] … first[i+1]-1."""

    first: NDArray[np.int32]
    box: NDArray[np.float64]  # (P, 7) x, y, length, width, z0, z1, swing [m]
    door: NDArray[np.int32]
    colour: NDArray[np.float32]
    material: NDArray[np.uint8]
    tag: NDArray[np.uint8]


class Scene:
    """What can be seen in a town at a tick.

    The ego is drawn like everybody else, as in CARLA: from the LAV mounts its body lies outside of all images, from a
    mount behind the roof it shows. A sensor inside a solid sees through it.

    Results for the last snapshot are kept, so that a colour and a tag camera on one mount cost one pass. That changes
    no result.

    Args:
        town: The map; None for a scene of its own.
        ground: Raster or terrain; by default the town's.
        prisms: Statics; by default the town's scenery.

    Attributes:
        terrain: The ground: what it is made of, how high it lies, and bridges.
        statics: Scenery, then kerb stones and the decks of bridges.
    """

    def __init__(
        self, town: TownMap | None, ground: GroundRaster | Terrain | None = None, prisms: Prisms | None = None
    ) -> None:
        if ground is None or prisms is None:
            if town is None:
                raise ValueError("a scene without a town needs its ground and its prisms")
            ground = terrain_of(town) if ground is None else ground
            prisms = town.scenery.prisms if prisms is None else prisms
        self._town = town
        self.terrain = level_terrain(ground) if isinstance(ground, GroundRaster) else ground
        made = (self.terrain.kerbs, self.terrain.decks)
        self.statics = joined([solids_of(prisms), *(solids for solids in made if solids is not None)])
        self._static_balls = balls_of(self.statics)
        self._templates: tuple[ActorTable, _Templates] | None = None
        self._snapshot: Snapshot | None = None
        self._actors: Solids | None = None
        self._views: dict[tuple[Pinhole, Mount], Visibility] = {}
        self._spare: dict[tuple[int, ...], list[Buffers]] = {}
        self._of_snapshot: dict[str, Any] = {}
        self._of_statics: dict[str, tuple[Hashable, Any]] = {}

    @property
    def ground(self) -> GroundRaster:
        """What the ground is made of, below bridges."""
        return self.terrain.raster

    @property
    def town(self) -> TownMap:
        """The map; sensors that read it can't run in a scene without one."""
        if self._town is None:
            raise ValueError("this scene has no town")
        return self._town

    @property
    def has_town(self) -> bool:
        """Whether there is a map."""
        return self._town is not None

    @property
    def name(self) -> str:
        """The town's name, empty without one."""
        return self._town.name if self._town is not None else ""

    @property
    def geo_reference(self) -> tuple[float, float]:
        """Latitude and longitude of the world's origin [deg]."""
        return self._town.geo_reference if self._town is not None else (0.0, 0.0)

    def actors(self, snapshot: Snapshot) -> Solids:
        """The solids of all actors present."""
        self._turn_to(snapshot)
        if self._actors is None:
            self._actors = self.place(snapshot)
        return self._actors

    def balls(self, snapshot: Snapshot) -> Balls:
        """Balls about the statics and about the actors present."""
        return self._static_balls, self.once_a_tick(snapshot, "balls", lambda: balls_of(self.actors(snapshot)))

    def place(self, snapshot: Snapshot) -> Solids:
        """What `actors` gives, without keeping it; for moments between ticks."""
        templates = self._templates_of(snapshot.table)
        return Solids(
            *_place(templates, snapshot.rows, snapshot.ids, snapshot.xyz, snapshot.yaw, snapshot.pitch, snapshot.state)
        )

    def view(self, snapshot: Snapshot, lens: Pinhole, mount: Mount) -> Visibility:
        """What a camera on the ego sees; its arrays are drawn over once another snapshot is looked at."""
        self._turn_to(snapshot)
        key = (lens, mount)
        if key not in self._views:
            spare = self._spare.get((lens.height, lens.width))
            buffers = spare.pop() if spare else new_buffers(lens)
            self._views[key] = draw_visibility(
                lens,
                mount.pose(snapshot),
                self.statics,
                self.actors(snapshot),
                buffers,
                self.terrain.heights,
                self.balls(snapshot),
            )
        return self._views[key]

    def once_a_tick(self, snapshot: Snapshot, name: str, make: Callable[[], T]) -> T:
        """What `make` gives, worked out once for all sensors of a tick."""
        self._turn_to(snapshot)
        if name not in self._of_snapshot:
            self._of_snapshot[name] = make()
        return cast(T, self._of_snapshot[name])

    def while_same(self, name: str, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` gives about what stands still, worked out again when `key` is another."""
        if name not in self._of_statics or self._of_statics[name][0] != key:
            self._of_statics[name] = (key, make())
        return cast(T, self._of_statics[name][1])

    def _turn_to(self, snapshot: Snapshot) -> None:
        if snapshot is not self._snapshot:
            self._snapshot, self._actors = snapshot, None
            self._of_snapshot.clear()
            for view in self._views.values():
                self._spare.setdefault(view.face.shape, []).append((view.face, view.inverse_depth))
            self._views.clear()

    def _templates_of(self, table: ActorTable) -> _Templates:
        if self._templates is None or self._templates[0] is not table:
            self._templates = (table, _templates(table))
        return self._templates[1]


def _templates(table: ActorTable) -> _Templates:
    rows: list[Part] = []
    first = np.zeros(len(table.ids) + 1, np.int32)
    for i in range(len(table.ids)):
        length, width, height = (float(v) for v in table.sizes[i])
        red, green, blue = (int(v) for v in table.colours[i])
        look = Look(length, width, height, (red, green, blue), table.blueprints[i], int(table.ids[i]))
        rows += parts_of(int(table.classes[i]), look)
        first[i + 1] = len(rows)
    return _Templates(
        first,
        np.array([(p.x, p.y, p.length, p.width, p.z0, p.z1, p.swing) for p in rows], np.float64).reshape(-1, 7),
        np.array([p.door for p in rows], np.int32),
        np.array([p.colour for p in rows], np.float32).reshape(-1, 3),
        np.array([p.material for p in rows], np.uint8),
        np.array([p.tag for p in rows], np.uint8),
    )


@kernel
def _place(templates, rows, ids, xyz, yaw, pitch, state):  # type: ignore[no-untyped-def]
    """Columns of `Solids` for the actors present; a pitched actor's boxes lean with the slope, their sides upright."""
    total = 0
    for i in range(len(rows)):
        for part in range(templates.first[rows[i]], templates.first[rows[i] + 1]):
            total += templates.door[part] == 0 or (templates.door[part] & state[i, 1]) != 0
    xy, centre, radius = np.zeros((total, 8, 2)), np.empty((total, 2)), np.empty(total)
    z0, z1 = np.empty(total), np.empty(total)
    tag, material = np.empty(total, np.uint8), np.empty(total, np.uint8)
    colour = np.empty((total, 3), np.float32)
    instance, lights = np.empty(total, np.int32), np.empty(total, np.int32)
    tilt = np.empty((total, 2))
    k = 0
    for i in range(len(rows)):
        c, s, rise = np.cos(yaw[i]), np.sin(yaw[i]), np.tan(pitch[i])
        step = np.sin(state[i, 2] * GAIT_UNIT)
        for part in range(templates.first[rows[i]], templates.first[rows[i] + 1]):
            if templates.door[part] != 0 and (templates.door[part] & state[i, 1]) == 0:
                continue
            box = templates.box[part]
            x = box[0] + box[6] * step
            for corner in range(4):  # front left, front right, rear right, rear left
                ahead = x + (box[2] if corner < 2 else -box[2]) / 2.0
                aside = box[1] + (box[3] if corner in (1, 2) else -box[3]) / 2.0
                xy[k, corner, 0] = xyz[i, 0] + c * ahead - s * aside
                xy[k, corner, 1] = xyz[i, 1] + s * ahead + c * aside
            centre[k, 0] = xyz[i, 0] + c * x - s * box[1]
            centre[k, 1] = xyz[i, 1] + s * x + c * box[1]
            radius[k] = np.sqrt(box[2] * box[2] + box[3] * box[3]) / 2.0
            level = xyz[i, 2] + rise * x
            z0[k], z1[k] = level + box[4], level + box[5]
            tilt[k, 0], tilt[k, 1] = rise * c, rise * s
            tag[k], material[k], colour[k] = templates.tag[part], templates.material[part], templates.colour[part]
            instance[k], lights[k] = ids[i], state[i, 0]
            k += 1
    count, light = np.full(total, 4, np.int32), np.full(total, -1, np.int32)
    return xy, count, z0, z1, centre, radius, tag, material, colour, instance, light, lights, tilt


_SCENES: dict[tuple[str, str], Scene] = {}


def get_scene(town: TownMap) -> Scene:
    """The scene of `town`, one a process."""
    key = (town.name, town.digest)
    if key not in _SCENES:
        _SCENES[key] = Scene(town)
    return _SCENES[key]
