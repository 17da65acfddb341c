"""Giving way to vehicles on call: to the right edge, slowly, and at rest until they are past; never into a junction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import cos_sin
from lavsim.traffic.fleet import FROM, GONE_ALONG, HOLD, LEAD_IN, LEAD_OUT, TO, Fleet, plan_at, reset_plan
from lavsim.traffic.network import Lanes
from lavsim.traffic.obstacles import Boxes
from lavsim.types import VehicleLight

_ON_CALL = int(VehicleLight.SPECIAL1)
_MOVING = 0.3  # [m/s]
_HEARD = 60.0  # [m] ahead of it
_PAST = 4.0  # [m] that it must be ahead
_ABREAST = 8.0  # [m] to either side of its way
_SAME_WAY = 0.5  # cosine of the angle between the two ways
_CRAWL = 3.0  # [m/s] on the way to the edge
_SWING, _SWING_BACK = 12.0, 15.0  # [m] to the edge and back
_TO_THE_EDGE = 0.1  # [m] left between vehicle and edge
_LEAST = 0.2  # [m] below that there is no room to move aside


@kernel
def note_calls(boxes: Boxes, vehicle_lights: NDArray[np.int32], calls: NDArray[np.int64]) -> None:
    """Fills `calls` with the rows of vehicles on call that move, -1 behind the last."""
    found = 0
    for row in range(len(boxes.present)):
        is_on_call = boxes.present[row] and vehicle_lights[row] & _ON_CALL and not boxes.is_fleet[row]
        if found < len(calls) and is_on_call and boxes.forward[row] > _MOVING:
            calls[found] = row
            found += 1
    for k in range(found, len(calls)):
        calls[k] = -1


@kernel
def must_give_way(fleet: Fleet, boxes: Boxes, calls: NDArray[np.int64], i: int) -> bool:
    """Whether a vehicle on call comes up from behind vehicle `i`, or is beside it."""
    row = fleet.row[i]
    own_cos, own_sin = cos_sin(boxes.pose[row, 2])
    for k in range(len(calls)):
        other = calls[k]
        if other < 0:
            return False
        cos, sin = cos_sin(boxes.pose[other, 2])
        dx, dy = boxes.pose[row, 0] - boxes.pose[other, 0], boxes.pose[row, 1] - boxes.pose[other, 1]
        ahead, aside = dx * cos + dy * sin, dy * cos - dx * sin
        if -_PAST < ahead < _HEARD and abs(aside) < _ABREAST and cos * own_cos + sin * own_sin > _SAME_WAY:
            return True
    return False


@kernel
def give_way(lanes: Lanes, fleet: Fleet, boxes: Boxes, i: int, allowed: float) -> float:
    """Moves vehicle `i` to the right edge of its lane; returns the speed that it may have meanwhile [m/s]."""
    lane = fleet.lane[i]
    if lanes.junction[lane] >= 0:
        return allowed
    edge = 0.5 * lanes.width[lane] - boxes.half[fleet.row[i], 1] - _TO_THE_EDGE
    is_aside = fleet.plan[i, LEAD_IN] > 0.0 and fleet.plan[i, TO] > 0.0
    if fleet.plan[i, LEAD_IN] <= 0.0 and edge > _LEAST:
        fleet.plan[i, FROM], fleet.plan[i, TO] = 0.0, edge
        fleet.plan[i, LEAD_IN], fleet.plan[i, HOLD], fleet.plan[i, LEAD_OUT] = _SWING, np.inf, _SWING_BACK
    elif edge <= _LEAST or (is_aside and fleet.plan[i, GONE_ALONG] >= fleet.plan[i, LEAD_IN]):
        return 0.0
    return min(allowed, _CRAWL)


@kernel
def return_to_lane(fleet: Fleet, i: int) -> None:
    """Leads vehicle `i` back from the edge when nobody is on call any more."""
    if fleet.plan[i, LEAD_IN] > 0.0 and fleet.plan[i, TO] > 0.0 and np.isinf(fleet.plan[i, HOLD]):
        here, _slope, _bend = plan_at(fleet, i, 0.0)
        reset_plan(fleet, i)
        if here > 0.0:
            fleet.plan[i, FROM], fleet.plan[i, TO], fleet.plan[i, LEAD_IN] = here, here, _SWING
            fleet.plan[i, LEAD_OUT] = _SWING_BACK
