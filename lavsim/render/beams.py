"""Where the beams of a LiDAR end: kernels that cast every solid into the beams that can meet it.

A level sensor's beams of one azimuth lie in one upright plane, so a solid is cut once per azimuth and serves all
channels: it covers a contiguous run of them. Solids come front to back and are skipped where nothing behind can be
seen any more. A tilted sensor has no such planes; there each beam is cut on its own.

Solids whose tops slope need no kernel of their own: along one azimuth they are level ones under beams that slope less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.render.heights import level_within, meet_ground

NO_HIT = -2
GROUND_HIT = -1


class Beams(NamedTuple):
    """Per channel, topmost first: slope (rise over horizontal run), its inverse, secant, horizontal range [m]."""

    slope: NDArray[np.float64]
    inverse: NDArray[np.float64]
    secant: NDArray[np.float64]
    reach: NDArray[np.float64]


@lean_kernel
def _plane_run(height, inverse):  # type: ignore[no-untyped-def]
    """Horizontal run [m] to a level ground of a beam `height` above it, `inverse` being run over rise."""
    run = -height * inverse
    return run if run > 0.0 else np.inf


@kernel
def _start_level(origin, direction, beams, level, sent, run, hit, farthest):  # type: ignore[no-untyped-def]
    """Ground returns of all beams over a plane: the same in every column."""
    columns, channels = sent.shape
    first_run, first_hit = np.empty(channels), np.empty(channels, np.int32)
    for i in range(channels):
        ground = _plane_run(origin[2] - level, beams.inverse[i])
        first_run[i] = min(ground, beams.reach[i])
        first_hit[i] = GROUND_HIT if ground <= beams.reach[i] else NO_HIT
    for j in range(columns):
        for i in range(channels):
            run[j, i] = first_run[i] if sent[j, i] else -1.0
            hit[j, i] = first_hit[i]
            farthest[j] = max(farthest[j], run[j, i])


@kernel
def _start_sloping(origin, direction, beams, heights, sent, run, hit, farthest):  # type: ignore[no-untyped-def]
    """Ground returns over slopes: the beams of a column lie in one upright plane, so each begins where the steeper
    one below it met the ground."""
    columns, channels = sent.shape
    headings, slopes, limits = np.empty((channels, 2)), beams.slope[::-1].copy(), beams.reach[::-1].copy()
    met = np.empty(channels)
    for j in range(columns):
        headings[:] = direction[j]
        meet_ground(heights, origin, headings, slopes, limits, 1.0, met)
        for i in range(channels):
            ground = met[channels - 1 - i]
            run[j, i] = min(ground, beams.reach[i]) if sent[j, i] else -1.0
            hit[j, i] = GROUND_HIT if ground <= beams.reach[i] else NO_HIT
            farthest[j] = max(farthest[j], run[j, i])


@kernel
def cast_level(  # type: ignore[no-untyped-def]
    origin, start, step, beams, sent, run, hit, statics, actors, heights, max_range
):
    """Fills `run` with distances [m] and `hit` with what was met; beams not sent have a negative distance.

    Args:
        origin: Of the sensor, which stands level.
        start, step: World bearing of the first column and between columns [rad]; at most a full turn in all.
        beams: By channel, topmost first.
        sent: (columns, channels) bool.
        run, hit: (columns, channels) to fill.
        statics, actors, heights: What there is to meet.
        max_range: [m]
    """
    columns, channels = sent.shape
    farthest, direction = np.zeros(columns), np.empty((columns, 2))
    for j in range(columns):
        direction[j, 0], direction[j, 1] = np.cos(start + j * step), np.sin(start + j * step)
    level = level_within(heights, origin[0], origin[1], max_range)
    if np.isnan(level):
        _start_sloping(origin, direction, beams, heights, sent, run, hit, farthest)
    else:
        _start_level(origin, direction, beams, level, sent, run, hit, farthest)
    _cast_solids(statics, 0, origin, start, step, direction, beams, max_range, run, hit, farthest)
    _cast_solids(actors, len(statics.corners), origin, start, step, direction, beams, max_range, run, hit, farthest)
    for j in range(columns):
        for i in range(channels):
            run[j, i] *= beams.secant[i]


@kernel
def _near_first(centre, radius, ox, oy, max_range):  # type: ignore[no-untyped-def]
    """Rows of the solids within range, nearest first."""
    rows, near = np.empty(len(radius), np.int32), np.empty(len(radius))
    found = 0
    for k in range(len(radius)):
        dx, dy = centre[k, 0] - ox, centre[k, 1] - oy
        reach = max_range + radius[k]
        square = dx * dx + dy * dy
        if square < reach * reach:
            rows[found], near[found] = k, np.sqrt(square) - radius[k]
            found += 1
    return rows[:found][np.argsort(near[:found], kind="mergesort")]


@lean_kernel
def _edges(xy, k, n, ox, oy, edges):  # type: ignore[no-untyped-def]
    """Fills `edges` (n, 3) with outward normals and their offsets from the origin; True if the origin is inside.

    Like its neighbours it takes the arrays it needs: to pass all of `Solids` costs more than the work.
    """
    inside = True
    for e in range(n):
        f = e + 1 if e + 1 < n else 0
        x, y = xy[k, e, 0] - ox, xy[k, e, 1] - oy
        nx, ny = xy[k, f, 1] - oy - y, x - (xy[k, f, 0] - ox)
        edges[e, 0], edges[e, 1], edges[e, 2] = nx, ny, nx * x + ny * y
        inside = inside and edges[e, 2] >= 0.0
    return inside


@lean_kernel
def _span(xy, k, n, cx, cy, ox, oy, inside):  # type: ignore[no-untyped-def]
    """Bearing of a solid's centre, at `cx`, `cy` from the origin, and the extremes of its footprint from it [rad]."""
    if inside:
        return 0.0, -np.pi, np.pi
    low, high = 0.0, 0.0
    for e in range(n):
        x, y = xy[k, e, 0] - ox, xy[k, e, 1] - oy
        angle = np.arctan2(cx * y - cy * x, cx * x + cy * y)
        low, high = min(low, angle), max(high, angle)
    return np.arctan2(cy, cx), low, high


@lean_kernel
def _cut(edges, n, dx, dy):  # type: ignore[no-untyped-def]
    """Runs at which a horizontal ray enters and leaves a footprint; enter > leave if it misses."""
    enter, leave = -np.inf, np.inf
    for e in range(n):
        along = edges[e, 0] * dx + edges[e, 1] * dy
        if along < 0.0:
            enter = max(enter, edges[e, 2] / along)
        elif along > 0.0:
            leave = min(leave, edges[e, 2] / along)
        elif edges[e, 2] < 0.0:
            return 1.0, 0.0
    if leave <= 0.0:
        return 1.0, 0.0
    return enter, leave


@kernel
def _cast_solids(  # type: ignore[no-untyped-def]
    solids, offset, origin, start, step, direction, beams, max_range, run, hit, farthest
):
    turn = 2.0 * np.pi
    columns = len(direction)
    edges = np.empty((8, 3))
    slope, inverse = beams.slope, beams.inverse
    xy, corners, centre, z0, z1, tilt = solids.xy, solids.corners, solids.centre, solids.z0, solids.z1, solids.tilt
    ox, oy, oz = origin[0], origin[1], origin[2]
    for k in _near_first(centre, solids.radius, ox, oy, max_range):
        n, cx, cy, tilt_x, tilt_y = corners[k], centre[k, 0] - ox, centre[k, 1] - oy, tilt[k, 0], tilt[k, 1]
        lift = tilt_x * cx + tilt_y * cy
        below, above = z0[k] - lift - oz, z1[k] - lift - oz
        inside = _edges(xy, k, n, ox, oy, edges)
        if inside and below <= 0.0 <= above:
            continue  # the sensor is in it
        bearing, low, high = _span(xy, k, n, cx, cy, ox, oy, inside)
        bearing = (bearing - start) % turn
        for shift in range(-1, 2):
            first = max(0, int(np.ceil((bearing + low + shift * turn) / step)))
            last = min(columns - 1, int(np.floor((bearing + high + shift * turn) / step)))
            for j in range(first, last + 1):
                enter, leave = _cut(edges, n, direction[j, 0], direction[j, 1])
                enter = max(enter, 0.0)
                if enter < leave and enter < farthest[j]:
                    rise = tilt_x * direction[j, 0] + tilt_y * direction[j, 1]
                    _fill_column(slope, inverse, below, above, rise, enter, leave, k + offset, run, hit, farthest, j)


@lean_kernel
def _channel_at(slope, value):  # type: ignore[no-untyped-def]
    """First channel whose slope is at most `value`; slopes fall with the channel."""
    low, high = 0, len(slope)
    while low < high:
        middle = (low + high) >> 1
        if slope[middle] > value:
            low = middle + 1
        else:
            high = middle
    return low


@lean_kernel
def _fill_column(  # type: ignore[no-untyped-def]
    slope, inverse, below, above, rise, enter, leave, row, run, hit, farthest, j
):
    """Shortens the beams of azimuth j that meet a solid between runs `enter` and `leave`.

    Underside and top climb by `rise` along the azimuth, from `below` and `above` at the sensor.
    """
    steepest = (above / enter if above > 0.0 else above / leave) + rise
    flattest = (below / leave if below > 0.0 else below / enter) + rise
    cap = above if above < 0.0 else (below if below > 0.0 else 0.0)  # the cap that can be met, if any
    first, channels = _channel_at(slope, steepest), len(slope)
    changed = False
    for i in range(first, channels):
        if slope[i] < flattest:
            break
        reached = enter
        if cap != 0.0:
            reached = max(enter, cap * inverse[i] if rise == 0.0 else cap / (slope[i] - rise))
        if reached < run[j, i]:
            run[j, i], hit[j, i], changed = reached, row, True
    if changed:
        longest = 0.0
        for i in range(channels):
            longest = max(longest, run[j, i])
        farthest[j] = longest


@kernel
def cast_tilted(  # type: ignore[no-untyped-def]
    origin, axes, cosine, sine, beams, sent, run, hit, statics, actors, heights, max_range
):
    """As `cast_level` for any attitude and any azimuths, given by `cosine` and `sine`: each beam is a ray."""
    columns, channels = sent.shape
    directions, reach = np.empty((columns * channels, 3)), np.empty(columns * channels)
    for b in range(len(directions)):
        j, i = b // channels, b % channels
        flat = 1.0 / beams.secant[i]
        f, r, u = flat * cosine[j], flat * sine[j], flat * beams.slope[i]
        for axis in range(3):
            directions[b, axis] = axes[axis, 0] * f + axes[axis, 1] * r + axes[axis, 2] * u
        reach[b] = max_range if sent[j, i] else -1.0
    total = columns * channels
    cast_rays(origin, directions, reach, run.reshape(total), hit.reshape(total), statics, actors, heights, max_range)


@kernel
def cast_rays(  # type: ignore[no-untyped-def]
    origin, directions, reach, run, hit, statics, actors, heights, max_range
):
    """Fills `run` with distances [m] and `hit` with what was met, for rays binned by their bearing.

    Args:
        origin: (3,) where all rays start.
        directions: (N, 3) of length 1.
        reach: (N,) how far each looks [m], at most `max_range`; negative for those not sent.
        run, hit: (N,) to fill.
        statics, actors, heights: What there is to meet.
        max_range: [m]
    """
    bins, total = 1024, len(directions)
    heading, slope, flat, limit = np.empty((total, 2)), np.empty(total), np.empty(total), np.empty(total)
    bucket, first = np.empty(total, np.int32), np.zeros(bins + 1, np.int32)
    level = level_within(heights, origin[0], origin[1], max_range)
    for b in range(total):
        run[b], hit[b] = -1.0, NO_HIT
        if reach[b] < 0.0:
            continue
        x, y = directions[b, 0], directions[b, 1]
        bucket[b] = int(np.floor((np.arctan2(y, x) / (2.0 * np.pi)) * bins)) % bins
        first[bucket[b] + 1] += 1
    for q in range(bins):
        first[q + 1] += first[q]
    sent = first[bins]
    order, filled = np.empty(sent, np.int32), first.copy()
    for b in range(total):
        if reach[b] >= 0.0:
            order[filled[bucket[b]]] = b
            filled[bucket[b]] += 1
    # From here on by bearing, so that the beams of a bin lie beside each other in memory.
    heading, slope, flat, limit = heading[:sent], slope[:sent], flat[:sent], limit[:sent]
    near, met = np.empty(sent), np.empty(sent, np.int32)
    for o in range(sent):
        b = order[o]
        x, y, z = directions[b, 0], directions[b, 1], directions[b, 2]
        flat[o] = max(np.sqrt(x * x + y * y), 1e-9)
        heading[o, 0], heading[o, 1], slope[o] = x / flat[o], y / flat[o], z / flat[o]
        limit[o] = reach[b] * flat[o]
        near[o] = _plane_run(origin[2] - level, 1.0 / slope[o])
    if np.isnan(level):
        meet_ground(heights, origin, heading, slope, limit, 0.0, near)
    for o in range(sent):
        met[o] = GROUND_HIT if near[o] <= limit[o] else NO_HIT
        near[o] = min(near[o], limit[o])
    _cut_beams(statics, 0, origin, max_range, first, heading, slope, near, met)
    _cut_beams(actors, len(statics.corners), origin, max_range, first, heading, slope, near, met)
    for o in range(sent):
        run[order[o]], hit[order[o]] = near[o] / flat[o], met[o]


@lean_kernel
def _slopes(below, above, distance, radius, lean):  # type: ignore[no-untyped-def]
    """Least and greatest slope of a beam that can meet what stands within `radius` of a place `distance` away."""
    nearest, farthest = distance - radius, distance + radius
    if nearest <= 0.0:
        return -np.inf, np.inf
    return (
        (below / farthest if below > 0.0 else below / nearest) - lean,
        (above / nearest if above > 0.0 else above / farthest) + lean,
    )


@kernel
def _cut_beams(solids, offset, origin, max_range, first, heading, slope, run, hit):  # type: ignore[no-untyped-def]
    bins = len(first) - 1
    per_bin = 2.0 * np.pi / bins
    edges = np.empty((8, 3))
    xy, corners, centre, z0, z1, tilt = solids.xy, solids.corners, solids.centre, solids.z0, solids.z1, solids.tilt
    radius = solids.radius
    ox, oy, oz = origin[0], origin[1], origin[2]
    for k in _near_first(centre, radius, ox, oy, max_range):
        n, cx, cy, tilt_x, tilt_y = corners[k], centre[k, 0] - ox, centre[k, 1] - oy, tilt[k, 0], tilt[k, 1]
        lift = tilt_x * cx + tilt_y * cy
        below, above = z0[k] - lift - oz, z1[k] - lift - oz
        inside = _edges(xy, k, n, ox, oy, edges)
        if inside and below <= 0.0 <= above:
            continue
        bearing, low, high = _span(xy, k, n, cx, cy, ox, oy, inside)
        lean = np.sqrt(tilt_x * tilt_x + tilt_y * tilt_y)
        least, greatest = _slopes(below, above, np.sqrt(cx * cx + cy * cy), radius[k], lean)
        begin = int(np.floor((bearing + low) / per_bin))
        width = min(int(np.floor((bearing + high) / per_bin)) - begin + 1, bins)
        for q in range(begin, begin + width):
            for o in range(first[q % bins], first[q % bins + 1]):
                if slope[o] < least or slope[o] > greatest:
                    continue
                enter, leave = _cut(edges, n, heading[o, 0], heading[o, 1])
                rise = tilt_x * heading[o, 0] + tilt_y * heading[o, 1]
                reached = _enter_slab(below, above, max(enter, 0.0), leave, slope[o] - rise)
                if reached < run[o]:
                    run[o], hit[o] = reached, k + offset


@lean_kernel
def _enter_slab(below, above, enter, leave, slope):  # type: ignore[no-untyped-def]
    """Run at which a ray of `slope` is first inside a solid; infinite if never."""
    if slope != 0.0:
        a, b = below / slope, above / slope
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    elif below > 0.0 or above < 0.0:
        return np.inf
    return enter if enter < leave else np.inf
