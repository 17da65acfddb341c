"""How a driver steers along its lane or beside it, and what its lamps say."""

from __future__ import annotations

import math

from lavsim.kernel import lean_kernel as kernel
from lavsim.portable_math import asin, atan
from lavsim.traffic.fleet import FROM, GONE_ALONG, HOLD, LEAD_IN, TO, Fleet, plan_at
from lavsim.traffic.near import Near
from lavsim.traffic.network import Lanes, lane_point
from lavsim.traffic.obstacles import Boxes
from lavsim.types import RoadOption, VehicleLight

_STEER_LENGTH = 4.0  # [m] over which an error of position fades
_STEER_TIME = 0.35  # [s] the same at speed
_MOST_BEND = 0.36  # [1/m] the tightest turns of towns have radii of 3 m
_LEFT, _RIGHT = int(RoadOption.LEFT), int(RoadOption.RIGHT)
_BRAKE_LIGHT, _LEFT_BLINKER, _RIGHT_BLINKER = (
    int(VehicleLight.BRAKE),
    int(VehicleLight.LEFT_BLINKER),
    int(VehicleLight.RIGHT_BLINKER),
)


@kernel
def steer(lanes: Lanes, fleet: Fleet, boxes: Boxes, i: int, speed: float) -> float:
    """Curvature that brings vehicle `i` to where it means to be beside its lane's centre, critically damped."""
    row = fleet.row[i]
    _x, _y, yaw, curvature = lane_point(lanes, fleet.lane[i], fleet.u[i])
    shift, slope, bend = plan_at(fleet, i, 0.0)
    curvature += bend
    rear = 0.58 * boxes.half[row, 0]  # as World: rear axle behind the centre
    slip = asin(max(-0.9, min(0.9, curvature * rear)))
    error = boxes.pose[row, 2] + slip - yaw - atan(slope)
    error -= 2.0 * math.pi * math.floor(error / (2.0 * math.pi) + 0.5)
    reach = max(_STEER_LENGTH, _STEER_TIME * speed)
    bend = curvature - (fleet.offset[i] - shift) / reach**2 - 2.0 * error / reach
    return max(-_MOST_BEND, min(_MOST_BEND, bend))


@kernel
def lamps(lanes: Lanes, fleet: Fleet, near: Near, i: int, acceleration: float, speed: float) -> int:
    """Brake light and indicators of vehicle `i`."""
    bits = _BRAKE_LIGHT if acceleration < -0.5 or (speed < 0.1 and acceleration <= 0.1) else 0
    if fleet.plan[i, LEAD_IN] > 0.0:
        aim = fleet.plan[i, TO] - fleet.plan[i, FROM]
        if fleet.plan[i, GONE_ALONG] > fleet.plan[i, HOLD]:
            aim = -fleet.plan[i, TO]
        return bits | (_LEFT_BLINKER if aim < 0.0 else _RIGHT_BLINKER)
    if near.target[i] >= 0:
        turn = lanes.turn[near.target[i]]
        bits |= _LEFT_BLINKER if turn == _LEFT else _RIGHT_BLINKER if turn == _RIGHT else 0
    return bits
