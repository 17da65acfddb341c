"""Boxes of a frame's actors, and where cameras and pictures from above show them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.geometry import box_corners, to_local
from lavsim.render.camera_view import CameraView
from lavsim.render.frame import Pose, rotation
from lavsim.render.palette import Bgr
from lavsim.types import ActorClass

Floats = NDArray[np.float64]
Line = tuple[tuple[int, int], tuple[int, int]]

_NEAR = 0.1  # [m] before the lens, where boxes are cut

# Colours of boxes: seen by this camera or this LiDAR, hardly or not, walkers, and what the ego stops for.
SEEN_BGR: Bgr = (80, 220, 60)
HIDDEN_BGR: Bgr = (150, 150, 150)
WALKER_BGR: Bgr = (40, 160, 255)
CAUSE_BGR: Bgr = (60, 40, 240)

# A box's edges as pairs of its corners: the four below, the four above, the four between.
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


@dataclass(frozen=True)
class Boxes:
    """Actors of a frame, but for the ego.

    Attributes:
        corners: (A, 8, 3) world [m]; front left, front right, rear right, rear left below, then above.
        outlines: (A, 4, 2) in the ego's frame [m].
        colours: Of each, when it is seen.
        row: Their rows in the frame's actors.
    """

    corners: Floats
    outlines: Floats
    colours: list[Bgr]
    row: NDArray[np.int64]

    @staticmethod
    def of(row: Mapping[str, Any]) -> Boxes:
        others = np.flatnonzero(row["actor_id"] != row["actor_id"][0])
        position, size = row["actor_position"][others], row["actor_size"][others].astype(np.float64)
        yaw, pitch = row["actor_yaw"][others], row["actor_pitch"][others].astype(np.float64)
        outlines = box_corners(position[:, 0], position[:, 1], yaw, size[:, 0], size[:, 1])
        local = to_local(outlines.reshape(-1, 2), row["position"][:2], float(row["yaw"])).reshape(-1, 4, 2)
        colours = []
        for k in others.tolist():
            is_walker = row["actor_class"][k] == ActorClass.WALKER
            is_cause = row["brake_actor"] and row["actor_id"][k] == row["brake_actor"]
            colours.append(CAUSE_BGR if is_cause else WALKER_BGR if is_walker else SEEN_BGR)
        return Boxes(box_corners_3d(position, size, yaw, pitch), local, colours, others)


def projected_edges(view: CameraView, corners: Floats, factor: float) -> list[Line]:
    """Ends of the visible edges of a box (8, 3) in the camera's frame, in 1/16 pixel of the enlarged image."""
    lines = []
    for a, b in _EDGES:
        begin, end = corners[a], corners[b]
        if begin[0] < _NEAR and end[0] < _NEAR:
            continue
        if begin[0] < _NEAR or end[0] < _NEAR:
            cut = begin + (end - begin) * (_NEAR - begin[0]) / (end[0] - begin[0])
            begin, end = (cut, end) if begin[0] < _NEAR else (begin, cut)
        ends = np.array([begin, end])
        column = view.width / 2.0 + view.lens.focal * ends[:, 1] / ends[:, 0]
        height = view.height / 2.0 - view.lens.focal * ends[:, 2] / ends[:, 0]
        pixels = np.clip((np.stack([column, height], axis=1) * factor - 0.5) * 16.0, -(2**20), 2**20)
        (x0, y0), (x1, y1) = np.rint(pixels).astype(int).tolist()
        lines.append(((x0, y0), (x1, y1)))
    return lines


def box_corners_3d(position: Floats, size: Floats, yaw: Floats, pitch: Floats) -> Floats:
    """(A, 8, 3) world corners of boxes that stand on the ground at `position` (A, 3)."""
    ahead, aside, up = np.array(
        [(1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, -1, 1)], np.float64
    ).T  # fmt: skip
    local = np.stack([size[:, :1] / 2.0 * ahead, size[:, 1:2] / 2.0 * aside, size[:, 2:] * up], axis=-1)
    turns = np.array([rotation(0.0, p, y) for p, y in zip(pitch, yaw, strict=True)]).reshape(-1, 3, 3)
    return np.einsum("aij,akj->aki", turns, local) + position[:, None, :]


def camera_pose(view: CameraView, row: Mapping[str, Any]) -> Pose:
    """Where a camera of the ego was."""
    mount = view.mount
    body = rotation(0.0, float(row["pitch"]), float(row["yaw"]))
    origin = row["position"] + body @ np.array([mount.x, mount.y, mount.z])
    return Pose(origin, body @ rotation(mount.roll, mount.pitch, mount.yaw))
