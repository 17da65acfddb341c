"""The background vehicles as arrays: where each is on its way, and what its driver has in mind."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.kernel_draws import draw_at, draw_base
from lavsim.portable_math import cos_sin
from lavsim.traffic.drivers import TRAITS
from lavsim.traffic.network import Lanes, lane_point

PATH_LANES = 10  # lanes ahead that a driver has decided on

# Columns of `Fleet.plan`.
GONE_ALONG, FROM, TO, LEAD_IN, HOLD, LEAD_OUT = range(6)

_BESIDE = 1.0  # [m] between the edges of lanes that begin side by side

NOBODY, RED_LIGHT = -1, -2  # values of `Fleet.blame` beside the rows of the world


class Fleet(NamedTuple):
    """All background vehicles, one slot each.

    Attributes:
        row: (V,) row in the world, -1 for a free slot.
        key: (V,) key of the stream that chooses branches.
        lane: (V,) current lane.
        u: (V,) travelled length of it [m].
        offset: (V,) from the lane's centre to the right [m].
        path: (V, PATH_LANES) lanes to come, -1 beyond the end of the road.
        hops: (V,) branches drawn so far.
        driver: (V, TRAITS) fields of `Driver`.
        committed: (V,) junction lane that the driver has decided to enter, -1.
        halted: (V,) junction lane before whose stop sign it has stood, -1.
        plan: (V, 6) a move aside: metres of it driven, offset at its start, offset it leads to [m], metres that
            takes (0: no plan), metres after which it leads back (inf: never), metres that takes.
        aside: (V,) lane that it is leaving, -1.
        changed: (V,) tick of the last lane change.
        still: (V,) ticks at rest.
        stuck: (V,) ticks at rest without a red light to blame, as `deadlock` counts them.
        blame: (V,) row of the world for which it waits, `NOBODY` or `RED_LIGHT`.
        granted: (V,) tick up to which it need not wait for others at its next junction.
        gap: (V,) to its leader in the last tick [m].
        brake: (V,) acceleration of the last tick [m/s²].
    """

    row: NDArray[np.int64]
    key: NDArray[np.uint64]
    lane: NDArray[np.int32]
    u: NDArray[np.float64]
    offset: NDArray[np.float64]
    path: NDArray[np.int32]
    hops: NDArray[np.int64]
    driver: NDArray[np.float64]
    committed: NDArray[np.int32]
    halted: NDArray[np.int32]
    plan: NDArray[np.float64]
    aside: NDArray[np.int32]
    changed: NDArray[np.int64]
    still: NDArray[np.int64]
    stuck: NDArray[np.int64]
    blame: NDArray[np.int64]
    granted: NDArray[np.int64]
    gap: NDArray[np.float64]
    brake: NDArray[np.float64]


def make_fleet(count: int) -> Fleet:
    """Free slots for `count` vehicles."""
    return Fleet(
        row=np.full(count, -1, np.int64),
        key=np.zeros(count, np.uint64),
        lane=np.zeros(count, np.int32),
        u=np.zeros(count),
        offset=np.zeros(count),
        path=np.full((count, PATH_LANES), -1, np.int32),
        hops=np.zeros(count, np.int64),
        driver=np.zeros((count, TRAITS)),
        committed=np.full(count, -1, np.int32),
        halted=np.full(count, -1, np.int32),
        plan=np.zeros((count, 6)),
        aside=np.full(count, -1, np.int32),
        changed=np.full(count, -10_000, np.int64),
        still=np.zeros(count, np.int64),
        stuck=np.zeros(count, np.int64),
        blame=np.full(count, NOBODY, np.int64),
        granted=np.full(count, -1, np.int64),
        gap=np.full(count, np.inf),
        brake=np.zeros(count),
    )


def clear_slot(fleet: Fleet, slot: int) -> None:
    """Sets a slot back to that of a vehicle that has just appeared."""
    for name, blank in make_fleet(1)._asdict().items():
        getattr(fleet, name)[slot] = blank[0]


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
def advance(lanes: Lanes, fleet: Fleet, i: int, x: float, y: float) -> float:
    """Finds where vehicle `i` is along its path; returns its offset to the right of the lane centre [m]."""
    offset = 0.0
    for _ in range(2):
        px, py, yaw, _curvature = lane_point(lanes, fleet.lane[i], fleet.u[i])
        dx, dy = x - px, y - py
        cos, sin = cos_sin(yaw)
        fleet.u[i] += dx * cos + dy * sin
        offset = dy * cos - dx * sin
        while fleet.u[i] >= lanes.length[fleet.lane[i]] and fleet.path[i, 0] >= 0:
            if lanes.junction[fleet.lane[i]] >= 0:
                fleet.halted[i] = -1
            fleet.u[i] -= lanes.length[fleet.lane[i]]
            fleet.lane[i] = fleet.path[i, 0]
            for k in range(PATH_LANES - 1):
                fleet.path[i, k] = fleet.path[i, k + 1]
            fleet.path[i, PATH_LANES - 1] = -1
            fleet.aside[i] = _goes_on_beside(lanes, fleet.aside[i], fleet.lane[i])
            extend_path(lanes, fleet, i)
        fleet.u[i] = max(fleet.u[i], 0.0)
    return offset


@kernel
def _goes_on_beside(lanes: Lanes, aside: int, lane: int) -> int:
    """The lane after `aside` that begins beside `lane`, outside junctions; -1 for none."""
    if aside < 0 or lanes.junction[lane] >= 0:
        return -1
    for s in range(lanes.succ_first[aside], lanes.succ_first[aside + 1]):
        other = lanes.succ[s]
        dx = lanes.points[lanes.first[other], 0] - lanes.points[lanes.first[lane], 0]
        dy = lanes.points[lanes.first[other], 1] - lanes.points[lanes.first[lane], 1]
        reach = 0.5 * (lanes.width[lane] + lanes.width[other]) + _BESIDE
        if other != lane and lanes.junction[other] < 0 and dx * dx + dy * dy < reach * reach:
            return other
    return -1


@kernel
def turn_into(lanes: Lanes, fleet: Fleet, i: int, lane: int, u: float) -> None:
    """Puts vehicle `i` on another lane at `u`, with a new way from there."""
    fleet.lane[i] = lane
    fleet.u[i] = u
    fleet.path[i, :] = -1
    fleet.committed[i] = -1
    extend_path(lanes, fleet, i)


@kernel
def reset_plan(fleet: Fleet, i: int) -> None:
    """Ends what is left of a move aside."""
    fleet.plan[i, :] = 0.0
    fleet.aside[i] = -1


@kernel
def _ease(share: float) -> tuple[float, float, float]:
    """The quintic from 0 to 1 with no speed and no acceleration at its ends, and its two derivatives."""
    t = min(max(share, 0.0), 1.0)
    return (
        t * t * t * (10.0 - 15.0 * t + 6.0 * t * t),
        30.0 * t * t * (1.0 - t) ** 2,
        60.0 * t * (1.0 - t) * (1.0 - 2.0 * t),
    )


@kernel
def plan_at(fleet: Fleet, i: int, ahead: float) -> tuple[float, float, float]:
    """Offset that vehicle `i` means to have `ahead` metres from here [m], its slope and its curvature [1/m]."""
    length = fleet.plan[i, LEAD_IN]
    if length <= 0.0:
        return 0.0, 0.0, 0.0
    s = fleet.plan[i, GONE_ALONG] + ahead
    begin, end = fleet.plan[i, FROM], fleet.plan[i, TO]
    if s > fleet.plan[i, HOLD]:
        s -= fleet.plan[i, HOLD]
        length, begin, end = fleet.plan[i, LEAD_OUT], end, 0.0
    value, slope, bend = _ease(s / length)
    return begin + (end - begin) * value, (end - begin) * slope / length, (end - begin) * bend / length**2


@kernel
def follow_plan(fleet: Fleet, i: int, distance: float) -> None:
    """Moves the plan of vehicle `i` on by what it has driven; a plan that led back to the centre ends."""
    if fleet.plan[i, LEAD_IN] <= 0.0:
        return
    fleet.plan[i, GONE_ALONG] += distance
    s = fleet.plan[i, GONE_ALONG]
    if fleet.plan[i, TO] == 0.0:
        if s >= fleet.plan[i, LEAD_IN]:
            reset_plan(fleet, i)
    elif s >= fleet.plan[i, HOLD] + fleet.plan[i, LEAD_OUT]:
        reset_plan(fleet, i)
