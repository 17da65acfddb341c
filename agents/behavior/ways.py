"""The ways a vehicle on a lane can go on: chains of lanes, and poses along them."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.map.town_map import TownMap
from lavsim.types import LightState, RoadOption

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

T = TypeVar("T", bound=np.generic)

BEYOND = 70.0  # [m] of road behind a lane's end that another driver may use within the horizon
MAX_WAYS = 6  # from one lane
MAX_LANES = 24  # of a way
LATERAL = 4.0  # [m/s²] in bends: who is too fast for one slows down before it
SLOWING, HARDEST = 4.0, 6.0  # [m/s²] before bends, and once it is too late for that
SLOWEST = 3.0  # [m/s] in any bend

_LEFT, _RIGHT, _STRAIGHT = int(RoadOption.LEFT), int(RoadOption.RIGHT), int(RoadOption.STRAIGHT)
_FOLLOW, _RED = int(RoadOption.LANEFOLLOW), int(LightState.RED)


class Ways(NamedTuple):
    """Columns of a town's lane table that kernels follow; meanings as in `lavsim.map.lane.LaneTable`."""

    length: Floats
    first: Ints
    step: Floats
    points: Floats
    succ_first: Ints
    succ: Ints
    pred_first: Ints
    pred: Ints
    junction: Ints
    light: Ints
    turn: NDArray[np.int8]
    sharpest: Floats  # (L,) largest curvature of each lane [1/m]


def ways_of(town: TownMap | None) -> Ways:
    """The columns of `town`; of a town without lanes if there is none."""
    if town is None:
        floats, ints = _plain(np.zeros(0)), _plain(np.zeros(1, np.int32))
        none = _plain(np.zeros((0, 5)))
        return Ways(
            floats, ints, floats, none, ints, ints, ints, ints, ints, ints, _plain(np.zeros(0, np.int8)), floats
        )
    t = town.lanes
    sharpest = np.maximum.reduceat(np.abs(t.points[:, 4]), t.first[:-1])
    return Ways(
        _plain(t.length), _plain(t.first), _plain(t.step), _plain(t.points), _plain(t.succ_first), _plain(t.succ),
        _plain(t.pred_first), _plain(t.pred), _plain(t.junction), _plain(t.light), _plain(t.turn),
        _plain(sharpest),
    )  # fmt: skip


def _plain(column: NDArray[T]) -> NDArray[T]:
    """A read-only view, so that kernels are compiled once."""
    view = np.ascontiguousarray(column).view()
    view.flags.writeable = False
    return view


@kernel
def find_ways(
    ways: Ways, lane: int, signals_left: bool, signals_right: bool, chains: NDArray[np.int64], sizes: NDArray[np.int64]
) -> int:
    """Ways on from `lane` that fit the indicators, or all where none does; branches count at the first fork alone.

    Fills `chains` (MAX_WAYS, MAX_LANES) with lanes and `sizes` with how many, and returns how many ways there are.
    """
    stem = 1
    chains[0, 0] = lane
    beyond = 0.0
    while beyond < BEYOND and stem < MAX_LANES:
        begin, end = ways.succ_first[chains[0, stem - 1]], ways.succ_first[chains[0, stem - 1] + 1]
        if end - begin != 1 or _holds(chains[0], stem, ways.succ[begin]):
            break
        chains[0, stem] = ways.succ[begin]
        beyond += ways.length[chains[0, stem]]
        stem += 1
    begin, end = ways.succ_first[chains[0, stem - 1]], ways.succ_first[chains[0, stem - 1] + 1]
    if beyond >= BEYOND or stem == MAX_LANES or end - begin <= 1:
        sizes[0] = stem
        return 1
    is_inside = ways.junction[lane] >= 0
    found, fitting = 0, 0
    for wanted in range(2):  # first those that fit the indicators, then, if there is none, all
        for k in range(begin, end):
            branch = ways.succ[k]
            if found == MAX_WAYS or _holds(chains[0], stem, branch):
                continue
            turn = _first_turn(ways, chains[0], stem, branch)
            fits = turn == _LEFT if signals_left else turn == _RIGHT if signals_right else turn in (_STRAIGHT, _FOLLOW)
            if wanted == 0 and not fits and not is_inside:
                continue
            for j in range(stem):
                chains[found, j] = chains[0, j]
            chains[found, stem] = branch
            sizes[found] = _follow_on(ways, chains[found], stem + 1, beyond + ways.length[branch])
            found += 1
        fitting = found
        if fitting:
            break
    if found == 0:
        sizes[0] = stem
        return 1
    return found


@kernel
def _holds(chain: NDArray[np.int64], size: int, lane: int) -> bool:
    known = False
    for k in range(size):
        known = known or chain[k] == lane
    return known


@kernel
def _first_turn(ways: Ways, stem: NDArray[np.int64], size: int, branch: int) -> int:
    for k in range(size):
        if ways.junction[stem[k]] >= 0:
            return int(ways.turn[stem[k]])
    return int(ways.turn[branch]) if ways.junction[branch] >= 0 else _FOLLOW


@kernel
def _follow_on(ways: Ways, chain: NDArray[np.int64], size: int, beyond: float) -> int:
    """Goes on along the first lanes that follow."""
    while beyond < BEYOND and size < MAX_LANES:
        begin, end = ways.succ_first[chain[size - 1]], ways.succ_first[chain[size - 1] + 1]
        if end == begin or _holds(chain, size, ways.succ[begin]):
            break
        chain[size] = ways.succ[begin]
        beyond += ways.length[chain[size]]
        size += 1
    return size


@kernel
def slow_for_bends(
    ways: Ways, chain: NDArray[np.int64], size: int, u: float, speed: float, travelled: Floats, dt: float, out: Floats
) -> None:
    """Distance [m] at the forecast times of who slows for the bends of its way.

    Args:
        ways: The town's lanes.
        chain: (≥ size,) lanes of the way.
        size: How many.
        u: Place of the box centre on the first lane [m].
        speed: [m/s].
        travelled: (K,) distance without bends [m].
        dt: Between the forecast times [s].
        out: (K,) distance [m].
    """
    out[:] = travelled
    reach, start, is_slowed = u + travelled[-1], 0.0, False
    for k in range(size):
        if start > reach:
            break
        is_slowed = is_slowed or speed * speed * ways.sharpest[chain[k]] > LATERAL
        start += ways.length[chain[k]]
    if not is_slowed:
        return
    count = int(travelled[-1]) + 2
    square = np.full(count, np.inf)  # of the speed at each metre
    at, begun = 0, 0.0
    for i in range(count):
        while at + 1 < size and u + i > begun + ways.length[chain[at]]:
            begun += ways.length[chain[at]]
            at += 1
        first, last = ways.first[chain[at]], ways.first[chain[at] + 1] - 1
        point = min(first + int((u + i - begun) / ways.step[chain[at]] + 0.5), last)
        square[i] = max(LATERAL / max(abs(ways.points[point, 4]), 1e-4), SLOWEST * SLOWEST)
    for i in range(count - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + 2.0 * SLOWING)
    for k in range(1, len(travelled)):
        allowed = math.sqrt(square[min(int(out[k - 1] + 0.5), count - 1)])
        lowest = max(speed - HARDEST * dt, 0.0)
        speed = min((travelled[k] - travelled[k - 1]) / dt, max(allowed, lowest))
        out[k] = out[k - 1] + speed * dt


@kernel
def roll_way(
    ways: Ways,
    chain: NDArray[np.int64],
    size: int,
    u: float,
    nose: float,
    offset: float,
    goal: float,
    drift: float,
    speed: float,
    travelled: Floats,
    times: Floats,
    lights: NDArray[np.uint8],
    runs_red: float,
    out: Floats,
) -> None:
    """Poses along a way from place `u` of its first lane, not beyond a red light that it can stop for.

    Args:
        ways: The town's lanes.
        chain: (≥ size,) lanes of the way.
        size: How many.
        u: Place of the box centre on the first lane [m].
        nose: Place of the front [m].
        offset: To the right of the lane's middle [m].
        goal: Where it goes sideways: 0 back to the middle, which it nears exponentially; else at `drift` [m/s].
        drift: Speed sideways [m/s].
        speed: [m/s].
        travelled: (K,) [m].
        times: (K,) [s].
        lights: States of the town's lights.
        runs_red: Who would have to brake harder for a red light than this runs it [m/s²].
        out: (K, 3) x, y [m], yaw [rad].
    """
    limit, start = math.inf, 0.0
    for k in range(size):
        light = ways.light[chain[k]]
        room = start - nose
        if light >= 0 and room > -0.5 and lights[light] == _RED and speed * speed < 2.0 * runs_red * max(room, 0.3):
            limit = max(room, 0.0)
            break
        start += ways.length[chain[k]]
    at, begun = 0, 0.0
    for k in range(len(travelled)):
        place = u + min(travelled[k], limit)
        while at + 1 < size and place > begun + ways.length[chain[at]]:
            begun += ways.length[chain[at]]
            at += 1
        lane = chain[at]
        first, last = ways.first[lane], ways.first[lane + 1] - ways.first[lane] - 1
        position = min(max((place - begun) / ways.step[lane], 0.0), last - 1e-6)
        row = int(position)
        share = position - row
        a, b = ways.points[first + row], ways.points[first + row + 1]
        heading = a[3] + (b[3] - a[3]) * share
        if goal == 0.0:
            aside = offset * math.exp(-times[k] / 2.0)
        elif goal > 0.0:
            aside = max(min(offset + drift * times[k], goal), offset)
        else:
            aside = min(max(offset - drift * times[k], goal), offset)
        out[k, 0] = a[0] + (b[0] - a[0]) * share - aside * math.sin(heading)
        out[k, 1] = a[1] + (b[1] - a[1]) * share + aside * math.cos(heading)
        out[k, 2] = heading


@kernel
def roll_back(ways: Ways, lane: int, u: float, offset: float, travelled: Floats, out: Floats) -> None:
    """Poses of who drives against a lane's direction, from place `u`, `offset` metres to the right of its middle."""
    begun = 0.0  # metres covered where `lane` ends behind
    for k in range(len(travelled)):
        place = u - (travelled[k] - begun)
        while place < 0.0 and ways.pred_first[lane] < ways.pred_first[lane + 1]:
            begun += u
            lane = ways.pred[ways.pred_first[lane]]
            u = ways.length[lane]
            place = u - (travelled[k] - begun)
        first, last = ways.first[lane], ways.first[lane + 1] - ways.first[lane] - 1
        position = min(max(place / ways.step[lane], 0.0), last - 1e-6)
        row = int(position)
        share = position - row
        a, b = ways.points[first + row], ways.points[first + row + 1]
        heading = a[3] + (b[3] - a[3]) * share
        beyond = min(place, 0.0)
        out[k, 0] = a[0] + (b[0] - a[0]) * share - offset * math.sin(heading) + beyond * math.cos(heading)
        out[k, 1] = a[1] + (b[1] - a[1]) * share + offset * math.cos(heading) + beyond * math.sin(heading)
        out[k, 2] = heading + math.pi
