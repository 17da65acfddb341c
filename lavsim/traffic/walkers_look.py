"""How walkers look before they cross, and what they do when a vehicle comes at them on the road."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.portable_math import cos_sin
from lavsim.traffic.walkers_ground import Ground
from lavsim.types import DT, LightState, RoadOption, VehicleLight

STANDS = 0.3  # [m/s] below that a vehicle waits
PULL_AWAY = 1.0  # [m/s²] with which an approaching vehicle may speed up
FROM_REST = 2.0  # [m/s²] with which one leaves the line at green
CAN_STOP = 4.0  # [m/s²] that a driver brakes for a red light
TIME_MARGIN = 1.2  # [s] between a walker that leaves a lane and the vehicle that comes
BEHIND_MARGIN = 0.7  # [s] between a vehicle that has passed and the walker
RED_MARGIN = 0.5  # [s] kept at the end of a red light
LANE_HALF = 2.2  # [m] a vehicle this near to a lane's centre may be on it
BLINK_RANGE = 30.0  # [m] before a junction in which a vehicle's indicator is believed
DANGER_RANGE = 30.0  # [m]
DANGER_TIME = 2.6  # [s]
DANGER_STEP = 0.2  # [s]
DANGER_MARGIN = 0.5  # [m] round a vehicle's box

_RED = int(LightState.RED)
_DARK = (int(LightState.OFF), int(LightState.UNKNOWN))
_LEFT, _RIGHT = int(RoadOption.LEFT), int(RoadOption.RIGHT)
_LEFT_BLINKER, _RIGHT_BLINKER = int(VehicleLight.LEFT_BLINKER), int(VehicleLight.RIGHT_BLINKER)
_WIDEST_ANGLE = 0.5  # cosine of what a vehicle's heading may differ from its lane's
_STRIDE = 5  # points of a lane passed over at a time


class Actors(NamedTuple):
    """All rows of the world.

    Attributes:
        present: (N,).
        motion: (N,) as `lavsim.world.motion`.
        pose: (N, 3) x, y [m], yaw [rad].
        velocity: (N, 3) vx, vy [m/s], yaw rate [rad/s].
        sizes: (N, 3) full length, width, height [m].
        classes: (N,) `ActorClass`.
        height: (N,) z of the ground below [m].
        lights: (N,) `VehicleLight` bits.
    """

    present: NDArray[np.bool_]
    motion: NDArray[np.uint8]
    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    sizes: NDArray[np.float32]
    classes: NDArray[np.uint8]
    height: NDArray[np.float64]
    lights: NDArray[np.int32]


class Signals(NamedTuple):
    """What walkers know of the traffic lights of a town.

    Attributes:
        state: (L,) `LightState` of this tick.
        before: (L,) of the last tick.
        since: (L,) tick at which it became red; long ago where nobody saw it.
        red: (L,) how long it was red the last time [s].
    """

    state: NDArray[np.uint8]
    before: NDArray[np.uint8]
    since: NDArray[np.int64]
    red: NDArray[np.float64]


@kernel
def watch(signals: Signals, tick: int) -> None:
    """Notes which lights have become red and how long those that no longer are were."""
    for k in range(len(signals.state)):
        if signals.state[k] != signals.before[k]:
            if signals.state[k] == _RED and signals.before[k] not in _DARK:
                signals.since[k] = tick
            elif signals.before[k] == _RED and signals.since[k] > 0:
                signals.red[k] = (tick - signals.since[k]) * DT
            signals.before[k] = signals.state[k]


@kernel
def red_left(signals: Signals, light: int, tick: int) -> float:
    """How long a light stays red by what was seen of it [s]; 0 if it is not."""
    if signals.state[light] != _RED:
        return 0.0
    return max(signals.red[light] - (tick - signals.since[light]) * DT, 0.0)


@kernel
def may_cross(
    ground: Ground,
    actors: Actors,
    movers: NDArray[np.int32],
    moving: int,
    signals: Signals,
    tick: int,
    place: tuple[int, bool, float],
    speed: float,
    margin: float,
    blocker: int,
) -> tuple[bool, int]:
    """Whether a walker may step onto the road; else the row of the vehicle that it has to let pass, -1 for a light.

    Args:
        ground: The town.
        actors: All that is there.
        movers: Rows of vehicles, the first `moving` of which count.
        signals: The lights.
        tick: Now.
        place: Edge, whether it is walked forward, and how far along it the walker is in its direction [m].
        speed: At which it would cross [m/s].
        margin: Time kept before the next vehicle [s].
        blocker: Row of the vehicle that it let pass the last time, which is looked at first; -1 for none.
    """
    edge = ground.edge[place[0]]
    for k in range(edge.crossed, edge.crossed_end):
        lane = ground.crossed[k]
        if lane.light >= 0 and signals.state[lane.light] not in _DARK:
            leave = (lane.leave if place[1] else edge.length - lane.enter) - place[2]
            if red_left(signals, lane.light, tick) < leave / speed + RED_MARGIN:
                return False, -1
    if blocker >= 0 and _is_in_the_way(ground, actors, blocker, signals, tick, place, speed, margin):
        return False, blocker
    for m in range(moving):
        if _is_in_the_way(ground, actors, movers[m], signals, tick, place, speed, margin):
            return False, movers[m]
    return True, -1


@kernel
def _is_in_the_way(
    ground: Ground,
    actors: Actors,
    row: int,
    signals: Signals,
    tick: int,
    place: tuple[int, bool, float],
    speed: float,
    margin: float,
) -> bool:
    """Whether a vehicle is on the walker's way, or will be before the walker has crossed its lane."""
    edge = ground.edge[place[0]]
    dx, dy = actors.pose[row, 0] - edge.x, actors.pose[row, 1] - edge.y
    gap = math.sqrt(dx * dx + dy * dy)
    if gap > edge.reach or abs(actors.height[row] - ground.points[edge.first, 2]) > 3.0:
        return False
    if gap < 0.5 * (edge.length + actors.sizes[row, 0]) + 1.0 and _bars(ground, actors, row, place):
        return True
    for k in range(edge.approach, edge.approach_end):
        if _comes(ground, actors, row, k, signals, tick, place, speed, margin):
            return True
    return False


@kernel
def _bars(ground: Ground, actors: Actors, row: int, place: tuple[int, bool, float]) -> bool:
    """Whether a vehicle is on the way itself."""
    edge = ground.edge[place[0]]
    half_length, half_width = 0.5 * actors.sizes[row, 0] + 0.6, 0.5 * actors.sizes[row, 1] + 0.6
    cos, sin = cos_sin(actors.pose[row, 2])
    for p in range(edge.first, edge.last + 1):
        along = (p - edge.first) * edge.step
        if along < edge.near_kerb or along > edge.far_kerb:
            continue
        dx, dy = ground.points[p, 0] - actors.pose[row, 0], ground.points[p, 1] - actors.pose[row, 1]
        if abs(dx * cos + dy * sin) < half_length and abs(dy * cos - dx * sin) < half_width:
            return True
    return False


@kernel
def _comes(
    ground: Ground,
    actors: Actors,
    row: int,
    k: int,
    signals: Signals,
    tick: int,
    place: tuple[int, bool, float],
    walk: float,
    margin: float,
) -> bool:
    """Whether a vehicle would reach the way along approach `k` before the walker is off its lane."""
    way = ground.approach[k]
    x, y = actors.pose[row, 0], actors.pose[row, 1]
    if x < way.x0 or x > way.x1 or y < way.y0 or y > way.y1:
        return False
    half = 0.5 * actors.sizes[row, 0]
    speed = math.sqrt(actors.velocity[row, 0] ** 2 + actors.velocity[row, 1] ** 2)
    if speed < STANDS and (way.light < 0 or signals.state[way.light] != _RED):
        return False
    u = _place_on(ground, actors, row, k)
    if u < 0.0:
        return False
    ahead = way.ahead - u - half  # from its front to the walkers' way
    if ahead + 2.0 * half + way.zone < 0.0:
        return False
    blinks = actors.lights[row] & (_LEFT_BLINKER | _RIGHT_BLINKER)
    if (
        ahead < BLINK_RANGE
        and blinks
        and ((blinks == _LEFT_BLINKER and way.turn == _RIGHT) or (blinks == _RIGHT_BLINKER and way.turn == _LEFT))
    ):
        return False
    edge, lane = ground.edge[place[0]], ground.crossed[way.crossed]
    enter = (lane.enter if place[1] else edge.length - lane.leave) - place[2]
    leave = (lane.leave if place[1] else edge.length - lane.enter) - place[2]
    clear = leave / walk + margin
    ahead = max(ahead, 0.0)
    if way.light >= 0 and signals.state[way.light] == _RED and ahead - way.line > -1.0:
        room = max(ahead - way.line, 0.5)
        if speed * speed < 2.0 * CAN_STOP * room:
            return red_left(signals, way.light, tick) + math.sqrt(2.0 * ahead / FROM_REST) < clear
    if speed < STANDS:
        return False
    if (ahead + 2.0 * half + way.zone) / speed < enter / walk - BEHIND_MARGIN:
        return False
    return (math.sqrt(speed * speed + 2.0 * PULL_AWAY * ahead) - speed) / PULL_AWAY < clear


@kernel
def _place_on(ground: Ground, actors: Actors, row: int, k: int) -> float:
    """Length along approach `k` at which a vehicle is [m]; -1 if it is not on it."""
    way = ground.approach[k]
    x, y = actors.pose[row, 0], actors.pose[row, 1]
    best, nearest = -1, np.inf
    p = 0
    while p < way.rows:
        at = min(p, way.rows - 1)
        dx, dy = x - ground.lane_points[way.row + at, 0], y - ground.lane_points[way.row + at, 1]
        gap = dx * dx + dy * dy
        if gap < nearest:
            best, nearest = at, gap
        p += _STRIDE
    yaw = ground.lane_points[way.row + best, 3]
    cos, sin = cos_sin(yaw)
    dx, dy = x - ground.lane_points[way.row + best, 0], y - ground.lane_points[way.row + best, 1]
    if abs(dy * cos - dx * sin) > LANE_HALF or abs(dx * cos + dy * sin) > (_STRIDE + 1) * way.step + 1.0:
        return -1.0
    if cos_sin(actors.pose[row, 2] - yaw)[0] < _WIDEST_ANGLE:
        return -1.0
    return max(best * way.step + dx * cos + dy * sin, 0.0)


@kernel
def time_to_hit(
    actors: Actors,
    movers: NDArray[np.int32],
    moving: int,
    walker: int,
    vx: float,
    vy: float,
) -> float:
    """When a vehicle that keeps its speed and bend meets a walker that goes on at `vx`, `vy` [s]; inf if none does."""
    first = np.inf
    x, y = actors.pose[walker, 0], actors.pose[walker, 1]
    for m in range(moving):
        row = movers[m]
        dx, dy = actors.pose[row, 0] - x, actors.pose[row, 1] - y
        speed = math.sqrt(actors.velocity[row, 0] ** 2 + actors.velocity[row, 1] ** 2)
        if dx * dx + dy * dy > DANGER_RANGE**2 or speed < STANDS:
            continue
        if abs(actors.height[row] - actors.height[walker]) > 3.0:
            continue
        half_length, half_width = 0.5 * actors.sizes[row, 0] + DANGER_MARGIN, 0.5 * actors.sizes[row, 1] + DANGER_MARGIN
        cx, cy, yaw = actors.pose[row, 0], actors.pose[row, 1], actors.pose[row, 2]
        t = 0.0
        while t < min(first, DANGER_TIME):
            t += DANGER_STEP
            yaw += actors.velocity[row, 2] * DANGER_STEP
            cos, sin = cos_sin(yaw)
            cx, cy = cx + speed * cos * DANGER_STEP, cy + speed * sin * DANGER_STEP
            gx, gy = x + vx * t - cx, y + vy * t - cy
            if abs(gx * cos + gy * sin) < half_length and abs(gy * cos - gx * sin) < half_width:
                first = min(first, t)
                break
    return first
