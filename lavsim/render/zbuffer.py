"""Which face each pixel of a pinhole camera sees: convex faces, an exact plane each, and a buffer of inverse depths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.render.faces import TILE, balls_of, draw_solids
from lavsim.render.frame import Pose
from lavsim.render.heights import LEVEL_GROUND, Heights, level_within, meet_ground
from lavsim.render.solids import Solids

NO_FACE = -1  # ground where the inverse depth is positive, sky where it is 0
FARTHEST = 1000.0  # [m] of ground that is not level
_CARRIED = 0.98  # share of the run of a pixel's lower neighbour up to which its ray needs no look at the ground


class Pinhole(NamedTuple):
    """A camera's image plane: `width` x `height` pixels, `focal` [px], principal point at the centre."""

    width: int
    height: int
    focal: float


class Faces(NamedTuple):
    """The faces that were drawn, one row a face.

    Attributes:
        solid: (F,) int32 row of the solid, actors after statics.
        side: (F,) int32 edge of the footprint, `TOP` or `UNDERSIDE`.
    """

    solid: NDArray[np.int32]
    side: NDArray[np.int32]


class Visibility(NamedTuple):
    """What one pass leaves.

    Attributes:
        face: (H, W) int32 row in `faces`, `NO_FACE` for ground and sky, `DECK_FACE` for the road on a bridge.
        inverse_depth: (H, W) float32 one over the distance along the optical axis [1/m], 0 for sky.
        faces: The faces drawn.
    """

    face: NDArray[np.int32]
    inverse_depth: NDArray[np.float32]
    faces: Faces


Balls = tuple[NDArray[np.float64], NDArray[np.float64]]
Buffers = tuple[NDArray[np.int32], NDArray[np.float32]]  # of `Visibility.face` and `.inverse_depth`


def new_buffers(lens: Pinhole) -> Buffers:
    """What `draw_visibility` draws into; worth keeping, since fresh memory costs as much as drawing."""
    shape = (lens.height, lens.width)
    return np.empty(shape, np.int32), np.empty(shape, np.float32)


def draw_visibility(
    lens: Pinhole,
    pose: Pose,
    statics: Solids,
    actors: Solids,
    buffers: Buffers | None = None,
    heights: Heights = LEVEL_GROUND,
    balls: Balls | None = None,
    bounds: NDArray[np.float64] | None = None,
) -> Visibility:
    """What a camera at `pose` sees, drawn into `buffers`.

    `balls` are `balls_of` the statics and the actors. `bounds` (rows, columns of tiles) are inverse depths below which
    nothing need be drawn, infinite where the picture is not wanted; they are drawn over.
    """
    face, depth = new_buffers(lens) if buffers is None else buffers
    if balls is None:
        balls = balls_of(statics), balls_of(actors)
    if bounds is None:
        bounds = np.zeros((-(-lens.height // TILE), -(-lens.width // TILE)))
    solid, side = _draw(face, depth, lens.focal, pose.origin, pose.axes, statics, actors, *balls, heights, bounds)
    return Visibility(face, depth, Faces(solid, side))


@kernel
def _draw(  # type: ignore[no-untyped-def]
    face, depth, focal, origin, axes, statics, actors, static_balls, actor_balls, heights, hidden
):
    face.fill(NO_FACE)
    level = level_within(heights, origin[0], origin[1], FARTHEST)
    if np.isnan(level):
        _draw_slopes(depth, focal, origin, axes, heights)
    else:
        _draw_plane(depth, focal, origin, axes, level)
    solid, side = np.empty(1024, np.int32), np.empty(1024, np.int32)
    found, solid, side = draw_solids(statics, static_balls, 0, origin, axes, focal, depth, face, hidden, solid, side, 0)
    found, solid, side = draw_solids(
        actors, actor_balls, len(statics.corners), origin, axes, focal, depth, face, hidden, solid, side, found
    )
    return solid[:found].copy(), side[:found].copy()


@kernel
def _draw_plane(depth, focal, origin, axes, level):  # type: ignore[no-untyped-def]
    """Inverse depths of the ground plane z = `level`, 0 above its horizon."""
    height, width = depth.shape
    across, down, base = -axes[2, 1] / focal, axes[2, 2] / focal, -axes[2, 0]
    above = origin[2] - level
    scale = 1.0 / above if above > 0.0 else 0.0
    for row in range(height):
        first = base + down * (row + 0.5 - height / 2.0)
        for column in range(width):
            depth[row, column] = max(0.0, (first + across * (column + 0.5 - width / 2.0)) * scale)


@kernel
def _draw_slopes(depth, focal, origin, axes, heights):  # type: ignore[no-untyped-def]
    """Inverse depths of the ground; each pixel's search begins near where its lower neighbour's ended."""
    height, width = depth.shape
    carried = _CARRIED if axes[2, 2] > 0.9 else 0.0  # of a camera on its side, rows are no order of nearness
    headings, slopes, flat, runs = np.empty((height, 2)), np.empty(height), np.empty(height), np.empty(height)
    limits = np.full(height, FARTHEST)
    for column in range(width):
        u = (column + 0.5 - width / 2.0) / focal
        for n in range(height):  # from the bottom row up
            v = (height / 2.0 - n - 0.5) / focal
            x = axes[0, 0] + u * axes[0, 1] - v * axes[0, 2]
            y = axes[1, 0] + u * axes[1, 1] - v * axes[1, 2]
            flat[n] = max(np.sqrt(x * x + y * y), 1e-9)
            headings[n, 0], headings[n, 1] = x / flat[n], y / flat[n]
            slopes[n] = (axes[2, 0] + u * axes[2, 1] - v * axes[2, 2]) / flat[n]
        meet_ground(heights, origin, headings, slopes, limits, carried, runs)
        for n in range(height):
            depth[height - 1 - n, column] = flat[n] / max(runs[n], 1e-3)
