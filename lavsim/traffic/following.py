"""How fast to drive: the leader on the path, obstacles of any kind in it, bends and limits ahead.

Car following is the intelligent driver model (Treiber, Hennecke & Helbing 2000, Phys. Rev. E 62, 1805). Leaders on the
lanes of the path come from the order along each lane; whatever else lies in the path (who crosses or changes lanes,
walkers, props, the ego) from the grid of boxes, point by point.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import atan, cos_sin
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
SAMPLE = 1.5  # [m] between the points of a path that are looked at
_SIDE_MARGIN = 0.35  # [m] kept free on either side
_CREEP_MARGIN = 0.1  # [m] the same for who has come to a stop: where there is room, it squeezes past


@kernel
def idm_acceleration(speed: float, wanted: float, gap: float, closing: float, driver: NDArray[np.float64]) -> float:
    """Acceleration of a driver following a leader [m/s²].

    Args:
        speed: Own speed [m/s].
        wanted: Free-road speed [m/s].
        gap: Bumper to bumper [m]; inf on a free road.
        closing: Own speed minus the leader's [m/s].
        driver: (TRAITS,) see `Fleet.driver`.
    """
    share = speed / max(wanted, 0.1)
    share *= share
    free = max(driver[ACCELERATION] * (1.0 - share * share), -3.0)
    if math.isinf(gap):
        return free
    if gap < 0.3:
        return -HARD_BRAKE
    dynamic = speed * driver[HEADWAY]
    dynamic += speed * closing / (2.0 * math.sqrt(driver[ACCELERATION] * driver[DECELERATION]))
    space = (driver[MIN_GAP] + max(0.0, dynamic)) / gap
    return max(min(free, driver[ACCELERATION]) - driver[ACCELERATION] * space * space, -HARD_BRAKE)


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
            cos, sin = cos_sin(yaw)
            x, y, yaw = x - shift * sin, y + shift * cos, yaw + atan(slope)
            cell = cell_at(grid, x, y)
        if cell >= 0 and grid.head[cell] >= 0:
            gap, other, who = obstacle_at(grid, boxes, row, (x, y, yaw), distance / pace, margin)
            if who >= 0:
                return at - half + gap, other, who
        distance += SAMPLE
    return np.inf, 0.0, -1
