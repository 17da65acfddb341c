"""A pinhole camera on the ego: colour, tags, depth and instances from one pass."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.random import Draws
from lavsim.render.faces import DECK_FACE
from lavsim.render.frame import Mount, Pose
from lavsim.render.ground import TAG_OF_SURFACE, surface_at
from lavsim.render.look import look_of
from lavsim.render.scene import Scene
from lavsim.render.shade import faces_of, ground_of, shade
from lavsim.render.zbuffer import Pinhole, Visibility
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

    def colour(self, snapshot: Snapshot, scene: Scene, draws: Draws | None = None) -> NDArray[np.uint8]:
        """(H, W, 4) uint8 blue, green, red, alpha."""
        view = scene.view(snapshot, self.lens, self.mount)
        look = look_of(snapshot.weather)
        beams = bool(snapshot.state[0, 0] & (VehicleLight.LOW_BEAM | VehicleLight.HIGH_BEAM))
        ego = snapshot.ego
        strength = _HEADLIGHTS * look.night if beams and look.night > 0.3 else 0.0
        faces = faces_of(view, scene.statics, scene.actors(snapshot), look, snapshot.lights)
        return shade(
            view, self.lens, self.mount.pose(snapshot), faces, ground_of(scene.terrain), look,
            (ego.x, ego.y, ego.yaw, strength), snapshot.tick, draws,
        )  # fmt: skip

    def depth(self, snapshot: Snapshot, scene: Scene) -> NDArray[np.float32]:
        """(H, W) float32 [m]."""
        return depth_of(scene.view(snapshot, self.lens, self.mount))

    def labels(self, snapshot: Snapshot, scene: Scene) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
        """(H, W) uint8 tags and int32 actor ids."""
        view = scene.view(snapshot, self.lens, self.mount)
        statics, actors = scene.statics, scene.actors(snapshot)
        solid = view.faces.solid
        tag = np.concatenate([statics.tag, actors.tag])[solid]
        instance = np.concatenate([statics.instance, actors.instance])[solid]
        pose: Pose = self.mount.pose(snapshot)
        return _labels(
            view.face, view.inverse_depth, self.lens.focal, pose.origin, pose.axes,
            scene.ground.classes, scene.ground.origin, scene.terrain.deck_raster.classes,
            scene.terrain.deck_raster.origin, 1.0 / scene.ground.resolution, TAG_OF_SURFACE, tag, instance,
        )  # fmt: skip

    def project(self, points: NDArray[np.float64], snapshot: Snapshot) -> NDArray[np.float64]:
        """Column, row [px] and depth [m], `(N, 3)`, of world `points` `(N, 3)`; negative depth is behind."""
        ahead, right, up = self.mount.pose(snapshot).to_sensor(points).T
        with np.errstate(divide="ignore", invalid="ignore"):
            column = self.width / 2.0 + self.lens.focal * right / ahead
            row = self.height / 2.0 - self.lens.focal * up / ahead
        return np.stack([column, row, ahead], axis=1)


def depth_of(view: Visibility) -> NDArray[np.float32]:
    """Depths [m] of one pass."""
    with np.errstate(divide="ignore"):
        return np.minimum(np.float32(1.0) / view.inverse_depth, np.float32(SKY_DEPTH))


_SKY = int(Tag.SKY)


@kernel
def _labels(  # type: ignore[no-untyped-def]
    face, inverse_depth, focal, origin, axes, classes, corner, deck, deck_corner, per_metre, tag_of_surface, tag,
    instance,
):  # fmt: skip
    height, width = face.shape
    tags, instances = np.empty((height, width), np.uint8), np.empty((height, width), np.int32)
    for row in range(height):
        v = (row + 0.5 - height / 2.0) / focal
        base_x, base_y = axes[0, 0] - v * axes[0, 2], axes[1, 0] - v * axes[1, 2]
        for column in range(width):
            f = face[row, column]
            if f >= 0:
                tags[row, column], instances[row, column] = tag[f], instance[f]
                continue
            instances[row, column] = 0
            inverse = inverse_depth[row, column]
            if inverse <= 0.0:
                tags[row, column] = _SKY
                continue
            u = (column + 0.5 - width / 2.0) / focal
            depth = 1.0 / inverse
            x, y = origin[0] + depth * (base_x + u * axes[0, 1]), origin[1] + depth * (base_y + u * axes[1, 1])
            if f == DECK_FACE:
                surface = surface_at(deck, (x - deck_corner[0]) * per_metre, (y - deck_corner[1]) * per_metre)
            else:
                surface = surface_at(classes, (x - corner[0]) * per_metre, (y - corner[1]) * per_metre)
            tags[row, column] = tag_of_surface[surface]
    return tags, instances
