"""A pinhole camera on the ego: colour, tags, depth and instances from one pass."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.random import Draws
from lavsim.render.faces import TILE
from lavsim.render.frame import Mount, Pose
from lavsim.render.full import NO_MIRROR, Surroundings, is_wet, shade_full
from lavsim.render.ground import TAG_OF_SURFACE
from lavsim.render.heights import level_ground
from lavsim.render.lamps import NO_LIGHT, add_glows, lamp_light, street_lamps, with_headlights
from lavsim.render.look import Look, look_of
from lavsim.render.paint import is_blink_on
from lavsim.render.scene import Scene
from lavsim.render.shade import BLOCK, cell_run, faces_of, ground_of, place_block, shade, surface_below
from lavsim.render.shadow import NO_SHADOWS, corner_of, has_shadows, static_shadows, with_actors
from lavsim.render.tags import NEW_TAG, new_tags
from lavsim.render.zbuffer import Pinhole, Visibility, draw_visibility
from lavsim.types import Tag, VehicleLight
from lavsim.world.snapshot import Snapshot

SKY_DEPTH = 1000.0  # [m] CARLA's farthest
_HEADLIGHTS = 4.0  # brightening right before the car, at night


@dataclass(frozen=True)
class CameraImages:
    """One pass.

    Attributes:
        colour: (H, W, 4) uint8 blue, green, red, alpha.
        tags: (H, W) uint8 `Tag`.
        depth: (H, W) float32 along the optical axis [m], `SKY_DEPTH` for the sky.
        instance: (H, W) int32 actor id, 0 for the static world.
    """

    colour: NDArray[np.uint8]
    tags: NDArray[np.uint8]
    depth: NDArray[np.float32]
    instance: NDArray[np.int32]


@dataclass(frozen=True)
class CameraView:
    """A camera.

    Attributes:
        width, height: [px].
        fov: Horizontal field of view [rad].
        mount: Where it sits on the ego.
    """

    width: int
    height: int
    fov: float
    mount: Mount = field(default_factory=Mount)

    @property
    def lens(self) -> Pinhole:
        """Focal length W / (2 tan(fov / 2)), square pixels."""
        return Pinhole(self.width, self.height, float(self.width / (2.0 * np.tan(self.fov / 2.0))))

    def render(self, snapshot: Snapshot, scene: Scene, draws: Draws | None = None) -> CameraImages:
        """All images; `draws` are the camera's, for the noise of colours."""
        tags, instance = self.labels(snapshot, scene)
        return CameraImages(self.colour(snapshot, scene, draws), tags, self.depth(snapshot, scene), instance)

    def colour(
        self, snapshot: Snapshot, scene: Scene, draws: Draws | None = None, look_name: str = "fast"
    ) -> NDArray[np.uint8]:
        """(H, W, 4) uint8 blue, green, red, alpha, in one of `LOOKS`; without `draws` there is no noise."""
        lens, pose, look, lights = self.lens, self.mount.pose(snapshot), look_of(snapshot.weather), snapshot.lights
        view = scene.view(snapshot, lens, self.mount)
        statics, actors, ground = scene.statics, scene.actors(snapshot), ground_of(scene.terrain)
        faces = faces_of(view, statics, actors, look, lights)
        street = scene.while_same("street lamps", 0, lambda: street_lamps(statics))
        if look_name == "full":
            around = surroundings(snapshot, scene, look, lens, pose, view, street)
            image = shade_full(view, lens, pose, faces, ground, look, around, snapshot.tick, draws)
        else:
            beams = bool(snapshot.state[0, 0] & (VehicleLight.LOW_BEAM | VehicleLight.HIGH_BEAM))
            strength = _HEADLIGHTS * look.night if beams and look.night > 0.3 else 0.0
            ego = snapshot.ego
            image = shade(
                view, lens, pose, faces, ground, look, (ego.x, ego.y, ego.yaw, strength), snapshot.tick, draws
            )
        add_glows(
            image, view.face, view.inverse_depth, view.faces.solid, statics, actors, lights, street, lens.focal,
            pose.origin, pose.axes, look.night, is_blink_on(snapshot.tick),
        )  # fmt: skip
        return image

    def depth(self, snapshot: Snapshot, scene: Scene) -> NDArray[np.float32]:
        """(H, W) float32 [m]."""
        return depth_of(scene.view(snapshot, self.lens, self.mount))

    def labels(
        self, snapshot: Snapshot, scene: Scene, table: str = "old"
    ) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
        """(H, W) uint8 tags, by the `table` of `TAG_TABLES`, and int32 actor ids."""
        view = scene.view(snapshot, self.lens, self.mount)
        statics, actors = scene.statics, scene.actors(snapshot)
        if table == "new":
            tags = np.concatenate([NEW_TAG[statics.tag], new_tags(actors, snapshot)])
            surfaces, sky = NEW_TAG[TAG_OF_SURFACE], NEW_TAG[Tag.SKY]
        else:
            tags, surfaces, sky = np.concatenate([statics.tag, actors.tag]), TAG_OF_SURFACE, np.uint8(Tag.SKY)
        solid = view.faces.solid
        instance = np.concatenate([statics.instance, actors.instance])[solid]
        pose: Pose = self.mount.pose(snapshot)
        return _labels(
            view.face, view.inverse_depth, self.lens.focal, pose.origin, pose.axes, ground_of(scene.terrain), surfaces,
            sky, tags[solid], instance,
        )  # fmt: skip

    def project(self, points: NDArray[np.float64], snapshot: Snapshot) -> NDArray[np.float64]:
        """Column, row [px] and depth [m], `(N, 3)`, of world `points` `(N, 3)`; negative depth is behind."""
        ahead, right, up = self.mount.pose(snapshot).to_sensor(points).T
        with np.errstate(divide="ignore", invalid="ignore"):
            column = self.width / 2.0 + self.lens.focal * right / ahead
            row = self.height / 2.0 - self.lens.focal * up / ahead
        return np.stack([column, row, ahead], axis=1)


def surroundings(
    snapshot: Snapshot,
    scene: Scene,
    look: Look,
    lens: Pinhole,
    pose: Pose,
    view: Visibility,
    street: NDArray[np.float64],
) -> Surroundings:
    """Shadows, lamp light and mirrors about the ego."""
    statics, actors = scene.statics, scene.actors(snapshot)
    x, y = corner_of(snapshot.ego.x, snapshot.ego.y)
    shadows, lamps, mirror = NO_SHADOWS, NO_LIGHT, NO_MIRROR
    if has_shadows(look):
        key = (x, y, *look.sun.tolist())
        still = scene.while_same("shadows", key, lambda: static_shadows(statics, look, x, y))
        shadows = scene.once_a_tick(snapshot, "shadows", lambda: with_actors(still, actors))
    if look.night > 0.3:
        pools = scene.while_same("lamps", (x, y), lambda: lamp_light(street, x, y))
        lamps = scene.once_a_tick(snapshot, "lamps", lambda: with_headlights(pools, actors))
    if is_wet(look):
        mirror = _mirrored(snapshot, scene, look, lens, pose, view)
    return Surroundings(shadows, lamps, mirror, is_wet(look))


def _mirrored(
    snapshot: Snapshot, scene: Scene, look: Look, lens: Pinhole, pose: Pose, view: Visibility
) -> NDArray[np.uint8]:
    """(H / 2, W / 2, 4) what the camera would see in a mirror that lies on the ego's ground, where ground shows."""
    plane = float(snapshot.xyz[0, 2])
    flip = np.array([1.0, 1.0, -1.0])
    below = Pose(pose.origin * flip + np.array([0.0, 0.0, 2.0 * plane]), pose.axes * flip[:, None])
    half = Pinhole(max(1, (lens.width + 1) // 2), max(1, (lens.height + 1) // 2), lens.focal / 2.0)
    first = max(0, _first_ground_row(view.face, view.inverse_depth) // (2 * TILE) - 1) * TILE  # with what is smeared
    bounds = np.zeros((-(-half.height // TILE), -(-half.width // TILE)))
    bounds[: first // TILE] = np.inf
    statics, actors = scene.statics, scene.actors(snapshot)
    level = level_ground(float(below.origin[2]) + 1.0)
    seen = draw_visibility(half, below, statics, actors, heights=level, balls=scene.balls(snapshot), bounds=bounds)
    faces = faces_of(seen, statics, actors, look, snapshot.lights)
    ground = ground_of(scene.terrain)
    return shade(seen, half, below, faces, ground, look, (0.0, 0.0, 0.0, 0.0), snapshot.tick, None, first)


@kernel
def _first_ground_row(face, inverse_depth):  # type: ignore[no-untyped-def]
    """The first row of a picture that shows ground; their number if none does."""
    height, width = face.shape
    for row in range(height):
        found, faces, inverses = np.int32(0), face[row], inverse_depth[row]
        for n in range(np.uint64(width)):
            found |= (faces[n] < 0) & (inverses[n] > np.float32(0.0))
        if found:
            return row
    return height


def depth_of(view: Visibility) -> NDArray[np.float32]:
    """Depths [m] of one pass."""
    with np.errstate(divide="ignore", over="ignore"):
        return np.minimum(np.float32(1.0) / view.inverse_depth, np.float32(SKY_DEPTH))


@kernel
def _labels(  # type: ignore[no-untyped-def]
    face, inverse_depth, focal, origin, axes, ground, tag_of_surface, tag_of_sky, tag, instance
):
    height, width = face.shape
    rows = max(1, BLOCK // width)
    place, cells = np.empty((4, rows * width), np.float32), np.empty((2, rows * width), np.int32)
    tags, instances = np.empty(height * width, np.uint8), np.empty(height * width, np.int32)
    face, inverse = face.ravel(), inverse_depth.ravel()
    for row in range(0, height, rows):
        begin, end = row * width, min(row + rows, height) * width
        place_block(inverse[begin:end], row, width, height, focal, origin, axes, place)
        _label_block(face[begin:end], inverse[begin:end], place, cells, ground, tag_of_surface, tag_of_sky, tag,
                     instance, tags[begin:end], instances[begin:end])  # fmt: skip
    return tags.reshape(height, width), instances.reshape(height, width)


@lean_kernel
def _label_block(  # type: ignore[no-untyped-def]
    face, inverse, place, cells, ground, tag_of_surface, tag_of_sky, tag, instance, tags, instances
):
    cell_run(0, len(face), place, ground, cells)
    for i in range(len(face)):
        f = face[i]
        if f >= 0:
            tags[i], instances[i] = tag[f], instance[f]
        elif inverse[i] > np.float32(0.0):
            tags[i], instances[i] = tag_of_surface[surface_below(i, f, place, cells, ground)], 0
        else:
            tags[i], instances[i] = tag_of_sky, 0
