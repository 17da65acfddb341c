"""Which face each pixel of a pinhole camera sees: convex faces, an exact plane each, and a buffer of inverse depths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.render.frame import Pose
from lavsim.render.heights import LEVEL_GROUND, Heights, level_within, meet_ground
from lavsim.render.solids import Material, Solids

NEAR = 0.1  # [m] nothing nearer along the optical axis is drawn
SMALLEST = 0.3  # [px] solids whose circle is smaller than this are left out
TOP, UNDERSIDE = 8, 9  # side numbers of the caps; 0 to 7 are the edges of the footprint

NO_FACE = -1  # ground where the inverse depth is positive, sky where it is 0
DECK_FACE = -2  # the top of a bridge's deck
FARTHEST = 1000.0  # [m] of ground that is not level
_CARRIED = 0.98  # share of the run of a pixel's lower neighbour up to which its ray needs no look at the ground

_DECK = int(Material.DECK)


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
) -> Visibility:
    """What a camera at `pose` sees, drawn into `buffers`."""
    face, depth = new_buffers(lens) if buffers is None else buffers
    solid, side = _draw(face, depth, lens.focal, pose.origin, pose.axes, statics, actors, heights)
    return Visibility(face, depth, Faces(solid, side))


@kernel
def _draw(face, depth, focal, origin, axes, statics, actors, heights):  # type: ignore[no-untyped-def]
    face.fill(NO_FACE)
    level = level_within(heights, origin[0], origin[1], FARTHEST)
    if np.isnan(level):
        _draw_slopes(depth, focal, origin, axes, heights)
    else:
        _draw_plane(depth, focal, origin, axes, level)
    capacity = 4 * (len(statics.corners) + len(actors.corners)) + 64
    solid, side = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    found, solid, side = _draw_solids(statics, 0, origin, axes, focal, depth, face, solid, side, 0)
    found, solid, side = _draw_solids(
        actors, len(statics.corners), origin, axes, focal, depth, face, solid, side, found
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


@kernel
def _is_in_view(x, y, z, reach, focal, width, height):  # type: ignore[no-untyped-def]
    """Whether a ball at right, down, forward with radius `reach` can show; the frustum's planes pass the eye."""
    if z + reach < NEAR or reach * focal < SMALLEST * z:
        return False
    half_w, half_h = width / 2.0, height / 2.0
    slant_w, slant_h = np.sqrt(focal * focal + half_w * half_w), np.sqrt(focal * focal + half_h * half_h)
    return abs(x) * focal - z * half_w < reach * slant_w and abs(y) * focal - z * half_h < reach * slant_h


@kernel
def _draw_solids(  # type: ignore[no-untyped-def]
    solids, offset, origin, axes, focal, depth, face, face_solid, face_side, found
):
    height, width = depth.shape
    corners = np.empty((10, 3))
    clipped, screen = np.empty((10, 3)), np.empty((10, 2))
    left, right = np.empty(height), np.empty(height)
    scratch = (clipped, screen, left, right)
    for k in range(len(solids.corners)):
        cx, cy = solids.centre[k, 0] - origin[0], solids.centre[k, 1] - origin[1]
        low, high = solids.z0[k] - origin[2], solids.z1[k] - origin[2]
        tilt_x, tilt_y = solids.tilt[k, 0], solids.tilt[k, 1]
        is_tilted = tilt_x != 0.0 or tilt_y != 0.0
        cz, tall = (low + high) / 2.0, (high - low) / 2.0
        if is_tilted:
            tall += solids.radius[k] * np.sqrt(tilt_x * tilt_x + tilt_y * tilt_y)
        reach = np.sqrt(solids.radius[k] * solids.radius[k] + tall * tall)
        z = axes[0, 0] * cx + axes[1, 0] * cy + axes[2, 0] * cz
        if z + reach < NEAR:
            continue
        x = axes[0, 1] * cx + axes[1, 1] * cy + axes[2, 1] * cz
        y = -(axes[0, 2] * cx + axes[1, 2] * cy + axes[2, 2] * cz)
        if not _is_in_view(x, y, z, reach, focal, width, height):
            continue
        if found + 10 > len(face_solid):
            face_solid = np.concatenate((face_solid, np.empty_like(face_solid)))
            face_side = np.concatenate((face_side, np.empty_like(face_side)))
        if is_tilted:  # heights of the two planes above and below the eye
            lift = tilt_x * cx + tilt_y * cy
            low, high = low - lift, high - lift
        n = solids.corners[k]
        is_deck = solids.material[k] == _DECK
        for side in range(n + 2):
            size = _face_corners(solids, k, side, n, origin, low, high, axes, corners, is_tilted)
            if size == 0:
                continue
            if is_deck and side == n:
                _draw_face(corners, size, focal, depth, face, DECK_FACE, scratch)
            elif _draw_face(corners, size, focal, depth, face, found, scratch):
                face_solid[found] = k + offset
                face_side[found] = side if side < n else TOP + side - n
                found += 1
    return found, face_solid, face_side


@kernel
def _to_camera(axes, x, y, z, out):  # type: ignore[no-untyped-def]
    out[0] = axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z
    out[1] = -(axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z)
    out[2] = axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z


@kernel
def _face_corners(  # type: ignore[no-untyped-def]
    solids, k, side, n, origin, low, high, axes, corners, is_tilted
):
    """Fills `corners` with a face's corners in the camera frame (right, down, forward); 0 if it looks away.

    `low` and `high` are the heights of the underside and the top over the eye.
    """
    tx, ty = (solids.tilt[k, 0], solids.tilt[k, 1]) if is_tilted else (0.0, 0.0)
    if side >= n:
        if (side == n and high >= 0.0) or (side == n + 1 and low <= 0.0):
            return 0
        level = high if side == n else low
        for e in range(n):
            x, y = solids.xy[k, e, 0] - origin[0], solids.xy[k, e, 1] - origin[1]
            _to_camera(axes, x, y, level + tx * x + ty * y, corners[e])
        return n
    other = side + 1 if side + 1 < n else 0
    ax, ay = solids.xy[k, side, 0] - origin[0], solids.xy[k, side, 1] - origin[1]
    bx, by = solids.xy[k, other, 0] - origin[0], solids.xy[k, other, 1] - origin[1]
    if (by - ay) * ax - (bx - ax) * ay >= 0.0:
        return 0
    rise_a, rise_b = tx * ax + ty * ay, tx * bx + ty * by
    _to_camera(axes, ax, ay, low + rise_a, corners[0])
    _to_camera(axes, bx, by, low + rise_b, corners[1])
    _to_camera(axes, bx, by, high + rise_b, corners[2])
    _to_camera(axes, ax, ay, high + rise_a, corners[3])
    return 4


@kernel
def _clip_near(corners, size, clipped):  # type: ignore[no-untyped-def]
    """The part of a face beyond the near plane."""
    kept = 0
    for e in range(size):
        f = e + 1 if e + 1 < size else 0
        here, there = corners[e, 2] >= NEAR, corners[f, 2] >= NEAR
        if here:
            clipped[kept, 0], clipped[kept, 1], clipped[kept, 2] = corners[e, 0], corners[e, 1], corners[e, 2]
            kept += 1
        if here != there:
            share = (NEAR - corners[e, 2]) / (corners[f, 2] - corners[e, 2])
            for axis in range(2):
                clipped[kept, axis] = corners[e, axis] + share * (corners[f, axis] - corners[e, axis])
            clipped[kept, 2] = NEAR
            kept += 1
    return kept


@kernel
def _plane(corners, size):  # type: ignore[no-untyped-def]
    """Coefficients (a, b, c) of a face's inverse depth a*x + b*y + c over image directions (x, y, 1)."""
    nx, ny, nz = 0.0, 0.0, 0.0
    for e in range(size):  # Newell's normal, which short edges can't spoil
        f = e + 1 if e + 1 < size else 0
        nx += (corners[e, 1] - corners[f, 1]) * (corners[e, 2] + corners[f, 2])
        ny += (corners[e, 2] - corners[f, 2]) * (corners[e, 0] + corners[f, 0])
        nz += (corners[e, 0] - corners[f, 0]) * (corners[e, 1] + corners[f, 1])
    away = nx * corners[0, 0] + ny * corners[0, 1] + nz * corners[0, 2]
    return nx / away, ny / away, nz / away


@kernel
def _draw_face(corners, size, focal, depth, face, number, scratch):  # type: ignore[no-untyped-def]
    """Draws one face where it is nearest; whether it covers the centre of any pixel."""
    clipped, screen, left, right = scratch
    height, width = depth.shape
    kept = _clip_near(corners, size, clipped)
    if kept < 3:
        return False
    top, bottom = np.inf, -np.inf
    for e in range(kept):
        screen[e, 0] = focal * clipped[e, 0] / clipped[e, 2] + width / 2.0
        screen[e, 1] = focal * clipped[e, 1] / clipped[e, 2] + height / 2.0
        top, bottom = min(top, screen[e, 1]), max(bottom, screen[e, 1])
    first = int(max(0.0, np.ceil(top - 0.5)))
    last = int(min(float(height), np.ceil(bottom - 0.5)))
    if first >= last:
        return False
    for row in range(first, last):
        left[row], right[row] = np.inf, -np.inf
    _trace_edges(screen, kept, first, last, left, right)
    a, b, c = _plane(corners, size)
    a, b = a / focal, b / focal
    c += a * (0.5 - width / 2.0)
    drawn = False
    for row in range(first, last):
        begin = int(max(0.0, np.ceil(left[row] - 0.5)))
        end = int(min(float(width), np.ceil(right[row] - 0.5)))
        if begin < end:
            drawn = True
            _fill_row(depth[row], face[row], begin, end, a, c + b * (row + 0.5 - height / 2.0), number)
    return drawn


@kernel
def _trace_edges(screen, kept, first, last, left, right):  # type: ignore[no-untyped-def]
    """Leftmost and rightmost crossing of each pixel row's centre line; downward, so neighbours agree on an edge."""
    for e in range(kept):
        f = e + 1 if e + 1 < kept else 0
        upper, lower = (e, f) if screen[e, 1] <= screen[f, 1] else (f, e)
        y0, y1 = screen[upper, 1], screen[lower, 1]
        begin, end = max(first, int(max(-1.0, np.ceil(y0 - 0.5)))), min(last, int(min(1e6, np.ceil(y1 - 0.5))))
        if begin >= end:
            continue
        x0 = screen[upper, 0]
        slope = (screen[lower, 0] - x0) / (y1 - y0)
        for row in range(begin, end):
            x = x0 + (row + 0.5 - y0) * slope
            left[row], right[row] = min(left[row], x), max(right[row], x)


@kernel
def _fill_row(depth, face, begin, end, a, c, number):  # type: ignore[no-untyped-def]
    for column in range(begin, end):
        value = np.float32(c + a * column)
        if value > depth[column]:
            depth[column], face[column] = value, number
