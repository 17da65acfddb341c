"""Where others will be in the ego's way: forecast boxes against the boxes the ego sweeps along its path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.behavior.forecast import TIMES, Forecast
from agents.behavior.manner import Manner, Pace
from agents.behavior.path import STEP, ReferencePath
from agents.behavior.speed import follow, merge, stop_within, time_to_cover
from lavsim.kernel import kernel
from lavsim.types import ActorClass

Floats = NDArray[np.float64]

RANGE = 75.0  # [m] of path that is looked at
VEHICLE_MARGIN = 0.3  # [m] on either side of the ego
FACING, FACING_MARGIN = -0.7, 0.1  # who comes against the ego is passed closer
PROP_MARGIN = 0.1
WALKER_MARGIN = 0.6
BEFORE, AFTER = 1.0, 0.5  # [s] between the ego and who crosses: when the ego goes first, when it goes second
WALKER_BEFORE, WALKER_AFTER = 1.5, 0.6
WALL_GAP = 1.8  # [m] to the way of somebody who crosses: nearer, others brake for the nose and nobody goes
WALKER_GAP = 2.0
NOMINAL, BRISK = 1.6, 3.0  # [m/s²] at which the ego would go, at first and once it has waited for long
CREEP = 6.0  # [m/s] past walkers who stand at the kerb and face the road
KERB_REACH = 6.0  # [m] from the path
PRESSED_WITHIN, PRESSED_TIME = 40.0, 4.0  # [m], [s] to contact of who comes up from behind
KERB_AHEAD = 45.0  # [m]

_WALKER, _PROP = int(ActorClass.WALKER), int(ActorClass.PROP)


class Ego(NamedTuple):
    """The ego on its path: place s [m], speed [m/s], the profile's speed ahead, and its half box [m]."""

    s: float
    x: float
    y: float
    yaw: float
    speed: float
    wanted: float
    half_length: float
    half_width: float


class Meetings(NamedTuple):
    """What the forecasts mean for the ego, one row each.

    Attributes:
        acceleration: (H,) largest acceleration it leaves [m/s²]; inf where it leaves all.
        stop: (H,) place at which the ego would come to rest because of it [m along the path]; inf when it keeps moving.
        first: (H,) place at which the ego would touch it where it is now [m along the path]; inf if nowhere.
        kerb: Speed that respects walkers who stand beside the path and look across it [m/s]; inf without any.
        is_faced: Whether somebody comes towards the ego on its way.
    """

    acceleration: Floats
    stop: Floats
    first: Floats
    kerb: float
    is_faced: bool


def meetings(path: ReferencePath, ego: Ego, forecast: Forecast, manner: Manner, patience: float) -> Meetings:
    """What all forecasts mean that touch the ego's way within the horizon.

    Args:
        path: The ego's path.
        ego: Where it is.
        forecast: Where others will be.
        manner: How it drives.
        patience: 1 at first; falls to 0 while the ego stands for others, and narrows the gaps it waits for.
    """
    begin, xy, heading = window_of(path, ego)
    count = len(forecast.row)
    if len(xy) < 2 or not count:
        none = np.full(count, math.inf)
        return Meetings(none, none, none, math.inf, False)
    return Meetings(
        *_meet(begin, xy, heading, path.yaw[begin:], ego, forecast.poses, forecast.half, forecast.speed, forecast.kind,
               manner.pace, patience)
    )  # fmt: skip


def window_of(path: ReferencePath, ego: Ego) -> tuple[int, Floats, Floats]:
    """Number of the first sample at the ego, and places and headings of the way ahead, the first one the ego's own."""
    begin = max(int(ego.s / STEP), 0)
    end = min(begin + int(RANGE / STEP), len(path))
    xy, heading = path.xy[begin:end].copy(), path.heading[begin:end].copy()
    if len(xy):
        xy[0] = ego.x, ego.y
        heading[0] += math.remainder(ego.yaw - heading[0], 2.0 * math.pi)
    return begin, xy, heading


@kernel
def _meet(
    begin: int,
    xy: Floats,
    heading: Floats,
    course: Floats,
    ego: Ego,
    poses: Floats,
    half: Floats,
    speed: Floats,
    kind: NDArray[np.uint8],
    pace: Pace,
    patience: float,
) -> tuple[Floats, Floats, Floats, float, bool]:
    count = len(poses)
    margin = np.empty(count)
    for h in range(count):
        if kind[h] == _WALKER:
            margin[h] = WALKER_MARGIN
        elif kind[h] == _PROP or speed[h] < 0.2:
            margin[h] = PROP_MARGIN
        elif math.cos(poses[h, 0, 2] - ego.yaw) < FACING:
            margin[h] = FACING_MARGIN
        else:
            margin[h] = VEHICLE_MARGIN
    first, last = sweep(xy, heading, ego.half_length, ego.half_width, poses, half, margin)
    accelerations, stops, touches = np.full(count, math.inf), np.full(count, math.inf), np.full(count, math.inf)
    kerb, is_faced = math.inf, False
    base = begin * STEP
    for h in range(count):
        if kind[h] == _WALKER and speed[h] < 0.3:
            kerb = min(kerb, _kerb_speed(xy, poses[h, 0]))
        when = -1
        for k in range(poses.shape[1]):
            if first[h, k] >= 0.0:
                when = k
                break
        if when < 0 or _comes_from_behind(ego, poses[h, 0], half[h, 0], speed[h]):
            continue
        if when == 0 and first[h, 0] * STEP < 0.6 and speed[h] < 0.3 and _ahead_of(ego, poses[h, 0]) < 0.0:
            continue  # stands against the ego's side: going on leaves it behind
        is_faced = is_faced or (speed[h] > 1.0 and math.cos(poses[h, when, 2] - ego.yaw) < FACING)
        if when == 0:
            touches[h] = base + STEP * first[h, 0]
        direction = course[min(int(first[h, when]), len(course) - 1)]
        accelerations[h], stops[h] = _judge(
            base, direction, ego, poses[h], speed[h], kind[h] == _WALKER, when, first[h], last[h], pace, patience
        )
    return accelerations, stops, touches, kerb, is_faced


@kernel
def _judge(
    base: float,
    course: float,
    ego: Ego,
    poses: Floats,
    speed: float,
    is_walker: bool,
    when: int,
    first: Floats,
    last: Floats,
    pace: Pace,
    patience: float,
) -> tuple[float, float]:
    """Acceleration that a forecast leaves, and where the ego would come to rest."""
    facing = math.cos(poses[when, 2] - course)
    pull = NOMINAL + (1.0 - patience) * (BRISK - NOMINAL)
    place = base + STEP * first[when]
    gap_now = place - ego.s
    if when and gap_now < 0.6 and _ahead_of(ego, poses[when]) < 0.3 * ego.half_length:
        return math.inf, math.inf  # would run into the ego's side or back: going on is all it can do
    if not is_walker and (speed < 0.3 or facing > 0.7):
        return _behind(base, ego, speed, facing, when, first, pace, pull)
    before, after = (WALKER_BEFORE, WALKER_AFTER) if is_walker else (BEFORE, AFTER)
    low, high, until = math.inf, -math.inf, when
    for k in range(when, len(first)):
        if first[k] >= 0.0:
            low, high, until = min(low, base + STEP * first[k]), max(high, base + STEP * last[k]), k
    arrives, leaves = TIMES[when], TIMES[until] + 0.3
    if is_walker and until == len(first) - 1:
        leaves = math.inf
    top = max(ego.wanted, 2.0)
    reach = time_to_cover(low - ego.s, ego.speed, pull, top)
    clear = time_to_cover(high - ego.s + 0.3, ego.speed, pull, top)
    if clear + before * (0.4 + 0.6 * patience) < arrives or reach > leaves + after:
        return math.inf, math.inf
    gap = low - ego.s - (WALKER_GAP if is_walker else WALL_GAP * (0.3 + 0.7 * patience))
    if low - ego.s < 0.05 and arrives > 0.3 and clear < arrives + 0.2:
        return math.inf, math.inf  # in the middle of it and out before the other is there
    if gap <= 0.2 and low - ego.s > 0.2 and ego.speed >= 1.0:
        gap = low - ego.s - 0.15  # too late for the distance that it would keep
    return stop_within(ego.speed, gap, pace), max(low - WALL_GAP, ego.s)


@kernel
def _behind(
    base: float, ego: Ego, speed: float, facing: float, when: int, first: Floats, pace: Pace, pull: float
) -> tuple[float, float]:
    """The same for somebody who drives ahead on the path, stands there, or comes onto it ahead."""
    leader = speed * max(facing, 0.0) if speed >= 0.3 else 0.0
    gap_now = base + STEP * first[when] - ego.s
    final = first[when]
    if when:  # comes into the way ahead: only if the ego isn't well past by then
        reach = time_to_cover(gap_now + 2.0 * ego.half_length, ego.speed, pull, ego.wanted)
        # Who comes from behind then must not catch up with the ego before that is as fast.
        slower = max(speed - min(ego.speed + pull * reach, ego.wanted), 0.0)
        if reach + BEFORE + slower * slower / (2.0 * pull * max(speed, 1.0)) < TIMES[when]:
            return math.inf, math.inf
    lowest = math.inf
    for k in range(when, len(first)):
        if first[k] >= 0.0:
            final = first[k]
            if when:
                lowest = min(lowest, merge(ego.speed, base + STEP * first[k] - ego.s - 1.5 - 0.6 * leader, TIMES[k]))
    if not when:
        lowest = follow(ego.speed, gap_now, leader, ego.wanted, pace)
    # Where the ego ends up if the other goes on as forecast to the end.
    return lowest, base + STEP * final - pace.standstill if leader < 2.5 else math.inf


@kernel
def _ahead_of(ego: Ego, pose: Floats) -> float:
    """How far ahead of the ego's centre a place is, along its heading [m]."""
    return float((pose[0] - ego.x) * math.cos(ego.yaw) + (pose[1] - ego.y) * math.sin(ego.yaw))


@kernel
def _comes_from_behind(ego: Ego, pose: Floats, half_length: float, speed: float) -> bool:
    """Whether the other follows the ego: its business to keep off."""
    ahead = _ahead_of(ego, pose)
    aside = abs((pose[1] - ego.y) * math.cos(ego.yaw) - (pose[0] - ego.x) * math.sin(ego.yaw))
    reach = ego.half_length + half_length
    similar = math.cos(pose[2] - ego.yaw) > 0.5
    return (ahead < -0.6 * reach and similar and aside < 3.0) or (ahead < -reach and speed < 0.3)


@kernel
def pressed_by(
    ego: Ego, xyz: Floats, yaw: Floats, velocities: Floats, sizes: NDArray[np.float32], classes: NDArray[np.uint8]
) -> float:
    """Speed of who comes up from behind on the ego's lane and would be upon it soon [m/s]; 0 without any."""
    fastest = 0.0
    cos, sin = math.cos(ego.yaw), math.sin(ego.yaw)
    for k in range(1, len(xyz)):
        if classes[k] >= _WALKER or math.cos(yaw[k] - ego.yaw) < 0.7:
            continue
        dx, dy = xyz[k, 0] - ego.x, xyz[k, 1] - ego.y
        gap = -(dx * cos + dy * sin) - ego.half_length - 0.5 * sizes[k, 0]
        speed = velocities[k, 0] * cos + velocities[k, 1] * sin
        closing = speed - ego.speed
        if -1.0 < gap < PRESSED_WITHIN and abs(dy * cos - dx * sin) < 1.3 and gap < PRESSED_TIME * closing:
            fastest = max(fastest, speed)
    return fastest


@kernel
def _kerb_speed(xy: Floats, pose: Floats) -> float:
    """Speed [m/s] that respects a walker who stands at `pose`; inf if it is far off, behind, or looks elsewhere."""
    nearest, best = 0, math.inf
    for k in range(min(len(xy), int(KERB_AHEAD / STEP))):
        distance = (xy[k, 0] - pose[0]) ** 2 + (xy[k, 1] - pose[1]) ** 2
        if distance < best:
            nearest, best = k, distance
    if nearest == 0 or best > KERB_REACH * KERB_REACH:
        return math.inf
    towards = math.atan2(xy[nearest, 1] - pose[1], xy[nearest, 0] - pose[0])
    if math.cos(towards - pose[2]) <= 0.5:
        return math.inf
    room = max(nearest * STEP - 12.0, 0.0)
    return math.sqrt(CREEP * CREEP + 2.0 * 1.8 * room)


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
    x0, x1, y0, y1 = math.inf, -math.inf, math.inf, -math.inf
    for i in range(samples):
        x0, x1, y0, y1 = min(x0, xy[i, 0]), max(x1, xy[i, 0]), min(y0, xy[i, 1]), max(y1, xy[i, 1])
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
            if x < x0 - radius or x > x1 + radius or y < y0 - radius or y > y1 + radius:
                continue
            i = 0
            while i < samples:
                distance = math.sqrt((x - xy[i, 0]) ** 2 + (y - xy[i, 1]) ** 2)
                if distance > radius:
                    i += max(1, int((distance - radius) / 0.6))  # samples are at most 0.6 m apart
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
