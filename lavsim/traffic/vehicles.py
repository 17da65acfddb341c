"""Background traffic as one array kernel: following, lanes, lights, junctions, obstacles of any kind.

Car following is the intelligent driver model (Treiber, Hennecke & Helbing 2000, Phys. Rev. E 62, 1805). A driver looks
along its own path, point by point, and takes whatever box covers a point (vehicle, walker, prop, ego) as its leader; so
crossing and merging road users need no case of their own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.kernel_draws import draw_at, draw_base
from lavsim.map.town_map import TownMap
from lavsim.traffic.obstacles import Boxes, Grid, obstacle_at
from lavsim.types import DT, LightState, RoadOption, VehicleLight

PATH_LANES = 10  # lanes ahead that a driver has decided on
_SAMPLE = 1.5  # [m] between the points of a path that are looked at
_LATERAL_ACCELERATION = 2.0  # [m/s²] in bends
_HARD_BRAKE = 8.0  # [m/s²]
_SIDE_MARGIN = 0.35  # [m] kept free on either side
_CREEP_MARGIN = 0.1  # [m] the same for who has come to a stop: where there is room, it squeezes past
_LINE_GAP = 1.0  # [m] between the bumper and a stop line
_YELLOW_BRAKE = 3.5  # [m/s²] a driver stops at yellow if that much suffices
_SIGNAL_RANGE = 30.0  # [m] before a junction at which the indicator is set, and others are looked at
_STEER_LENGTH = 4.0  # [m] over which an error of position fades
_UPSET_TICKS = 100  # after a contact a driver brakes for 5 s
_LOST = 2.5  # [m] off its lane: pushed aside, the driver stays there

_MAJOR, _YIELDS, _STOPS = 0, 1, 2
_RANKS = {"yield": _YIELDS, "stop": _STOPS}

_RED, _YELLOW, _GREEN = int(LightState.RED), int(LightState.YELLOW), int(LightState.GREEN)
_LEFT, _RIGHT = int(RoadOption.LEFT), int(RoadOption.RIGHT)
_BRAKE_LIGHT, _LEFT_BLINKER, _RIGHT_BLINKER = (
    int(VehicleLight.BRAKE),
    int(VehicleLight.LEFT_BLINKER),
    int(VehicleLight.RIGHT_BLINKER),
)


class Lanes(NamedTuple):
    """The columns of `LaneTable` that drivers read, and what signals and signs mean for them.

    Attributes:
        setback: (L,) from the line to stop at to the lane's end [m].
        rank: (L,) who waits for whom at junctions without lights: `_MAJOR`, `_YIELDS` or `_STOPS`.
    """

    first: NDArray[np.int32]
    step: NDArray[np.float64]
    length: NDArray[np.float64]
    points: NDArray[np.float64]
    junction: NDArray[np.int32]
    speed_limit: NDArray[np.float64]
    light: NDArray[np.int32]
    turn: NDArray[np.int8]
    succ_first: NDArray[np.int32]
    succ: NDArray[np.int32]
    conflict_first: NDArray[np.int32]
    conflict: NDArray[np.int32]
    conflict_u: NDArray[np.float64]
    setback: NDArray[np.float64]
    rank: NDArray[np.int8]


def lanes_of(town: TownMap) -> Lanes:
    """What drivers read of a town."""
    columns = [np.ascontiguousarray(getattr(town.lanes, name)) for name in Lanes._fields[:-2]]
    setback = np.zeros(len(town.lanes))
    rank = np.full(len(town.lanes), _MAJOR, np.int8)
    signs = [sign for sign in town.signs if sign.kind in _RANKS]
    for sign in signs:
        rank[list(sign.lanes)] = _RANKS[sign.kind]
    for line in (line for posts in (town.lights, signs) for post in posts for line in post.stop_lines):
        setback[line.lane] = max(setback[line.lane], town.lanes.length[line.lane] - line.paint_u)
    return Lanes(*[*columns, setback, rank])


class Fleet(NamedTuple):
    """All background vehicles, one row each.

    Attributes:
        row: (V,) row in the world.
        key: (V,) key of the stream that chooses branches.
        lane: (V,) current lane.
        u: (V,) travelled length of it [m].
        path: (V, PATH_LANES) lanes to come, -1 beyond the end of the road.
        hops: (V,) branches drawn so far.
        driver: (V, 5) `Driver`: speed factor, headway, smallest gap, acceleration, deceleration.
        committed: (V,) junction lane that the driver has decided to enter, -1.
        halted: (V,) junction lane before whose stop sign it has stood, -1.
    """

    row: NDArray[np.int64]
    key: NDArray[np.uint64]
    lane: NDArray[np.int32]
    u: NDArray[np.float64]
    path: NDArray[np.int32]
    hops: NDArray[np.int64]
    driver: NDArray[np.float64]
    committed: NDArray[np.int32]
    halted: NDArray[np.int32]


class Approaches(NamedTuple):
    """Who is in or near each junction lane, rebuilt every tick.

    Attributes:
        head: (L,) first vehicle whose next junction lane it is, -1.
        follow: (V,) the next such vehicle, -1.
        lane: (V,) junction lane a vehicle is on or comes to next, -1.
        distance: (V,) from its front to that lane [m]; negative once inside.
        tail: (L,) travelled length at the rear of the last slow vehicle of each lane [m]; inf when free.
        claimed: (L,) length taken on each lane by vehicles inside the junction before it [m].
        ready: (V,) whether the vehicle could leave its junction lane again: who can't has no right of way either.
    """

    head: NDArray[np.int32]
    follow: NDArray[np.int32]
    lane: NDArray[np.int32]
    distance: NDArray[np.float64]
    tail: NDArray[np.float64]
    claimed: NDArray[np.float64]
    ready: NDArray[np.bool_]


def make_approaches(lanes: int, vehicles: int) -> Approaches:
    return Approaches(
        np.zeros(lanes, np.int32),
        np.zeros(vehicles, np.int32),
        np.zeros(vehicles, np.int32),
        np.zeros(vehicles),
        np.zeros(lanes),
        np.zeros(lanes),
        np.zeros(vehicles, np.bool_),
    )


@kernel
def lane_point(lanes: Lanes, lane: int, u: float) -> tuple[float, float, float, float]:
    """x, y [m], heading [rad] and curvature [1/m] of a lane centre at `u`."""
    first, last = lanes.first[lane], lanes.first[lane + 1] - 1
    at = min(max(u / lanes.step[lane], 0.0), float(last - first))
    k = min(first + int(at), max(last - 1, first))
    share = at - (k - first)
    a, b = lanes.points[k], lanes.points[min(k + 1, last)]
    return (
        a[0] + (b[0] - a[0]) * share,
        a[1] + (b[1] - a[1]) * share,
        a[3] + (b[3] - a[3]) * share,
        a[4] + (b[4] - a[4]) * share,
    )


@kernel
def lane_height(lanes: Lanes, lane: int, u: float) -> float:
    """z of a lane centre at `u` [m]."""
    first, last = lanes.first[lane], lanes.first[lane + 1] - 1
    at = min(max(u / lanes.step[lane], 0.0), float(last - first))
    k = min(first + int(at), max(last - 1, first))
    return lanes.points[k, 2] + (lanes.points[min(k + 1, last), 2] - lanes.points[k, 2]) * (at - (k - first))


@kernel
def extend_path(lanes: Lanes, fleet: Fleet, i: int) -> None:
    """Draws branches until the path of vehicle `i` is full or the road ends."""
    previous = fleet.lane[i]
    for k in range(PATH_LANES):
        if fleet.path[i, k] < 0:
            options = lanes.succ_first[previous + 1] - lanes.succ_first[previous]
            if options == 0:
                return
            word = draw_at(draw_base(fleet.key[i], fleet.hops[i]), 0)
            fleet.hops[i] += 1
            fleet.path[i, k] = lanes.succ[lanes.succ_first[previous] + int(word % np.uint64(options))]
        previous = fleet.path[i, k]


@kernel
def _advance(lanes: Lanes, fleet: Fleet, i: int, x: float, y: float) -> float:
    """Finds where vehicle `i` is along its path; returns its offset to the right of the lane centre [m]."""
    offset = 0.0
    for _ in range(2):
        px, py, yaw, _curvature = lane_point(lanes, fleet.lane[i], fleet.u[i])
        dx, dy = x - px, y - py
        fleet.u[i] += dx * math.cos(yaw) + dy * math.sin(yaw)
        offset = dy * math.cos(yaw) - dx * math.sin(yaw)
        while fleet.u[i] >= lanes.length[fleet.lane[i]] and fleet.path[i, 0] >= 0:
            fleet.u[i] -= lanes.length[fleet.lane[i]]
            fleet.lane[i] = fleet.path[i, 0]
            fleet.path[i, :-1] = fleet.path[i, 1:]
            fleet.path[i, -1] = -1
            extend_path(lanes, fleet, i)
        fleet.u[i] = max(fleet.u[i], 0.0)
    return offset


@kernel
def _survey(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Approaches) -> None:
    """Fills `near` from where all vehicles are."""
    near.head[:] = -1
    near.tail[:] = np.inf
    near.claimed[:] = 0.0
    for i in range(len(fleet.row)):
        row = fleet.row[i]
        near.lane[i] = near.follow[i] = -1
        if not boxes.present[row]:
            continue
        half = boxes.half[row, 0]
        lane = fleet.lane[i]
        speed = math.sqrt(boxes.velocity[row, 0] ** 2 + boxes.velocity[row, 1] ** 2)
        if speed < 3.0:
            near.tail[lane] = min(near.tail[lane], fleet.u[i] - half)
        ahead = lanes.length[lane] - fleet.u[i] - half
        junction_lane = -1
        if lanes.junction[lane] >= 0:
            junction_lane, ahead = lane, -1.0
            exit_lane = _exit_of(lanes, fleet, i, -1)
            if exit_lane >= 0:
                near.claimed[exit_lane] += 2.0 * half + 2.0
        else:
            for k in range(PATH_LANES):
                lane = fleet.path[i, k]
                if lane < 0 or lanes.junction[lane] >= 0 or ahead > _SIGNAL_RANGE:
                    junction_lane = lane if ahead <= _SIGNAL_RANGE else -1
                    break
                ahead += lanes.length[lane]
        if junction_lane >= 0:
            near.lane[i], near.distance[i] = junction_lane, ahead
            near.follow[i], near.head[junction_lane] = near.head[junction_lane], i
    for i in range(len(fleet.row)):
        near.ready[i] = near.lane[i] >= 0 and _has_room(lanes, fleet, boxes, near, i, near.lane[i])


@kernel
def _has_room(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Approaches, i: int, target: int) -> bool:
    """Whether vehicle `i` finds room behind junction lane `target`, beside those already in the junction."""
    k = 0
    while k < PATH_LANES and fleet.path[i, k] != target:
        k += 1
    exit_lane = _exit_of(lanes, fleet, i, k)
    if exit_lane < 0 or math.isinf(near.tail[exit_lane]):
        return True
    room = min(near.tail[exit_lane], lanes.length[exit_lane]) - near.claimed[exit_lane]
    return room >= 2.0 * boxes.half[fleet.row[i], 0] + 2.0


@kernel
def _exit_of(lanes: Lanes, fleet: Fleet, i: int, k: int) -> int:
    """The first lane of vehicle `i`'s path after position `k` that is outside junctions, -1."""
    for j in range(k + 1, PATH_LANES):
        lane = fleet.path[i, j]
        if lane < 0 or lanes.junction[lane] < 0:
            return lane
    return -1


@kernel
def _must_yield(lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Approaches, i: int, target: int) -> bool:
    """Whether vehicle `i` has to let somebody pass before it enters junction lane `target`.

    Whoever is inside on a crossing lane goes first. Without lights whoever can't stop any more comes next, then who has
    no stop or yield sign, then the nearest, ties by number; with lights only a left turn waits for oncoming traffic.
    """
    signalled = lanes.light[target] >= 0
    for e in range(lanes.conflict_first[target], lanes.conflict_first[target + 1]):
        other_lane = lanes.conflict[e]
        k = near.head[other_lane]
        while k >= 0:
            if k != i:
                row = fleet.row[k]
                if near.distance[k] < 0.0:
                    cleared = fleet.lane[k] == other_lane  # else only its front is inside
                    if not cleared or fleet.u[k] - boxes.half[row, 0] < _conflict_end(lanes, other_lane, target):
                        return True
                elif signalled:
                    coming = fleet.committed[k] == other_lane and near.distance[k] < 20.0
                    if coming and lanes.turn[target] == _LEFT and lanes.turn[other_lane] != _LEFT:
                        return True
                elif fleet.committed[k] == other_lane or (
                    near.ready[k] and _goes_first(lanes, near, k, other_lane, i, target)
                ):
                    return True
            k = near.follow[k]
    return False


@kernel
def _goes_first(lanes: Lanes, near: Approaches, k: int, lane_k: int, i: int, lane_i: int) -> bool:
    """Whether vehicle `k` on its way to junction lane `lane_k` goes before `i` on its way to `lane_i`."""
    if lanes.rank[lane_k] == _MAJOR and lanes.rank[lane_i] != _MAJOR:
        return True
    if lanes.rank[lane_k] != _MAJOR and lanes.rank[lane_i] == _MAJOR:
        return False
    return (near.distance[k], k) < (near.distance[i], i)


@kernel
def _conflict_end(lanes: Lanes, lane: int, other: int) -> float:
    """Travelled length on `lane` where it is clear of `other` [m]."""
    for e in range(lanes.conflict_first[lane], lanes.conflict_first[lane + 1]):
        if lanes.conflict[e] == other:
            return lanes.conflict_u[e, 1]
    return lanes.length[lane]


@kernel
def _line_distance(
    lanes: Lanes, fleet: Fleet, boxes: Boxes, near: Approaches, lights: NDArray[np.uint8], i: int, speed: float
) -> float:
    """Distance from the front of vehicle `i` to the line it has to stop at [m]; inf when it may go."""
    row = fleet.row[i]
    half = boxes.half[row, 0]
    if lanes.junction[fleet.lane[i]] >= 0:
        return np.inf
    ahead = lanes.length[fleet.lane[i]] - fleet.u[i] - half
    target, k, last = -1, 0, fleet.lane[i]
    while k < PATH_LANES and ahead < 80.0:
        lane = fleet.path[i, k]
        if lane < 0:
            return ahead  # the road ends
        if lanes.junction[lane] >= 0:
            target = lane
            break
        ahead += lanes.length[lane]
        last = lane
        k += 1
    if target < 0:
        return np.inf
    light = lanes.light[target]
    state = _GREEN if light < 0 else int(lights[light])
    if fleet.committed[i] == target and (state != _RED or ahead < 0.0):
        return np.inf
    gap = ahead - lanes.setback[last] - _LINE_GAP
    if state == _RED or (state == _YELLOW and gap > 0.0 and speed * speed < 2.0 * _YELLOW_BRAKE * gap):
        fleet.committed[i] = -1
        return max(gap, 0.0)
    if ahead > _SIGNAL_RANGE:
        return np.inf
    if light < 0 and lanes.rank[target] == _STOPS and fleet.halted[i] != target:
        if speed < 0.1 and gap < 1.0:
            fleet.halted[i] = target
        return max(gap, 0.0)
    if not _has_room(lanes, fleet, boxes, near, i, target):
        return max(gap, 0.0)
    if _must_yield(lanes, fleet, boxes, near, i, target):
        return max(gap, 0.0)
    if gap < max(2.0, 0.5 * speed * speed / _YELLOW_BRAKE):
        fleet.committed[i] = target  # too late to stop comfortably: goes
    return np.inf


@kernel
def _look_ahead(
    lanes: Lanes, fleet: Fleet, boxes: Boxes, grid: Grid, i: int, speed: float
) -> tuple[float, float, float]:
    """Gap to the leader [m], its speed [m/s], and the speed that bends and limits ahead allow now [m/s]."""
    row = fleet.row[i]
    half = boxes.half[row, 0]
    margin = boxes.half[row, 1] + (_SIDE_MARGIN if speed > 1.0 else _CREEP_MARGIN)
    horizon = half + 8.0 + 2.0 * speed + speed * speed / 4.0
    lane, u, k = fleet.lane[i], fleet.u[i], 0
    factor = fleet.driver[i, 0]
    allowed = lanes.speed_limit[lane] * factor
    distance = half
    u += half
    while distance < horizon:
        while u > lanes.length[lane]:
            if k == PATH_LANES or fleet.path[i, k] < 0:
                return np.inf, 0.0, allowed
            u -= lanes.length[lane]
            lane = fleet.path[i, k]
            k += 1
            allowed = min(allowed, math.sqrt((lanes.speed_limit[lane] * factor) ** 2 + 3.0 * (distance - half)))
        x, y, yaw, curvature = lane_point(lanes, lane, u)
        bend = math.sqrt(_LATERAL_ACCELERATION / max(abs(curvature), 1e-4))
        allowed = min(allowed, math.sqrt(bend * bend + 3.0 * (distance - half)))
        gap, other = obstacle_at(grid, boxes, row, (x, y, yaw), distance / max(speed, 2.0), margin)
        if not math.isinf(gap):
            return distance - half + gap, other, allowed
        distance += _SAMPLE
        u += _SAMPLE
    return np.inf, 0.0, allowed


@kernel
def idm_acceleration(speed: float, wanted: float, gap: float, closing: float, driver: NDArray[np.float64]) -> float:
    """Acceleration of a driver following a leader [m/s²].

    Args:
        speed: Own speed [m/s].
        wanted: Free-road speed [m/s].
        gap: Bumper to bumper [m]; inf on a free road.
        closing: Own speed minus the leader's [m/s].
        driver: (5,) see `Fleet.driver`.
    """
    free = driver[3] * (1.0 - (speed / max(wanted, 0.1)) ** 4)
    free = max(free, -3.0)
    if math.isinf(gap):
        return free
    if gap < 0.3:
        return -_HARD_BRAKE
    dynamic = speed * driver[1] + speed * closing / (2.0 * math.sqrt(driver[3] * driver[4]))
    space = driver[2] + max(0.0, dynamic)
    return max(min(free, driver[3]) - driver[3] * (space / gap) ** 2, -_HARD_BRAKE)


@kernel
def drive(
    lanes: Lanes,
    fleet: Fleet,
    boxes: Boxes,
    grid: Grid,
    near: Approaches,
    lights: NDArray[np.uint8],
    touched: NDArray[np.int64],
    tick: int,
    forward_speed: NDArray[np.float64],
    command: NDArray[np.float64],
    vehicle_lights: NDArray[np.int32],
) -> None:
    """Writes what every background driver does in this tick.

    Args:
        lanes: The road network.
        fleet: The drivers; where they are is updated.
        boxes: Everything that can be hit; the heights of the fleet's rows are updated.
        grid: The same, by place (`fill_grid`).
        near: Scratch space (`make_approaches`).
        lights: (L,) `LightState` of the town's lights.
        touched: (N,) tick of each row's last contact, -1.
        tick: Now.
        forward_speed: (N,) speed ahead of each row [m/s].
        command: (N, 2) speed after the tick [m/s] and curvature [1/m]; filled for the fleet's rows.
        vehicle_lights: (N,) `VehicleLight`; filled likewise.
    """
    count = len(fleet.row)
    offsets = np.zeros(count)
    for i in range(count):
        row = fleet.row[i]
        if boxes.present[row]:
            offsets[i] = _advance(lanes, fleet, i, boxes.pose[row, 0], boxes.pose[row, 1])
            boxes.height[row] = lane_height(lanes, fleet.lane[i], fleet.u[i])
    _survey(lanes, fleet, boxes, near)
    for i in range(count):
        row = fleet.row[i]
        if not boxes.present[row]:
            continue
        speed = max(forward_speed[row], 0.0)
        upset = touched[row] >= 0 and (tick - touched[row] < _UPSET_TICKS or abs(offsets[i]) > _LOST)
        if upset:
            acceleration = -6.0
        else:
            gap, leader, allowed = _look_ahead(lanes, fleet, boxes, grid, i, speed)
            acceleration = idm_acceleration(speed, allowed, gap, speed - leader, fleet.driver[i])
            line = _line_distance(lanes, fleet, boxes, near, lights, i, speed)
            if not math.isinf(line):  # a standing leader behind the line, so that the bumper stops at it
                behind = line + fleet.driver[i, 2]
                acceleration = min(acceleration, idm_acceleration(speed, allowed, behind, speed, fleet.driver[i]))
        command[row, 0] = max(0.0, speed + acceleration * DT)
        command[row, 1] = _steer(lanes, fleet, boxes, i, offsets[i])
        vehicle_lights[row] = _signals(lanes, near, i, acceleration, speed)


@kernel
def _steer(lanes: Lanes, fleet: Fleet, boxes: Boxes, i: int, offset: float) -> float:
    """Curvature that brings vehicle `i` back onto its lane, critically damped over `_STEER_LENGTH`."""
    row = fleet.row[i]
    _x, _y, yaw, curvature = lane_point(lanes, fleet.lane[i], fleet.u[i])
    rear = 0.58 * boxes.half[row, 0]  # as World: rear axle behind the centre
    slip = math.asin(max(-0.9, min(0.9, curvature * rear)))
    error = boxes.pose[row, 2] + slip - yaw
    error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
    bend = curvature - offset / _STEER_LENGTH**2 - 2.0 * error / _STEER_LENGTH
    return max(-0.27, min(0.27, bend))


@kernel
def _signals(lanes: Lanes, near: Approaches, i: int, acceleration: float, speed: float) -> int:
    """Brake light and indicators of vehicle `i`."""
    bits = _BRAKE_LIGHT if acceleration < -0.5 or (speed < 0.1 and acceleration <= 0.1) else 0
    if near.lane[i] >= 0:
        turn = lanes.turn[near.lane[i]]
        bits |= _LEFT_BLINKER if turn == _LEFT else _RIGHT_BLINKER if turn == _RIGHT else 0
    return bits
