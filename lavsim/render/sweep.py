"""A rotating LiDAR: which beams are sent at a tick, and which of their returns come back.

The beam, drop-off and intensity model is CARLA's (reference `carla.md` 6.2). What rain does to returns is ours; CARLA's
ray cast knows no weather.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel, lean_kernel
from lavsim.kernel_draws import draw_base, unit_at
from lavsim.random import Draws
from lavsim.render.beams import GROUND_HIT, NO_HIT, Beams, cast_level, cast_tilted
from lavsim.render.frame import Pose
from lavsim.render.heights import LEVEL_GROUND, Heights
from lavsim.render.solids import Solids
from lavsim.types import DT

__all__ = ["GROUND_HIT", "NO_HIT", "LidarModel", "Scratch", "Sweep", "cast_columns", "cast_sweep", "new_scratch"]

RAIN_HIT = -3  # a return from a rain drop

# Of a cloudburst (precipitation 100). House values: automotive LiDARs lose about a tenth of their returns at 30 m in
# heavy rain, and drops are seen within some ten metres.
_RAIN_EXTINCTION = 0.004  # [1/m] of returns lost on the way
_RAIN_SCATTER = 0.0025  # [1/m] chance to meet a drop that is seen
_RAIN_REACH = 12.0  # [m] drops farther away are too faint
_RAIN_INTENSITY = 0.1

# Of exp: one over the logarithm of 2, and the logarithm in two parts.
_HALVINGS, _LOG_2_HIGH, _LOG_2_LOW = 1.4426950408889634, 0.6931471803691238, 1.9082149292705877e-10


@dataclass(frozen=True)
class LidarModel:
    """A LiDAR; by default the leaderboard's.

    Attributes:
        channels: Beams above each other.
        max_range: [m].
        points_per_second: Over all channels, before drop-off.
        rotation_frequency: [Hz].
        upper, lower: Elevations of the outermost beams [deg].
        horizontal_fov: Sector that is swept, ahead [deg].
        attenuation: Of intensity with distance [1/m].
        general_drop: Share of beams never sent.
        kept_intensity: Returns above this intensity are all kept.
        zero_drop: Chance that a return of intensity 0 is lost; falls linearly to `kept_intensity`'s.
        noise_std: Of the distance, along the ray [m].
        full_sweep: A tick gives a whole turn instead of the part that the sensor turns meanwhile.
        feels_rain: Rain loses and adds returns.
    """

    channels: int = 64
    max_range: float = 85.0
    points_per_second: int = 600_000
    rotation_frequency: float = 10.0
    upper: float = 10.0
    lower: float = -30.0
    horizontal_fov: float = 360.0
    attenuation: float = 0.004
    general_drop: float = 0.45
    kept_intensity: float = 0.8
    zero_drop: float = 0.4
    noise_std: float = 0.0
    full_sweep: bool = False
    feels_rain: bool = False

    @property
    def columns(self) -> int:
        """Azimuths of one tick."""
        seconds = 1.0 / self.rotation_frequency if self.full_sweep else DT
        return round(self.points_per_second * seconds / self.channels)

    @property
    def step(self) -> float:
        """Between neighbouring azimuths [rad]."""
        turns = 1.0 if self.full_sweep else self.rotation_frequency * DT
        return turns * float(np.radians(self.horizontal_fov)) / self.columns

    def start(self, tick: int) -> float:
        """Azimuth of the first beam at `tick`, in the sensor frame [rad]: at 20 Hz, -pi and 0 in turn."""
        turn = 0.0 if self.full_sweep else (tick * (self.rotation_frequency * DT)) % 1.0
        return float((turn - 0.5) * np.radians(self.horizontal_fov))

    def azimuths(self, tick: int) -> NDArray[np.float64]:
        """(columns,) in the sensor frame [rad]; a sector is swept again and again from its left edge."""
        fov = float(np.radians(self.horizontal_fov))
        azimuth = np.arange(self.columns, dtype=np.float64) * self.step + self.start(tick)
        return azimuth if self.is_round else np.mod(azimuth + fov / 2.0, fov) - fov / 2.0

    @property
    def is_round(self) -> bool:
        """Whether the azimuths of a tick follow each other without a jump, for one turn at most."""
        return self.horizontal_fov == 360.0 and self.columns * self.step <= 2.0 * np.pi + 1e-9


class Sweep(NamedTuple):
    """Returns of one tick, channel by channel from the top.

    Attributes:
        points: (N, 4) float32 x, y, z [m] in the sensor frame (y right), intensity 0 to 1.
        solids: (N,) int32: row of the solid hit (actors after statics), `GROUND_HIT` for the ground, `RAIN_HIT`.
    """

    points: NDArray[np.float32]
    solids: NDArray[np.int32]


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
def _beams(model: LidarModel) -> Beams:
    elevation = np.radians(np.linspace(model.upper, model.lower, model.channels))
    slope = np.tan(elevation)
    with np.errstate(divide="ignore"):
        inverse = 1.0 / slope
    return Beams(slope, inverse, 1.0 / np.cos(elevation), model.max_range * np.cos(elevation))


def send_beams(model: LidarModel, tick: int, draws: Draws, room: Scratch) -> None:
    """Draws which beams of a tick are sent."""
    _send_beams(np.uint64(draws.key), tick, model.general_drop, room.sent)


def cast_columns(
    model: LidarModel,
    pose: Pose,
    tick: int,
    columns: slice,
    statics: Solids,
    actors: Solids,
    heights: Heights,
    room: Scratch,
) -> None:
    """Casts the beams sent at some neighbouring azimuths of a tick from `pose`."""
    beams = _beams(model)
    sent, run, hit = room.sent[columns], room.run[columns], room.hit[columns]
    if pose.is_level and model.is_round:
        start = model.start(tick) + pose.yaw + columns.start * model.step
        cast_level(pose.origin, start, model.step, beams, sent, run, hit, statics, actors, heights, model.max_range)
        return
    azimuth = model.azimuths(tick)[columns]
    cast_tilted(
        pose.origin, pose.axes, np.cos(azimuth), np.sin(azimuth), beams, sent, run, hit, statics, actors, heights,
        model.max_range,
    )  # fmt: skip


def collect(model: LidarModel, tick: int, draws: Draws, room: Scratch, rain: float = 0.0) -> Sweep:
    """The returns of the beams that were cast.

    Args:
        model: The LiDAR.
        tick: Of the sweep.
        draws: Stream of the sensor.
        room: What `send_beams` and `cast_columns` filled.
        rain: 0 to 1; for a model that feels it.
    """
    azimuth = model.azimuths(tick)
    counts = np.zeros(model.channels, np.int64)
    _returns(
        np.uint64(draws.key), tick, room.run, room.hit, room.points, room.solids, counts, _beams(model),
        np.cos(azimuth), np.sin(azimuth), model.attenuation, model.kept_intensity, model.zero_drop, model.noise_std,
        rain if model.feels_rain else 0.0, model.max_range,
    )  # fmt: skip
    total = int(counts.sum())
    sweep = Sweep(np.empty((total, 4), np.float32), np.empty(total, np.int32))
    _close_up(room.points, room.solids, counts, sweep.points, sweep.solids)
    return sweep


def cast_sweep(
    model: LidarModel,
    pose: Pose,
    tick: int,
    draws: Draws,
    statics: Solids,
    actors: Solids,
    scratch: Scratch | None = None,
    heights: Heights = LEVEL_GROUND,
    rain: float = 0.0,
) -> Sweep:
    """The returns of one tick, all beams seeing the same world."""
    room = new_scratch(model) if scratch is None else scratch
    send_beams(model, tick, draws, room)
    cast_columns(model, pose, tick, slice(0, model.columns), statics, actors, heights, room)
    return collect(model, tick, draws, room, rain)


@lean_kernel
def _send_beams(key, tick, drop, sent):  # type: ignore[no-untyped-def]
    """Which beams (columns, channels) survive the general drop-off; draw 2b belongs to beam b."""
    base = draw_base(key, tick)
    columns, channels = sent.shape
    for column in range(columns):
        for channel in range(channels):
            sent[column, channel] = unit_at(base, 2 * (channel * columns + column)) >= drop


@lean_kernel
def _fade(depth):  # type: ignore[no-untyped-def]
    """exp(-depth) for depth >= 0, to 1e-10; the library's takes 16 ns a call, as long as all else done for a return."""
    depth = min(depth, 700.0)
    halvings = int(depth * _HALVINGS + 0.5)
    x = (halvings * _LOG_2_HIGH - depth) + halvings * _LOG_2_LOW
    square = x * x  # Taylor's series, in pairs: they do not wait for each other
    value = (1.0 / 5040.0 * x + 1.0 / 720.0) + square * (1.0 / 362880.0 * x + 1.0 / 40320.0)
    value = (1.0 + x) + square * ((0.5 + 1.0 / 6.0 * x) + square * ((1.0 / 24.0 + 1.0 / 120.0 * x) + square * value))
    for _ in range(halvings):
        value *= 0.5
    return value


@lean_kernel
def _normal_at(base, index):  # type: ignore[no-untyped-def]
    """A Gaussian number from draws `index` and `index` + 1."""
    return np.sqrt(-2.0 * np.log1p(-unit_at(base, index))) * np.cos(2.0 * np.pi * unit_at(base, index + 1))


@lean_kernel
def _through_rain(base, index, distance, is_hit, rain):  # type: ignore[no-untyped-def]
    """Distance of what comes back through rain [m]: the same, nearer (a drop), or negative (lost)."""
    drop = -np.log1p(-unit_at(base, index)) / (_RAIN_SCATTER * rain)
    if drop < min(distance, _RAIN_REACH):
        return max(drop, 0.5)
    is_lost = not is_hit or unit_at(base, index + 1) >= np.exp(-_RAIN_EXTINCTION * rain * distance)
    return -1.0 if is_lost else distance


@kernel
def _returns(  # type: ignore[no-untyped-def]
    key, tick, distance, hit, points, solids, counts, beams, cosine, sine, attenuation, kept_intensity, zero_drop,
    noise_std, rain, max_range,
):  # fmt: skip
    """Writes the points that survive the intensity drop-off to the rows of their channel, and counts them there.

    Column by column, as they were cast: a pass channel by channel would read all over the memory. Draw 2b + 1 belongs
    to beam b; after those of all beams come four more for each: rain and noise.
    """
    base = draw_base(key, tick)
    columns, channels = distance.shape
    more = 2 * columns * channels
    share = zero_drop / kept_intensity if kept_intensity > 0.0 else 0.0
    slope, over_secant = beams.slope, 1.0 / beams.secant
    met = np.empty(channels + 1, np.int64)
    for j in range(columns):
        x, y = cosine[j], sine[j]
        came_back = 0  # listed first and without a branch, which would go either way at random
        for i in range(channels):
            met[came_back] = i
            came_back += int((distance[j, i] >= 0.0) & ((hit[j, i] != NO_HIT) | (rain > 0.0)))
        for n in range(came_back):
            i = met[n]
            d, what = distance[j, i], hit[j, i]
            beam = i * columns + j
            intensity = _fade(attenuation * d)
            if rain > 0.0:
                came = _through_rain(base, more + 4 * beam, d, what != NO_HIT, rain)
                if came < 0.0:
                    continue
                if came != d:
                    d, what, intensity = came, RAIN_HIT, _RAIN_INTENSITY
            if what != RAIN_HIT and intensity <= kept_intensity:
                keep = (1.0 - zero_drop) + share * intensity
                if unit_at(base, 2 * beam + 1) >= keep:
                    continue
            if noise_std > 0.0:
                d = min(max(d + noise_std * _normal_at(base, more + 4 * beam + 2), 0.0), max_range)
            flat = d * over_secant[i]
            row = i * columns + counts[i]
            points[row, 0], points[row, 1] = flat * x, flat * y
            points[row, 2], points[row, 3] = flat * slope[i], intensity
            solids[row] = what
            counts[i] += 1


@lean_kernel
def _close_up(points, solids, counts, closed_points, closed_solids):  # type: ignore[no-untyped-def]
    """Copies the rows in use of all channels, without the gaps between them."""
    columns, filled = len(solids) // len(counts), 0
    for i in range(len(counts)):
        for row in range(i * columns, i * columns + counts[i]):
            for axis in range(4):
                closed_points[filled, axis] = points[row, axis]
            closed_solids[filled] = solids[row]
            filled += 1
