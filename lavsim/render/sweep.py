"""A rotating LiDAR by casting each solid into the beams that can meet it.

A level sensor's beams of one azimuth lie in one vertical plane, so a solid is cut once per azimuth and serves all
channels: it covers a contiguous run of them. Solids come front to back and are skipped where nothing behind can be
seen any more. A tilted sensor has no such planes; there each beam is cut on its own.

The beam, drop-off and intensity model is CARLA's (reference `carla.md` 6.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.kernel_draws import draw_base, unit_at
from lavsim.random import Draws
from lavsim.render.frame import Pose
from lavsim.render.solids import Solids
from lavsim.types import DT

NO_HIT = -2
GROUND_HIT = -1


@dataclass(frozen=True)
class LidarModel:
    """What the leaderboard fixes of a LiDAR.

    Attributes:
        channels: Beams above each other.
        max_range: [m].
        points_per_second: Over all channels, before drop-off.
        rotation_frequency: [Hz].
        upper, lower: Elevations of the outermost beams [deg].
        attenuation: Of intensity with distance [1/m].
        general_drop: Share of beams never sent.
        kept_intensity: Returns above this intensity are all kept.
        zero_drop: Chance that a return of intensity 0 is lost; falls linearly to `kept_intensity`'s.
    """

    channels: int = 64
    max_range: float = 85.0
    points_per_second: int = 600_000
    rotation_frequency: float = 10.0
    upper: float = 10.0
    lower: float = -30.0
    attenuation: float = 0.004
    general_drop: float = 0.45
    kept_intensity: float = 0.8
    zero_drop: float = 0.4

    @property
    def columns(self) -> int:
        """Azimuths of one tick."""
        return round(self.points_per_second * DT / self.channels)

    @property
    def step(self) -> float:
        """Between neighbouring azimuths [rad]."""
        return self.rotation_frequency * 2.0 * np.pi * DT / self.columns

    def start(self, tick: int) -> float:
        """Azimuth of the first beam at `tick`, in the sensor frame [rad]: at 20 Hz, -pi and 0 in turn."""
        return ((tick * (self.rotation_frequency * DT)) % 1.0) * 2.0 * np.pi - np.pi


class Sweep(NamedTuple):
    """Returns of one tick, channel by channel from the top.

    Attributes:
        points: (N, 4) float32 x, y, z [m] in the sensor frame (y right), intensity 0 to 1.
        solids: (N,) int32: row of the solid hit (actors after statics), `GROUND_HIT` for the ground.
    """

    points: NDArray[np.float32]
    solids: NDArray[np.int32]


class _Beams(NamedTuple):
    """Per channel, topmost first: slope (rise over horizontal run), its inverse, secant, horizontal range [m]."""

    slope: NDArray[np.float64]
    inverse: NDArray[np.float64]
    secant: NDArray[np.float64]
    reach: NDArray[np.float64]


class Scratch(NamedTuple):
    """Room for one sweep; worth keeping, since fresh memory costs as much as casting."""

    sent: NDArray[np.bool_]
    run: NDArray[np.float64]
    hit: NDArray[np.int32]
    points: NDArray[np.float32]
    solids: NDArray[np.int32]


def new_scratch(model: LidarModel) -> Scratch:
    """Room for the sweeps of `model`."""
    shape, total = (model.columns, model.channels), model.columns * model.channels
    return Scratch(
        np.empty(shape, np.bool_),
        np.empty(shape),
        np.empty(shape, np.int32),
        np.empty((total, 4), np.float32),
        np.empty(total, np.int32),
    )


@lru_cache(maxsize=8)
def _beams(model: LidarModel) -> _Beams:
    elevation = np.radians(np.linspace(model.upper, model.lower, model.channels))
    slope = np.tan(elevation)
    with np.errstate(divide="ignore"):
        inverse = 1.0 / slope
    return _Beams(slope, inverse, 1.0 / np.cos(elevation), model.max_range * np.cos(elevation))


def cast_sweep(
    model: LidarModel,
    pose: Pose,
    tick: int,
    draws: Draws,
    statics: Solids,
    actors: Solids,
    scratch: Scratch | None = None,
) -> Sweep:
    """The returns of one tick."""
    beams, room = _beams(model), new_scratch(model) if scratch is None else scratch
    start = model.start(tick)
    azimuth = start + np.arange(model.columns) * model.step
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    key = np.uint64(draws.key)
    _send_beams(key, tick, model.general_drop, room.sent)
    if pose.is_level:
        _cast_level(pose.origin, start + pose.yaw, model.step, beams, room, statics, actors, model.max_range)
    else:
        _cast_tilted(pose.origin, pose.axes, cosine, sine, beams, room, statics, actors)
    found = _returns(key, tick, room, beams, cosine, sine, model.attenuation, model.kept_intensity, model.zero_drop)
    return Sweep(room.points[:found].copy(), room.solids[:found].copy())


@kernel
def _send_beams(key, tick, drop, sent):  # type: ignore[no-untyped-def]
    """Which beams (columns, channels) survive the general drop-off; draw 2b belongs to beam b."""
    base = draw_base(key, tick)
    columns, channels = sent.shape
    for column in range(columns):
        for channel in range(channels):
            sent[column, channel] = unit_at(base, 2 * (channel * columns + column)) >= drop


@kernel
def _ground_run(height, inverse):  # type: ignore[no-untyped-def]
    """Horizontal run [m] to the ground plane z = 0 of a beam from `height`; a height map would march here."""
    run = -height * inverse
    return run if run > 0.0 else np.inf


@kernel
def _cast_level(origin, start, step, beams, room, statics, actors, max_range):  # type: ignore[no-untyped-def]
    """Leaves distances [m] and what was hit in `room`; beams not sent have a negative distance."""
    sent, run, hit = room.sent, room.run, room.hit
    columns, channels = sent.shape
    first_run, first_hit = np.empty(channels), np.empty(channels, np.int32)
    for i in range(channels):
        ground = _ground_run(origin[2], beams.inverse[i])
        first_run[i] = min(ground, beams.reach[i])
        first_hit[i] = GROUND_HIT if ground <= beams.reach[i] else NO_HIT
    farthest = np.zeros(columns)
    for j in range(columns):
        for i in range(channels):
            run[j, i] = first_run[i] if sent[j, i] else -1.0
            hit[j, i] = first_hit[i]
            farthest[j] = max(farthest[j], run[j, i])
    direction = np.empty((columns, 2))
    for j in range(columns):
        direction[j, 0], direction[j, 1] = np.cos(start + j * step), np.sin(start + j * step)
    _cast_solids(statics, 0, origin, start, step, direction, beams, max_range, run, hit, farthest)
    _cast_solids(actors, len(statics.corners), origin, start, step, direction, beams, max_range, run, hit, farthest)
    for j in range(columns):
        for i in range(channels):
            run[j, i] *= beams.secant[i]


@kernel
def _near_first(solids, origin, max_range):  # type: ignore[no-untyped-def]
    """Rows of the solids within range, nearest first."""
    rows = np.empty(len(solids.corners), np.int32)
    near = np.empty(len(solids.corners))
    found = 0
    for k in range(len(solids.corners)):
        dx, dy = solids.centre[k, 0] - origin[0], solids.centre[k, 1] - origin[1]
        reach = max_range + solids.radius[k]
        square = dx * dx + dy * dy
        if square < reach * reach:
            rows[found], near[found] = k, np.sqrt(square) - solids.radius[k]
            found += 1
    return rows[:found][np.argsort(near[:found], kind="mergesort")]


@kernel
def _edges(solids, k, ox, oy, edges):  # type: ignore[no-untyped-def]
    """Fills `edges` (n, 3) with outward normals and their offsets from the origin; True if the origin is inside."""
    n = solids.corners[k]
    inside = True
    for e in range(n):
        f = e + 1 if e + 1 < n else 0
        x, y = solids.xy[k, e, 0] - ox, solids.xy[k, e, 1] - oy
        nx, ny = solids.xy[k, f, 1] - oy - y, x - (solids.xy[k, f, 0] - ox)
        edges[e, 0], edges[e, 1], edges[e, 2] = nx, ny, nx * x + ny * y
        inside = inside and edges[e, 2] >= 0.0
    return inside


@kernel
def _span(solids, k, ox, oy, inside):  # type: ignore[no-untyped-def]
    """Bearing of a solid's centre and the extremes of its footprint relative to it [rad]."""
    cx, cy = solids.centre[k, 0] - ox, solids.centre[k, 1] - oy
    if inside:
        return 0.0, -np.pi, np.pi
    low, high = 0.0, 0.0
    for e in range(solids.corners[k]):
        x, y = solids.xy[k, e, 0] - ox, solids.xy[k, e, 1] - oy
        angle = np.arctan2(cx * y - cy * x, cx * x + cy * y)
        low, high = min(low, angle), max(high, angle)
    return np.arctan2(cy, cx), low, high


@kernel
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
    for k in _near_first(solids, origin, max_range):
        below, above = solids.z0[k] - origin[2], solids.z1[k] - origin[2]
        inside = _edges(solids, k, origin[0], origin[1], edges)
        if inside and below <= 0.0 <= above:
            continue  # the sensor is in it
        bearing, low, high = _span(solids, k, origin[0], origin[1], inside)
        bearing = (bearing - start) % turn
        for shift in range(-1, 2):
            first = max(0, int(np.ceil((bearing + low + shift * turn) / step)))
            last = min(columns - 1, int(np.floor((bearing + high + shift * turn) / step)))
            for j in range(first, last + 1):
                enter, leave = _cut(edges, solids.corners[k], direction[j, 0], direction[j, 1])
                enter = max(enter, 0.0)
                if enter < leave and enter < farthest[j]:
                    _fill_column(beams, below, above, enter, leave, k + offset, run[j], hit[j], farthest, j)


@kernel
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


@kernel
def _fill_column(beams, below, above, enter, leave, row, run, hit, farthest, j):  # type: ignore[no-untyped-def]
    """Shortens the beams of one azimuth that meet a solid between runs `enter` and `leave`."""
    steepest = above / enter if above > 0.0 else above / leave
    flattest = below / leave if below > 0.0 else below / enter
    rise = above if above < 0.0 else (below if below > 0.0 else 0.0)  # the cap that can be met, if any
    changed = False
    for i in range(_channel_at(beams.slope, steepest), len(run)):
        if beams.slope[i] < flattest:
            break
        reached = max(enter, rise * beams.inverse[i]) if rise != 0.0 else enter
        if reached < run[i]:
            run[i], hit[i], changed = reached, row, True
    if changed:
        longest = 0.0
        for i in range(len(run)):
            longest = max(longest, run[i])
        farthest[j] = longest


@kernel
def _cast_tilted(origin, axes, cosine, sine, beams, room, statics, actors):  # type: ignore[no-untyped-def]
    """As `_cast_level` for any attitude: beams are binned by world bearing, and each is cut on its own."""
    sent = room.sent
    columns, channels = sent.shape
    bins = 1024
    total = columns * channels
    heading, slope, flat = np.empty((total, 2)), np.empty(total), np.empty(total)
    bucket, first = np.empty(total, np.int32), np.zeros(bins + 1, np.int32)
    run, hit = room.run.reshape(total), room.hit.reshape(total)
    for b in range(total):
        j, i = b // channels, b % channels
        cos_e = 1.0 / beams.secant[i]
        f, r, u = cos_e * cosine[j], cos_e * sine[j], cos_e * beams.slope[i]
        x = axes[0, 0] * f + axes[0, 1] * r + axes[0, 2] * u
        y = axes[1, 0] * f + axes[1, 1] * r + axes[1, 2] * u
        z = axes[2, 0] * f + axes[2, 1] * r + axes[2, 2] * u
        flat[b] = max(np.sqrt(x * x + y * y), 1e-9)
        heading[b, 0], heading[b, 1], slope[b] = x / flat[b], y / flat[b], z / flat[b]
        bucket[b] = int(np.floor((np.arctan2(y, x) / (2.0 * np.pi)) * bins)) % bins
        first[bucket[b] + 1] += 1
        reach = beams.reach[i] * beams.secant[i] * flat[b]
        ground = _ground_run(origin[2], 1.0 / slope[b])
        run[b] = min(ground, reach) if sent[j, i] else -1.0
        hit[b] = GROUND_HIT if ground <= reach else NO_HIT
    for q in range(bins):
        first[q + 1] += first[q]
    order, filled = np.empty(total, np.int32), first.copy()
    for b in range(total):
        order[filled[bucket[b]]] = b
        filled[bucket[b]] += 1
    max_range = beams.reach[0] * beams.secant[0]
    _cut_beams(statics, 0, origin, max_range, first, order, heading, slope, run, hit)
    _cut_beams(actors, len(statics.corners), origin, max_range, first, order, heading, slope, run, hit)
    for b in range(total):
        run[b] /= flat[b]


@kernel
def _cut_beams(solids, offset, origin, max_range, first, order, heading, slope, run, hit):  # type: ignore[no-untyped-def]
    bins = len(first) - 1
    per_bin = 2.0 * np.pi / bins
    edges = np.empty((8, 3))
    for k in _near_first(solids, origin, max_range):
        below, above = solids.z0[k] - origin[2], solids.z1[k] - origin[2]
        inside = _edges(solids, k, origin[0], origin[1], edges)
        if inside and below <= 0.0 <= above:
            continue
        bearing, low, high = _span(solids, k, origin[0], origin[1], inside)
        begin = int(np.floor((bearing + low) / per_bin))
        width = min(int(np.floor((bearing + high) / per_bin)) - begin + 1, bins)
        for q in range(begin, begin + width):
            for o in range(first[q % bins], first[q % bins + 1]):
                b = order[o]
                if run[b] < 0.0:
                    continue
                enter, leave = _cut(edges, solids.corners[k], heading[b, 0], heading[b, 1])
                enter = max(enter, 0.0)
                reached = _enter_slab(below, above, enter, leave, slope[b])
                if reached < run[b]:
                    run[b], hit[b] = reached, k + offset


@kernel
def _enter_slab(below, above, enter, leave, slope):  # type: ignore[no-untyped-def]
    """Run at which a ray of `slope` is first inside a solid; infinite if never."""
    if slope != 0.0:
        a, b = below / slope, above / slope
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    elif below > 0.0 or above < 0.0:
        return np.inf
    return enter if enter < leave else np.inf


@kernel
def _returns(  # type: ignore[no-untyped-def]
    key, tick, room, beams, cosine, sine, attenuation, kept_intensity, zero_drop
):
    """Fills in the points that survive the intensity drop-off, channel by channel, and counts them.

    Draw 2b + 1 belongs to beam b.
    """
    base = draw_base(key, tick)
    distance, hit, points, solids = room.run, room.hit, room.points, room.solids
    columns, channels = distance.shape
    slope = zero_drop / kept_intensity
    found = 0
    for i in range(channels):
        flat, up = 1.0 / beams.secant[i], beams.slope[i] / beams.secant[i]
        for j in range(columns):
            d = distance[j, i]
            if d < 0.0 or hit[j, i] == NO_HIT:
                continue
            intensity = np.exp(-attenuation * d)
            if intensity <= kept_intensity:
                keep = (1.0 - zero_drop) + slope * intensity
                if unit_at(base, 2 * (i * columns + j) + 1) >= keep:
                    continue
            points[found, 0], points[found, 1] = d * flat * cosine[j], d * flat * sine[j]
            points[found, 2], points[found, 3] = d * up, intensity
            solids[found] = hit[j, i]
            found += 1
    return found
