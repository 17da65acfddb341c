"""How fast to drive: the leader on the path, obstacles of any kind in it, bends and limits ahead.

Car following is the improved intelligent driver model (Treiber & Kesting 2013, Traffic Flow Dynamics, 11.3.7). Leaders
on the lanes of the path come from the order along each lane; whatever else lies in the path (who crosses or changes
lanes, walkers, props, the ego) from the grid of boxes, point by point.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import atan, cos, sin
from lavsim.traffic.drivers import (
    ACCELERATION,
    CORNERING,
    DECELERATION,
    HEADWAY,
    MIN_GAP,
    SPEED_FACTOR,
    TOP_SPEED,
)
from lavsim.traffic.fleet import LEAD_IN, PATH_LANES, Fleet, plan_at
from lavsim.traffic.network import SLOWING, Lanes, point_row
from lavsim.traffic.obstacles import Boxes, Grid, cell_at, obstacle_at

HARD_BRAKE = 8.0  # [m/s²]
_EASE_OFF = 3.0  # [m/s²] at most for who is faster than it wants to be
_SLOW_DOWN = 25.0  # [m/s²] for a speed twice the wanted one: 6 % above it a driver brakes as for a bend
_TOUCHING = 0.3  # [m]
_BRAKE_FROM = 0.6  # share of the comfortable deceleration at which a driver begins to brake for a line
SAMPLE = 1.5  # [m] between the points of a path that are looked at
_SIDE_MARGIN = 0.35  # [m] kept free on either side
_CREEP_MARGIN = 0.1  # [m] the same for who has come to a stop: where there is room, it squeezes past


@kernel
def idm_acceleration(speed: float, wanted: float, gap: float, closing: float, driver: NDArray[np.float64]) -> float:
    """Acceleration of a driver following a leader [m/s²]; in equilibrium the gap is the smallest one plus the headway.

    Args:
        speed: Own speed [m/s].
        wanted: Free-road speed [m/s].
        gap: Bumper to bumper [m]; inf on a free road.
        closing: Own speed minus the leader's [m/s].
        driver: (TRAITS,) see `Fleet.driver`.
    """
    most = driver[ACCELERATION]
    share = speed / max(wanted, 0.1)
    share *= share
    free = max(most * (1.0 - share * share), -_EASE_OFF)
    if speed > wanted:
        free = max(-_SLOW_DOWN * (speed / max(wanted, 0.1) - 1.0), -_EASE_OFF)
    if math.isinf(gap):
        return free
    if gap < _TOUCHING:
        return -HARD_BRAKE
    dynamic = speed * driver[HEADWAY] + speed * closing / (2.0 * math.sqrt(most * driver[DECELERATION]))
    z = (driver[MIN_GAP] + max(0.0, dynamic)) / gap
    if z >= 1.0:
        return max(min(free, 0.0) + most * (1.0 - z * z), -HARD_BRAKE)
    if free <= 1e-3:
        return free
    return free * (1.0 - _power(z, 2.0 * most / free))


@kernel
def _power(base: float, exponent: float) -> float:
    """About `base ** exponent` for a base below 1 and an exponent of 2 or more, in plain arithmetic.

    Exact where the exponent is a power of two, linear in between; the C library's power differs between processors.
    """
    value = base * base
    while exponent >= 4.0 and value > 1e-9:
        value *= value
        exponent *= 0.5
    return value + min(0.5 * exponent - 1.0, 1.0) * (value * value - value)


@kernel
def stopping_acceleration(speed: float, free: float, distance: float, driver: NDArray[np.float64]) -> float:
    """Acceleration of a driver that comes to rest after `distance` [m/s²], `free` while there is no need to brake."""
    if distance <= _TOUCHING:
        return min(free, -_EASE_OFF)
    needed = speed * speed / (2.0 * (distance - 0.5 * _TOUCHING))
    share = needed / driver[DECELERATION]
    if share <= _BRAKE_FROM:
        return free
    if share >= 1.0:
        return -min(needed, HARD_BRAKE)
    return free + (share - _BRAKE_FROM) / (1.0 - _BRAKE_FROM) * min(-needed - free, 0.0)


@kernel
def horizon_of(half: float, speed: float) -> float:
    """How far a driver looks along its path, from its centre [m]."""
    return half + 8.0 + 2.0 * speed + speed * speed / 4.0


@kernel
def speed_ahead(lanes: Lanes, fleet: Fleet, i: int, half: float, horizon: float) -> float:
    """The speed that the bends and limits ahead allow vehicle `i` now [m/s]."""
    factor, cornering = fleet.driver[i, SPEED_FACTOR], fleet.driver[i, CORNERING]
    lane = fleet.lane[i]
    limit = lanes.speed_limit[lane] * factor
    allowed = min(limit * limit, lanes.bend[point_row(lanes, lane, fleet.u[i])] * cornering)
    distance = lanes.length[lane] - fleet.u[i]
    for k in range(PATH_LANES):
        lane = fleet.path[i, k]
        if lane < 0 or distance > horizon:
            break
        limit = lanes.speed_limit[lane] * factor
        slack = 2.0 * SLOWING * max(distance - half, 0.0)
        allowed = min(allowed, min(limit * limit, lanes.bend[lanes.first[lane]] * cornering) + slack)
        distance += lanes.length[lane]
    return min(math.sqrt(allowed), fleet.driver[i, TOP_SPEED])


@kernel
def obstacle_ahead(
    lanes: Lanes, fleet: Fleet, boxes: Boxes, grid: Grid, cells: NDArray[np.int32], i: int, speed: float, horizon: float
) -> tuple[float, float, int]:
    """What lies in the path of vehicle `i`: gap [m], speed along the path [m/s] and row; (inf, 0, -1) for nothing.

    Args:
        lanes: The road network.
        fleet: All drivers.
        boxes: All boxes.
        grid: Those that are in the way of a lane, but for vehicles that keep to theirs.
        cells: (P,) cell of each centre point.
        i: The vehicle.
        speed: Its own [m/s].
        horizon: How far to look from its centre [m].
    """
    row = fleet.row[i]
    half = boxes.half[row, 0]
    margin = boxes.half[row, 1] + (_SIDE_MARGIN if speed > 1.0 else _CREEP_MARGIN)
    is_shifted = fleet.plan[i, LEAD_IN] > 0.0
    pace = max(speed, 2.0)
    lane, k = fleet.lane[i], 0
    begin = -fleet.u[i]  # of the lane, from the vehicle's centre along the path
    distance = half
    while distance < horizon:
        while distance - begin > lanes.length[lane]:
            if k == PATH_LANES or fleet.path[i, k] < 0:
                return np.inf, 0.0, -1
            begin += lanes.length[lane]
            lane = fleet.path[i, k]
            k += 1
        p = point_row(lanes, lane, distance - begin)
        cell = cells[p]
        x, y, yaw = lanes.points[p, 0], lanes.points[p, 1], lanes.points[p, 3]
        at = begin + (p - lanes.first[lane]) * lanes.step[lane]
        if is_shifted:
            shift, slope, _bend = plan_at(fleet, i, at)
            x, y, yaw = x - shift * sin(yaw), y + shift * cos(yaw), yaw + atan(slope)
            cell = cell_at(grid, x, y)
        if cell >= 0 and grid.head[cell] >= 0:
            gap, other, who = obstacle_at(grid, boxes, row, (x, y, yaw), distance / pace, margin)
            if who >= 0:
                return at - half + gap, other, who
        distance += SAMPLE
    return np.inf, 0.0, -1
