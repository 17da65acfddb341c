"""Draws the faces of upright prisms into a buffer of inverse depths: the inner loops of `lavsim.render.zbuffer`.

A solid's corners are turned into the camera's frame once and shared by its faces; each face has an exact plane. Near
solids are drawn first, and a coarse grid of what they cover lets hidden ones behind them be passed over whole.
"""

from __future__ import annotations

import numpy as np

from lavsim.kernel import kernel, lean_kernel
from lavsim.render.solids import Material

NEAR = 0.1  # [m] nothing nearer along the optical axis is drawn
SMALLEST = 0.4  # [px] solids whose ball is smaller than this are left out
TOP, UNDERSIDE = 8, 9  # side numbers of the caps; 0 to 7 are the edges of the footprint
DECK_FACE = -2  # the top of a bridge's deck

TILE = 4  # [px]

_DECK = int(Material.DECK)
_CORNERS = 8
_STEPS, _STEPS_PER_ROOT = 256, 8.0  # of distance, by which solids are ordered; up to a kilometre


@kernel
def balls_of(solids):  # type: ignore[no-untyped-def]
    """(4, K) float64 x, y, z of the middle of each solid, and radius of the ball about it that holds the solid [m]."""
    centre, radius, z0, z1, tilt = solids.centre, solids.radius, solids.z0, solids.z1, solids.tilt
    balls = np.empty((4, len(radius)))
    for k in range(len(radius)):
        tall = (z1[k] - z0[k]) / 2.0 + radius[k] * np.sqrt(tilt[k, 0] * tilt[k, 0] + tilt[k, 1] * tilt[k, 1])
        balls[0, k], balls[1, k], balls[2, k] = centre[k, 0], centre[k, 1], (z0[k] + z1[k]) / 2.0
        balls[3, k] = np.sqrt(radius[k] * radius[k] + tall * tall)
    return balls


@lean_kernel
def _measure(balls, origin, axes, focal, width, height, distance):  # type: ignore[no-untyped-def]
    """Distance of each ball along the optical axis, infinite if it does not show; several balls at a time."""
    half_w, half_h = width / 2.0, height / 2.0
    slant_w, slant_h = np.sqrt(focal * focal + half_w * half_w), np.sqrt(focal * focal + half_h * half_h)
    ahead_x, ahead_y, ahead_z = axes[0, 0], axes[1, 0], axes[2, 0]
    right_x, right_y, right_z = axes[0, 1], axes[1, 1], axes[2, 1]
    up_x, up_y, up_z = axes[0, 2], axes[1, 2], axes[2, 2]
    eye_x, eye_y, eye_z = origin[0], origin[1], origin[2]
    ball_x, ball_y, ball_z, ball_reach = balls[0], balls[1], balls[2], balls[3]
    for k in range(len(ball_x)):
        cx, cy, cz, reach = ball_x[k] - eye_x, ball_y[k] - eye_y, ball_z[k] - eye_z, ball_reach[k]
        z = ahead_x * cx + ahead_y * cy + ahead_z * cz
        x = right_x * cx + right_y * cy + right_z * cz
        y = up_x * cx + up_y * cy + up_z * cz
        # A ball shows if no plane of the frustum, all of which pass the eye, parts it from the view.
        large = (z + reach >= NEAR) & (reach * focal >= SMALLEST * z)
        inside = abs(x) * focal - z * half_w < reach * slant_w
        distance[k] = z - reach if large & inside & (abs(y) * focal - z * half_h < reach * slant_h) else np.inf


@kernel
def _nearest_first(balls, origin, axes, focal, width, height):  # type: ignore[no-untyped-def]
    """Rows of the solids that may show, near ones first, by steps of distance that grow with it."""
    count = balls.shape[1]
    distance, rows, steps = np.empty(count), np.empty(count, np.int32), np.empty(count, np.int32)
    _measure(balls, origin, axes, focal, width, height, distance)
    begins, found = np.zeros(_STEPS + 1, np.int32), 0
    for k in range(count):
        if distance[k] < np.inf:
            step = min(int(np.sqrt(max(distance[k], 0.0)) * _STEPS_PER_ROOT), _STEPS - 1)
            rows[found], steps[found] = k, step
            begins[step + 1] += 1
            found += 1
    for step in range(_STEPS):
        begins[step + 1] += begins[step]
    order = np.empty(found, np.int32)
    for n in range(found):
        order[begins[steps[n]]] = rows[n]
        begins[steps[n]] += 1
    return order


@kernel
def draw_solids(  # type: ignore[no-untyped-def]
    solids, balls, offset, origin, axes, focal, depth, face, nearest_hidden, face_solid, face_side, found
):
    """Draws the faces that look at the eye where they are nearest, and lists those that show.

    Args:
        solids: `Solids`.
        balls: Of them, from `balls_of`.
        offset: Added to their rows in the list.
        origin, axes, focal: The camera.
        depth, face: Buffers.
        nearest_hidden: Of each tile of `TILE` pixels a bound: what has less inverse depth is hidden. Kept up here.
        face_solid, face_side, found: The list so far, and its length.

    Returns:
        The list's new length, and its columns, which may have grown.
    """
    height, width = depth.shape
    xy, count, z0, z1, tilt, material = solids.xy, solids.corners, solids.z0, solids.z1, solids.tilt, solids.material
    place = np.empty((_CORNERS, 2))  # of corners, from the eye
    corners, screen = np.empty((2 * _CORNERS, 3)), np.empty((2 * _CORNERS, 2))
    clipped, outline = np.empty((_CORNERS + 2, 3)), np.empty((_CORNERS + 2, 2))
    order, plane = np.empty(_CORNERS, np.int64), np.empty(3)
    left, right = np.empty(height), np.empty(height)
    for k in _nearest_first(balls, origin, axes, focal, width, height):
        if found + _CORNERS + 2 > len(face_solid):
            face_solid = np.concatenate((face_solid, np.empty_like(face_solid)))
            face_side = np.concatenate((face_side, np.empty_like(face_side)))
        n = count[k]
        tx, ty = tilt[k, 0], tilt[k, 1]
        lift = tx * (solids.centre[k, 0] - origin[0]) + ty * (solids.centre[k, 1] - origin[1])
        low, high = z0[k] - origin[2] - lift, z1[k] - origin[2] - lift  # of the two planes, above the eye
        nearest = np.inf
        for e in range(n):
            x, y = xy[k, e, 0] - origin[0], xy[k, e, 1] - origin[1]
            place[e, 0], place[e, 1] = x, y
            rise = tx * x + ty * y
            ahead, aside = axes[0, 0] * x + axes[1, 0] * y, axes[0, 1] * x + axes[1, 1] * y
            up = axes[0, 2] * x + axes[1, 2] * y
            for cap in range(2):
                z = (low if cap == 0 else high) + rise
                corners[e + _CORNERS * cap, 0] = aside + axes[2, 1] * z
                corners[e + _CORNERS * cap, 1] = -(up + axes[2, 2] * z)
                far = ahead + axes[2, 0] * z
                corners[e + _CORNERS * cap, 2] = far
                nearest = min(nearest, far)
        if nearest >= NEAR and _is_hidden(corners, screen, n, nearest, focal, width, height, nearest_hidden):
            continue
        for side in range(n + 2):
            nx, ny, nz, away, size = 0.0, 0.0, 0.0, 0.0, n
            if side < n:
                other = side + 1 if side + 1 < n else 0
                nx, ny = place[other, 1] - place[side, 1], place[side, 0] - place[other, 0]
                away, size = nx * place[side, 0] + ny * place[side, 1], 4
                order[0], order[1], order[2], order[3] = side, other, other + _CORNERS, side + _CORNERS
            else:
                sign = 1.0 if side == n else -1.0
                nx, ny, nz, away = -sign * tx, -sign * ty, sign, sign * (high if side == n else low)
                for e in range(n):
                    order[e] = e + (_CORNERS if side == n else 0)
            if away >= 0.0:
                continue
            plane[0] = (nx * axes[0, 1] + ny * axes[1, 1] + nz * axes[2, 1]) / away
            plane[1] = -(nx * axes[0, 2] + ny * axes[1, 2] + nz * axes[2, 2]) / away
            plane[2] = (nx * axes[0, 0] + ny * axes[1, 0] + nz * axes[2, 0]) / away
            if nearest >= NEAR:
                for e in range(size):
                    outline[e, 0], outline[e, 1] = screen[order[e], 0], screen[order[e], 1]
            else:
                size = _clip_near(corners, order, size, focal, width, height, clipped, outline)
            number = DECK_FACE if side == n and material[k] == _DECK else found
            if _fill(outline, size, plane, focal, depth, face, number, nearest_hidden, left, right) and number == found:
                face_solid[found], face_side[found] = k + offset, side if side < n else TOP + side - n
                found += 1
    return found, face_solid, face_side


@lean_kernel
def _is_hidden(corners, screen, n, nearest, focal, width, height, nearest_hidden):  # type: ignore[no-untyped-def]
    """Fills `screen` with the corners' pixels; whether the solid covers no pixel or lies behind what is drawn."""
    top, bottom, begin, end = np.inf, -np.inf, np.inf, -np.inf
    for cap in range(2):
        for e in range(_CORNERS * cap, _CORNERS * cap + n):
            scale = focal / corners[e, 2]
            x, y = corners[e, 0] * scale + width / 2.0, corners[e, 1] * scale + height / 2.0
            screen[e, 0], screen[e, 1] = x, y
            top, bottom, begin, end = min(top, y), max(bottom, y), min(begin, x), max(end, x)
    if end < 0.5 or begin > width - 0.5 or bottom < 0.5 or top > height - 0.5:
        return True
    if np.ceil(top - 0.5) >= np.ceil(bottom - 0.5) or np.ceil(begin - 0.5) >= np.ceil(end - 0.5):
        return True  # it lies between the pixels' centres
    closest = 1.0 / nearest
    first, last = int(max(top, 0.0)) // TILE, int(min(bottom, height - 1.0)) // TILE
    start, stop = int(max(begin, 0.0)) // TILE, int(min(end, width - 1.0)) // TILE
    for row in range(first, last + 1):
        for column in range(start, stop + 1):
            if nearest_hidden[row, column] < closest:
                return False
    return True


@lean_kernel
def _clip_near(corners, order, size, focal, width, height, clipped, outline):  # type: ignore[no-untyped-def]
    """Pixels of the part of a face beyond the near plane; how many."""
    kept = 0
    for e in range(size):
        a, b = order[e], order[e + 1 if e + 1 < size else 0]
        here, there = corners[a, 2] >= NEAR, corners[b, 2] >= NEAR
        if here:
            clipped[kept, 0], clipped[kept, 1], clipped[kept, 2] = corners[a, 0], corners[a, 1], corners[a, 2]
            kept += 1
        if here != there:
            share = (NEAR - corners[a, 2]) / (corners[b, 2] - corners[a, 2])
            for axis in range(2):
                clipped[kept, axis] = corners[a, axis] + share * (corners[b, axis] - corners[a, axis])
            clipped[kept, 2] = NEAR
            kept += 1
    for e in range(kept):
        outline[e, 0] = clipped[e, 0] * focal / clipped[e, 2] + width / 2.0
        outline[e, 1] = clipped[e, 1] * focal / clipped[e, 2] + height / 2.0
    return kept


@lean_kernel
def _fill(  # type: ignore[no-untyped-def]
    outline, size, plane, focal, depth, face, number, nearest_hidden, left, right
):
    """Draws one face where it is nearest; whether it covers a pixel's centre nearer than what was there."""
    if size < 3:
        return False
    height, width = depth.shape
    top, bottom, least, most = np.inf, -np.inf, np.inf, -np.inf
    for e in range(size):
        top, bottom = min(top, outline[e, 1]), max(bottom, outline[e, 1])
        least, most = min(least, outline[e, 0]), max(most, outline[e, 0])
    first, last = int(max(0.0, np.ceil(top - 0.5))), int(min(float(height), np.ceil(bottom - 0.5)))
    if first >= last or np.ceil(most - 0.5) <= max(0.0, np.ceil(least - 0.5)) or least >= width:
        return False
    for row in range(first, last):
        left[row], right[row] = np.inf, -np.inf
    for e in range(size):  # crossings of the rows' centre lines, downward, so that neighbours agree on an edge
        f = e + 1 if e + 1 < size else 0
        upper, lower = (e, f) if outline[e, 1] <= outline[f, 1] else (f, e)
        y0, y1 = outline[upper, 1], outline[lower, 1]
        begin, end = max(first, int(max(-1.0, np.ceil(y0 - 0.5)))), min(last, int(min(1e6, np.ceil(y1 - 0.5))))
        if begin >= end:
            continue
        x0 = outline[upper, 0]
        slope = (outline[lower, 0] - x0) / (y1 - y0)
        for row in range(begin, end):
            x = x0 + (row + 0.5 - y0) * slope
            left[row], right[row] = min(left[row], x), max(right[row], x)
    a, b = plane[0] / focal, plane[1] / focal
    c = plane[2] + a * (0.5 - width / 2.0) + b * (0.5 - height / 2.0)
    drawn = False
    for row in range(first, last):
        begin = int(max(0.0, np.ceil(left[row] - 0.5)))
        end = int(min(float(width), np.ceil(right[row] - 0.5)))
        if begin < end:
            start = np.float32(c + b * row + a * begin)
            drawn = _fill_row(depth[row, begin:end], face[row, begin:end], start, np.float32(a), number) or drawn
    if drawn and most - least > TILE and last - first > TILE:
        _raise_bounds(first, last, left, right, a, b, c, width, nearest_hidden)
    return drawn


@lean_kernel
def _raise_bounds(first, last, left, right, a, b, c, width, nearest_hidden):  # type: ignore[no-untyped-def]
    """Raises the bounds of the tiles that a face covers wholly to its least inverse depth there."""
    for tile in range(-(-first // TILE), last // TILE):
        begin, end = 0.0, float(width)
        for row in range(tile * TILE, tile * TILE + TILE):
            begin, end = max(begin, np.ceil(left[row] - 0.5)), min(end, np.ceil(right[row] - 0.5))
        middle = c + b * (tile * TILE + (TILE - 1) / 2.0)
        slack = (abs(a) + abs(b)) * (TILE - 1) / 2.0
        for column in range(-(-int(begin) // TILE), int(end) // TILE):
            least = middle + a * (column * TILE + (TILE - 1) / 2.0) - slack
            nearest_hidden[tile, column] = max(nearest_hidden[tile, column], least)


@lean_kernel
def _fill_row(depth, face, start, step, number):  # type: ignore[no-untyped-def]
    """Selects instead of branches: the loop is done several pixels at a time."""
    drawn, number = 0, np.int32(number)
    for i in range(len(depth)):
        value = start + step * np.float32(i)
        nearer = value > depth[i]
        drawn |= nearer
        depth[i] = value if nearer else depth[i]
        face[i] = number if nearer else face[i]
    return drawn != 0
