"""The contact sheet of a moment: from above, the LiDAR sweep, and what the cameras see."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lavsim.random import Draws
from lavsim.render.birdseye import box_outlines, draw_snapshot
from lavsim.render.camera_view import CameraView
from lavsim.render.canvas import Canvas, height_colours, write_png, write_text
from lavsim.render.frame import Mount
from lavsim.render.palette import EGO_BGR, PAPER_BGR, TAG_BGR
from lavsim.render.scene import Scene, get_scene
from lavsim.render.sweep import LidarModel, cast_sweep
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.map.town_map import TownMap


def _camera(yaw: float, width: int, fov: float) -> CameraView:
    return CameraView(width, 288, math.radians(fov), Mount(1.5, 0.0, 2.4, yaw=math.radians(yaw)))


# The cameras and the LiDAR of the LAV suite; a test holds them equal to `lavsim.sensors.suites`.
CAMERAS: tuple[tuple[str, CameraView], ...] = (
    ("camera -60 deg", _camera(-60.0, 256, 64.0)),
    ("camera 0 deg", _camera(0.0, 256, 64.0)),
    ("camera +60 deg", _camera(60.0, 256, 64.0)),
    ("telephoto", _camera(0.0, 480, 40.0)),
)
LIDAR_MOUNT = Mount(0.0, 0.0, 2.4)

_GAP, _HEADER, _LABEL = 8, 30, 20  # [px]
_PANEL = 560  # [px] height of the two pictures from above
_METRES = 80.0


def contact_sheet(
    town: TownMap, snapshots: Snapshot | Sequence[Snapshot], path: Path, route: ArrayLike | None = None
) -> None:
    """Writes the contact sheet of the newest snapshot as a PNG.

    Args:
        town: The map.
        snapshots: One, or several with the newest last: the sweep then joins its two halves.
        path: File to write.
        route: (R, 2 or 3) points of the route.
    """
    write_png(draw_sheet(get_scene(town), snapshots, route), path)


def draw_sheet(
    scene: Scene, snapshots: Snapshot | Sequence[Snapshot], route: ArrayLike | None = None
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 blue, green, red: what `contact_sheet` writes."""
    history = [snapshots] if isinstance(snapshots, Snapshot) else list(snapshots)
    snapshot = history[-1]
    width = sum(view.width for _, view in CAMERAS) + _GAP * (len(CAMERAS) + 1)
    panel = (width - 3 * _GAP) // 2
    tall = max(view.height for _, view in CAMERAS)
    sheet = np.empty((_HEADER + _PANEL + 2 * tall + 3 * (_LABEL + _GAP), width, 3), np.uint8)
    sheet[:] = PAPER_BGR
    write_text(sheet, _headline(scene, snapshot), (_GAP, 21), 0.55)
    top = _HEADER
    above = draw_snapshot(scene, snapshot, (panel, _PANEL), _METRES, route)
    _put(sheet, above.image, _GAP, top, "from above, heading up")
    _put(sheet, draw_sweep(scene, history[-2:], (panel, _PANEL)).image, 2 * _GAP + panel, top,
         "LiDAR returns by height, last full turn")  # fmt: skip
    top += _LABEL + _PANEL + _GAP
    left = _GAP
    for name, view in CAMERAS:
        tags, _ = view.labels(snapshot, scene)
        _put(sheet, view.colour(snapshot, scene)[..., :3], left, top, name)
        _put(sheet, TAG_BGR[tags], left, top + _LABEL + tall + _GAP, f"{name}: class tags")
        left += view.width + _GAP
    return sheet


def draw_sweep(scene: Scene, snapshots: Sequence[Snapshot], size: tuple[int, int]) -> Canvas:
    """Returns of the last ticks from above, coloured by height, with the actors' boxes of the newest."""
    ego = snapshots[-1].ego
    canvas = Canvas.facing(ego.x, ego.y, ego.yaw, size, size[0] / _METRES, 0.62, (24, 22, 20))
    draws = Draws.of_seed(0).stream("sheet")
    clouds = []
    for snapshot in snapshots:
        pose = LIDAR_MOUNT.pose(snapshot)
        sweep = cast_sweep(
            LidarModel(), pose, snapshot.tick, draws, scene.statics, scene.actors(snapshot),
            heights=scene.terrain.heights,
        )  # fmt: skip
        clouds.append(pose.to_world(sweep.points[:, :3].astype(np.float64)))
    points = np.concatenate(clouds)
    points = points[np.argsort(points[:, 2], kind="stable")]
    canvas.dots(points[:, :2], height_colours(points[:, 2], -0.5, 6.0))
    for i, corners in reversed(list(enumerate(box_outlines(snapshots[-1])))):
        canvas.outline(corners, EGO_BGR if i == 0 else (255, 255, 255))
    return canvas


def _headline(scene: Scene, snapshot: Snapshot) -> str:
    ego, control = snapshot.ego, snapshot.control
    return (
        f"{scene.name or 'scene'}   tick {snapshot.tick}   t = {snapshot.time:.2f} s"
        f"   {ego.forward_speed * 3.6:.0f} km/h   x {ego.x:.1f}  y {ego.y:.1f}  yaw {np.degrees(ego.yaw):.0f} deg"
        f"   throttle {control[0]:.2f}  steer {control[1]:+.2f}  brake {control[2]:.2f}"
    )


def _put(sheet: NDArray[np.uint8], picture: NDArray[np.uint8], left: int, top: int, label: str) -> None:
    write_text(sheet, label, (left, top + 14))
    height, width = picture.shape[:2]
    sheet[top + _LABEL : top + _LABEL + height, left : left + width] = picture
