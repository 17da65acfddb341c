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
from agents.behavior.sweep import sweep
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
FLATTEST = 0.4  # sine of the angle between their ways
FIRM = 3.0  # [m/s²] at which it stops where it has come nearer than that
LAST = 7.0  # [m/s²] who would need more to let somebody in goes first where there is time for it
WALKER_GAP = 2.0
NOMINAL, BRISK = 1.6, 3.0  # [m/s²] at which the ego would go, at first and once it has waited for long
CREEP = 6.0  # [m/s] past walkers who stand at the kerb and face the road
KERB_REACH = 6.0  # [m] from the path
CHANGES_LANE, BESIDE_ITS_LANE = 3.0, 1.6  # [m] aside up to which who comes from behind follows it, and at first
PULLS_OUT = 3.0  # [m/s] up to which it pulls out of a place beside the lane
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
        follows: (H,) whether it stands or drives ahead on the ego's way.
        enters, leaves: (H, K) first and last sample of the way, counted from the one at the ego, on which the ego would
            meet it at the forecast times; -1 where it doesn't, or needn't mind.
        base: Place of that first sample [m along the path].
        kerb: Speed that respects walkers who stand beside the path and look across it [m/s]; inf without any.
        is_faced: Whether somebody comes towards the ego on its way.
    """

    acceleration: Floats
    stop: Floats
    first: Floats
    follows: NDArray[np.bool_]
    enters: Floats
    leaves: Floats
    kerb: float
    is_faced: bool
    base: float

    def of_followed(self) -> Meetings:
        """The same with bounds of those alone who stand or drive ahead on the way."""
        free = np.full(len(self.first), math.inf)
        acceleration, stop = (np.where(self.follows, column, free) for column in (self.acceleration, self.stop))
        return self._replace(acceleration=acceleration, stop=stop)


def meetings(
    path: ReferencePath, ego: Ego, forecast: Forecast, manner: Manner, patience: float, yields: NDArray[np.bool_]
) -> Meetings:
    """What all forecasts mean that touch the ego's way within the horizon.

    Args:
        path: The ego's path.
        ego: Where it is.
        forecast: Where others will be.
        manner: How it drives.
        patience: 1 at first; falls to 0 while the ego stands for others, and narrows the gaps it waits for.
        yields: (H,) who brakes for a nose in its way; the others are not come near.
    """
    begin, xy, heading = window_of(path, ego)
    count = len(forecast.row)
    if len(xy) < 2 or not count:
        none, never = np.full(count, math.inf), np.full((count, len(TIMES)), -1.0)
        return Meetings(none, none, none, np.zeros(count, np.bool_), never, never, math.inf, False, begin * STEP)
    return Meetings(
        *_meet(begin, xy, heading, path.yaw[begin:], ego, forecast.poses, forecast.half, forecast.speed, forecast.kind,
               manner.pace, patience, yields),
        begin * STEP,
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
    yields: NDArray[np.bool_],
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_], Floats, Floats, float, bool]:
    count = len(poses)
    margin, follows = np.empty(count), np.zeros(count, np.bool_)
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
            first[h] = -1.0
            continue
        if when == 0 and first[h, 0] * STEP < 0.6 and speed[h] < 0.3 and _ahead_of(ego, poses[h, 0]) < 0.0:
            first[h] = -1.0
            continue  # stands against the ego's side: going on leaves it behind
        is_faced = is_faced or (speed[h] > 1.0 and math.cos(poses[h, when, 2] - ego.yaw) < FACING)
        if when == 0:
            touches[h] = base + STEP * first[h, 0]
        direction = course[min(int(first[h, when]), len(course) - 1)]
        along = speed[h] < 0.3 or math.cos(poses[h, when, 2] - direction) > 0.7
        follows[h] = when == 0 and kind[h] != _WALKER and along
        accelerations[h], stops[h] = _judge(
            base,
            direction,
            ego,
            poses[h],
            speed[h],
            kind[h] == _WALKER,
            when,
            first[h],
            last[h],
            pace,
            patience,
            yields[h],
        )
    return accelerations, stops, touches, follows, first, last, kerb, is_faced


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
    yields: bool,
) -> tuple[float, float]:
    """Acceleration that a forecast leaves, and where the ego would come to rest."""
    facing = math.cos(poses[when, 2] - course)
    pull = NOMINAL + (1.0 - patience) * (BRISK - NOMINAL)
    place = base + STEP * first[when]
    gap_now = place - ego.s
    is_hit = ego.speed > PULLS_OUT or (first[when] < 0.5 and facing < 0.7)  # slower, it had better let them pass
    if when and is_hit and gap_now < 0.6 and _ahead_of(ego, poses[when]) < 0.3 * ego.half_length:
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
    kept = WALL_GAP * (0.3 + 0.7 * patience)
    if not yields:  # stays off its way to the side, too, however flat their ways cross
        kept = WALL_GAP / max(abs(math.sin(poses[when, 2] - course)), FLATTEST)
    gap = low - ego.s - (WALKER_GAP if is_walker else kept)
    if low - ego.s < 0.05 and arrives > 0.3 and clear < arrives + 0.2:
        return math.inf, math.inf  # in the middle of it and out before the other is there
    if gap <= 0.2 and low - ego.s > 0.2 and ego.speed >= 1.0:
        # Too late for the distance that it would keep; it does not go farther than it must.
        gap = min(low - ego.s - 0.15, ego.speed * ego.speed / (2.0 * FIRM))
    return stop_within(ego.speed, gap, pace), max(low - kept, ego.s)


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
        if ego.speed * ego.speed > 2.0 * LAST * max(gap_now, 0.1) and reach < TIMES[when]:
            return math.inf, math.inf  # to stop in its way would be worse
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
    beside = BESIDE_ITS_LANE if ego.speed < PULLS_OUT and speed > ego.speed + 1.0 else CHANGES_LANE
    return (ahead < -0.6 * reach and similar and aside < beside) or (ahead < -reach and speed < 0.3)


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
