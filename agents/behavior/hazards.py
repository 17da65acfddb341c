"""Where others will be in the ego's way: forecast boxes against the boxes the ego sweeps along its path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.behavior.forecast import TIMES, Forecast
from agents.behavior.path import STEP, ReferencePath
from agents.behavior.speed import Manner, following, merging, stopping, time_to_cover
from lavsim.kernel import kernel

Floats = NDArray[np.float64]

RANGE = 75.0  # [m] of path that is looked at
VEHICLE_MARGIN = 0.3  # [m] on either side of the ego
PROP_MARGIN = 0.1
WALKER_MARGIN = 0.6
BEFORE, AFTER = 1.0, 0.5  # [s] between the ego and who crosses: when the ego goes first, when it goes second
WALKER_BEFORE, WALKER_AFTER = 1.5, 0.6
WALL_GAP = 1.8  # [m] to the way of somebody who crosses: nearer, others brake for the nose and nobody goes
WALKER_GAP = 2.0
NOMINAL = 1.6  # [m/s²] at which the ego would go
CREEP = 6.0  # [m/s] past walkers who stand at the kerb and face the road
KERB_REACH = 6.0  # [m] from the path


@dataclass(frozen=True)
class Ego:
    """The ego on its path: place s [m], speed [m/s], the profile's speed ahead, and its half box [m]."""

    s: float
    x: float
    y: float
    yaw: float
    speed: float
    wanted: float
    half_length: float
    half_width: float


@dataclass(frozen=True)
class Meeting:
    """What one forecast means for the ego.

    Attributes:
        acceleration: Largest acceleration it leaves [m/s²].
        stop: Place at which the ego would come to rest because of it [m along the path]; inf when it keeps moving.
        row: Row of the actor in the readings.
    """

    acceleration: float
    stop: float
    row: int


def meetings(path: ReferencePath, ego: Ego, forecast: Forecast, manner: Manner, patience: float) -> list[Meeting]:
    """All forecasts that touch the ego's way within the horizon.

    Args:
        path: The ego's path.
        ego: Where it is.
        forecast: Where others will be.
        manner: How it drives.
        patience: 1 at first; falls to 0 while the ego stands for others, and narrows the gaps it waits for.
    """
    start = max(int(ego.s / STEP), 0)
    stop = min(start + int(RANGE / STEP), len(path))
    if stop - start < 2 or not len(forecast.row):
        return []
    xy, heading = path.xy[start:stop].copy(), path.heading[start:stop].copy()
    xy[0], heading[0] = (ego.x, ego.y), heading[0] + math.remainder(ego.yaw - heading[0], 2.0 * math.pi)
    margin = np.where(forecast.is_walker, WALKER_MARGIN, np.where(forecast.is_prop, PROP_MARGIN, VEHICLE_MARGIN))
    margin = np.where((forecast.speed < 0.2) & ~forecast.is_walker, PROP_MARGIN, margin)
    first, last = sweep(xy, heading, ego.half_length, ego.half_width, forecast.poses, forecast.half, margin)
    base = start * STEP
    found: list[Meeting] = []
    for h in np.flatnonzero((first >= 0.0).any(axis=1)):
        when = np.flatnonzero(first[h] >= 0.0)
        if _comes_from_behind(ego, forecast, int(h)):
            continue
        meeting = _judge(
            path,
            ego,
            forecast,
            int(h),
            when,
            base + STEP * first[h, when],
            base + STEP * last[h, when],
            manner,
            patience,
        )
        if meeting is not None:
            found.append(meeting)
    return found


def _judge(
    path: ReferencePath,
    ego: Ego,
    forecast: Forecast,
    h: int,
    when: NDArray[np.int64],
    first: Floats,
    last: Floats,
    manner: Manner,
    patience: float,
) -> Meeting | None:
    speed, row = float(forecast.speed[h]), int(forecast.row[h])
    is_walker = bool(forecast.is_walker[h])
    course = path.at(path.yaw, float(first[0]))
    facing = math.cos(float(forecast.poses[h, when[0], 2]) - course)
    gap_now = float(first[0]) - ego.s
    if when[0] and gap_now < 0.6 and _ahead_of(ego, forecast.poses[h, when[0]]) < 0.3 * ego.half_length:
        return None  # would run into the ego's side or back where it stands now: going on is all it can do
    if not is_walker and (speed < 0.3 or facing > 0.7):
        leader = speed * max(facing, 0.0) if speed >= 0.3 else 0.0
        if when[0]:  # comes into the way ahead: only if the ego isn't well past by then
            reach = time_to_cover(gap_now + 2.0 * ego.half_length, ego.speed, NOMINAL, ego.wanted)
            if reach + BEFORE < TIMES[when[0]]:
                return None
            acceleration = merging(ego.speed, first - ego.s, TIMES[when], leader)
        else:
            acceleration = following(ego.speed, gap_now, leader, ego.wanted, manner)
        # Where the ego ends up if the other goes on as forecast to the end.
        rests = float(first[-1]) - manner.standstill if leader < 2.5 else math.inf
        return Meeting(acceleration, rests, row)
    before, after = (WALKER_BEFORE, WALKER_AFTER) if is_walker else (BEFORE, AFTER)
    low, high = float(first.min()), float(last.max())
    arrives, leaves = float(TIMES[when[0]]), float(TIMES[when[-1]]) + 0.3
    if is_walker and when[-1] == len(TIMES) - 1:
        leaves = math.inf
    top = max(ego.wanted, 2.0)
    reach = time_to_cover(low - ego.s, ego.speed, NOMINAL, top)
    clear = time_to_cover(high - ego.s + 0.3, ego.speed, NOMINAL, top)
    if clear + before * (0.4 + 0.6 * patience) < arrives or reach > leaves + after:
        return None
    gap = low - ego.s - (WALKER_GAP if is_walker else WALL_GAP * (0.3 + 0.7 * patience))
    inside = low - ego.s < 0.05
    if inside and arrives > 0.3 and clear < arrives + 0.2:
        return None  # in the middle of it and out before the other is there
    if gap <= 0.2 and low - ego.s > 0.2:
        gap = 0.2 if ego.speed < 1.0 else low - ego.s - 0.15
    return Meeting(stopping(ego.speed, gap, manner), max(low - WALL_GAP, ego.s), row)


def _ahead_of(ego: Ego, pose: Floats) -> float:
    """How far ahead of the ego's centre a place is, along its heading [m]."""
    return float((pose[0] - ego.x) * math.cos(ego.yaw) + (pose[1] - ego.y) * math.sin(ego.yaw))


def _comes_from_behind(ego: Ego, forecast: Forecast, h: int) -> bool:
    """Whether the other follows the ego: its business to keep off."""
    x, y, yaw = forecast.poses[h, 0]
    ahead = _ahead_of(ego, forecast.poses[h, 0])
    aside = abs((y - ego.y) * math.cos(ego.yaw) - (x - ego.x) * math.sin(ego.yaw))
    similar = math.cos(yaw - ego.yaw) > 0.5
    reach = ego.half_length + float(forecast.half[h, 0])
    return bool(ahead < -0.6 * reach and similar and aside < 3.0) or bool(ahead < -reach and forecast.speed[h] < 0.3)


def kerb_speed(path: ReferencePath, ego: Ego, forecast: Forecast) -> float:
    """Speed [m/s] that respects walkers who stand beside the path and look across it; inf without any."""
    lowest = math.inf
    for h in np.flatnonzero(forecast.is_walker & (forecast.speed < 0.3)):
        x, y, yaw = forecast.poses[h, 0]
        start = max(int(ego.s / STEP), 0)
        window = path.xy[start : start + int(45.0 / STEP)]
        if not len(window):
            continue
        distance = np.hypot(window[:, 0] - x, window[:, 1] - y)
        nearest = int(np.argmin(distance))
        if distance[nearest] > KERB_REACH or nearest == 0:
            continue
        towards = math.atan2(window[nearest, 1] - y, window[nearest, 0] - x)
        if math.cos(towards - yaw) > 0.5:
            room = max(nearest * STEP - 12.0, 0.0)
            lowest = min(lowest, math.sqrt(CREEP * CREEP + 2.0 * 1.8 * room))
    return lowest


@kernel
def sweep(
    xy: Floats, heading: Floats, half_length: float, half_width: float, poses: Floats, half: Floats, margin: Floats
) -> tuple[Floats, Floats]:
    """Samples of the ego's path at which its box meets each forecast box.

    Args:
        xy: (S, 2) the ego's places ahead, `STEP` apart.
        heading: (S,) its headings there.
        half_length: Of the ego [m].
        half_width: Of the ego [m].
        poses: (H, K, 3) forecasts.
        half: (H, 2) half boxes.
        margin: (H,) by which the ego is made wider [m].

    Returns:
        (H, K) first sample that meets, refined to a sixteenth, and last sample; -1 where none does.
    """
    count, steps, samples = len(poses), poses.shape[1], len(xy)
    first, last = np.full((count, steps), -1.0), np.full((count, steps), -1.0)
    ego_radius = math.sqrt(half_length**2 + half_width**2)
    for h in range(count):
        width = half_width + margin[h]
        radius = ego_radius + margin[h] + math.sqrt(half[h, 0] ** 2 + half[h, 1] ** 2)
        for k in range(steps):
            if k > 0 and poses[h, k, 0] == poses[h, k - 1, 0] and poses[h, k, 1] == poses[h, k - 1, 1]:
                first[h, k], last[h, k] = first[h, k - 1], last[h, k - 1]
                continue
            x, y, yaw = poses[h, k]
            i = 0
            while i < samples:
                distance = math.sqrt((x - xy[i, 0]) ** 2 + (y - xy[i, 1]) ** 2)
                if distance > radius:
                    i += max(1, int((distance - radius) / 0.55))  # samples are at most 0.55 m apart
                    continue
                if _overlap(xy[i, 0], xy[i, 1], heading[i], half_length, width, x, y, yaw, half[h, 0], half[h, 1]):
                    if first[h, k] < 0.0:
                        first[h, k] = i
                        if i > 0:
                            low, high = 0.0, 1.0
                            for _ in range(4):
                                t = 0.5 * (low + high)
                                mx = xy[i - 1, 0] + (xy[i, 0] - xy[i - 1, 0]) * t
                                my = xy[i - 1, 1] + (xy[i, 1] - xy[i - 1, 1]) * t
                                turn = heading[i - 1] + (heading[i] - heading[i - 1]) * t
                                if _overlap(mx, my, turn, half_length, width, x, y, yaw, half[h, 0], half[h, 1]):
                                    high = t
                                else:
                                    low = t
                            first[h, k] = i - 1 + high
                    last[h, k] = i
                elif first[h, k] >= 0.0:
                    break
                i += 1
    return first, last


@kernel
def _overlap(
    ax: float, ay: float, a_yaw: float, a_length: float, a_width: float,
    bx: float, by: float, b_yaw: float, b_length: float, b_width: float,
) -> bool:  # fmt: skip
    """Whether two boxes, given by centre, heading and half sizes, meet (separating axes)."""
    ac, as_, bc, bs = math.cos(a_yaw), math.sin(a_yaw), math.cos(b_yaw), math.sin(b_yaw)
    dx, dy = bx - ax, by - ay
    cos, sin = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    if abs(dx * ac + dy * as_) > a_length + b_length * cos + b_width * sin:
        return False
    if abs(dy * ac - dx * as_) > a_width + b_length * sin + b_width * cos:
        return False
    if abs(dx * bc + dy * bs) > b_length + a_length * cos + a_width * sin:
        return False
    return abs(dy * bc - dx * bs) <= b_width + a_length * sin + a_width * cos
