"""What every background driver does in a tick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.corridor import Corridor
from lavsim.traffic.crossing import place_to_wait
from lavsim.traffic.deadlock import LOOK_EVERY, find_deadlocks
from lavsim.traffic.fleet import LEAD_IN, NOBODY, Fleet, advance, follow_plan
from lavsim.traffic.following import (
    horizon_of,
    idm_acceleration,
    obstacle_ahead,
    speed_ahead,
    stopping_acceleration,
)
from lavsim.traffic.giving_way import give_way, must_give_way, note_calls, return_to_lane
from lavsim.traffic.guests import Guests, greet_guests, has_stood, track_guests
from lavsim.traffic.junctions import line_ahead
from lavsim.traffic.lane_change import consider_change
from lavsim.traffic.near import Near, leader_in_lane, survey
from lavsim.traffic.network import Lanes, lane_height
from lavsim.traffic.obstacles import Boxes, Grid
from lavsim.traffic.passing import STAND_OFF, consider_passing, stands_in_queue
from lavsim.traffic.sorting import Sorting, sort_boxes
from lavsim.traffic.steering import lamps, steer
from lavsim.types import DT
from lavsim.world.motion import RESTING

_UPSET_TICKS = 100  # after a contact a driver brakes for 5 s
_LOST = 2.5  # [m] off its way: pushed aside, the driver stays there
_UPSET_BRAKE = 6.0  # [m/s²]
_OFF_THE_OLD_LANE = 1.0  # [m] from the new lane's centre
_AT_REST = 0.15  # [m/s]


class Scene(NamedTuple):
    """Everything that drivers see, and the space they work in.

    Attributes:
        lanes: The road network.
        corridor: Where driving lanes are.
        cells: (P,) cell of each centre point in `grid`.
        boxes: Everything that can be hit; heights of the fleet's rows are updated.
        motion: (N,) how each row moves (`lavsim.world.motion`).
        touched: (N,) tick of each row's last contact, -1.
        lights: (L,) `LightState` of the town's lights.
        sorting, grid, guests, near, calls: Kept or rebuilt from tick to tick.
        changes_lanes: Whether drivers change lanes.
    """

    lanes: Lanes
    corridor: Corridor
    cells: NDArray[np.int32]
    boxes: Boxes
    motion: NDArray[np.uint8]
    touched: NDArray[np.int64]
    lights: NDArray[np.uint8]
    sorting: Sorting
    grid: Grid
    guests: Guests
    near: Near
    calls: NDArray[np.int64]
    changes_lanes: bool


@kernel
def drive(
    scene: Scene,
    fleet: Fleet,
    tick: int,
    lamps_on: int,
    command: NDArray[np.float64],
    vehicle_lights: NDArray[np.int32],
) -> int:
    """Writes what every background driver does in this tick.

    Args:
        scene: What they see.
        fleet: The drivers; where they are is updated.
        tick: Now.
        lamps_on: `VehicleLight` bits of the weather and the hour.
        command: (N, 2) speed after the tick [m/s] and curvature [1/m]; filled for the fleet's rows.
        vehicle_lights: (N,) `VehicleLight`; filled likewise.

    Returns:
        The slot of a vehicle that has to be taken out because nothing else helps, -1.
    """
    lanes, boxes = scene.lanes, scene.boxes
    for i in range(len(fleet.row)):
        row = fleet.row[i]
        if row >= 0 and boxes.present[row]:
            fleet.offset[i] = advance(lanes, fleet, i, boxes.pose[row, 0], boxes.pose[row, 1])
            boxes.height[row] = lane_height(lanes, fleet.lane[i], fleet.u[i])
    sort_boxes(lanes, fleet, scene.corridor, boxes, scene.motion, scene.sorting, scene.grid)
    greet_guests(scene.guests, scene.sorting.is_guest)
    track_guests(lanes, scene.guests, boxes)
    survey(lanes, fleet, scene.guests, boxes, scene.near)
    note_calls(boxes, vehicle_lights, scene.calls)
    for i in range(len(fleet.row)):
        row = fleet.row[i]
        if row < 0 or not boxes.present[row]:
            continue
        speed = max(boxes.forward[row], 0.0)
        follow_plan(fleet, i, speed * DT)
        if fleet.aside[i] >= 0 and abs(fleet.offset[i]) < _OFF_THE_OLD_LANE:
            fleet.aside[i] = -1
        upset = scene.touched[row] >= 0 and (tick - scene.touched[row] < _UPSET_TICKS or abs(fleet.offset[i]) > _LOST)
        if upset:
            fleet.brake[i], fleet.blame[i] = -_UPSET_BRAKE, NOBODY
        else:
            _decide(scene, fleet, vehicle_lights, i, speed, tick)
        acceleration = fleet.brake[i]
        fleet.still[i] = fleet.still[i] + 1 if speed < _AT_REST else 0
        command[row, 0] = max(0.0, speed + acceleration * DT)
        command[row, 1] = steer(lanes, fleet, boxes, i, speed)
        vehicle_lights[row] = lamps_on | lamps(lanes, fleet, scene.near, i, acceleration, speed)
    return find_deadlocks(lanes, fleet, scene.sorting.slot, tick) if tick % LOOK_EVERY == 0 else -1


@kernel
def _decide(scene: Scene, fleet: Fleet, vehicle_lights: NDArray[np.int32], i: int, speed: float, tick: int) -> None:
    """Notes what vehicle `i` does next: its acceleration, and for whom it waits."""
    lanes, boxes = scene.lanes, scene.boxes
    half = boxes.half[fleet.row[i], 0]
    horizon = horizon_of(half, speed)
    allowed = speed_ahead(lanes, fleet, i, half, horizon)
    gives_way = scene.calls[0] >= 0 and must_give_way(fleet, boxes, scene.calls, i)
    if gives_way:
        allowed = give_way(lanes, fleet, boxes, i, allowed)
    else:
        return_to_lane(fleet, i)
    free = idm_acceleration(speed, allowed, np.inf, 0.0, fleet.driver[i])
    fleet.brake[i], fleet.blame[i] = free, NOBODY
    gap = _follow(scene, fleet, i, i, speed, allowed, horizon)
    if fleet.aside[i] >= 0 and scene.near.lane[len(fleet.row) + i] == fleet.aside[i]:
        gap = min(gap, _follow(scene, fleet, i, len(fleet.row) + i, speed, allowed, horizon))
    reach = min(horizon, half + gap + 2.0)
    is_blocked = _keep_off(scene, fleet, i, speed, allowed, free, reach, tick)
    if scene.changes_lanes or is_blocked:  # 2.x's traffic changes lanes only round what stands in its way
        consider_change(
            lanes, fleet, boxes, scene.near, scene.sorting.slot, i, allowed, fleet.brake[i], is_blocked, gives_way, tick
        )
    line, culprit = place_to_wait(lanes, fleet, boxes, scene.near, i)
    _stop_at(fleet, i, speed, free, line, culprit)
    line, culprit = line_ahead(
        lanes, fleet, scene.guests, boxes, scene.near, scene.lights, vehicle_lights, i, speed, gives_way, tick
    )
    _stop_at(fleet, i, speed, free, line, culprit)


@kernel
def _follow(scene: Scene, fleet: Fleet, i: int, entry: int, speed: float, allowed: float, horizon: float) -> float:
    """Follows the leader from `entry` on; returns the gap to it [m]."""
    gap, pace, who = leader_in_lane(scene.lanes, fleet, scene.boxes, scene.near, i, entry, horizon)
    if who >= 0:
        _brake_for(fleet, i, idm_acceleration(speed, allowed, gap, speed - pace, fleet.driver[i]), who)
    return gap


@kernel
def _keep_off(
    scene: Scene, fleet: Fleet, i: int, speed: float, allowed: float, free: float, reach: float, tick: int
) -> bool:
    """Keeps off what lies in the path within `reach`; returns whether that stands there and will not move."""
    gap, pace, who = obstacle_ahead(scene.lanes, fleet, scene.boxes, scene.grid, scene.cells, i, speed, reach)
    if who < 0:
        return False
    _brake_for(fleet, i, idm_acceleration(speed, allowed, gap, speed - pace, fleet.driver[i]), who)
    stands = scene.motion[who] == RESTING or (
        has_stood(scene.guests, who) and not stands_in_queue(scene.lanes, scene.guests, scene.boxes, scene.near, who)
    )
    if not stands or scene.lanes.junction[fleet.lane[i]] >= 0:
        return False
    if fleet.plan[i, LEAD_IN] <= 0.0:
        _stop_at(fleet, i, speed, free, gap - STAND_OFF, who)
        consider_passing(scene.lanes, fleet, scene.boxes, scene.grid, scene.near, i, gap, tick)
    return True


@kernel
def _stop_at(fleet: Fleet, i: int, speed: float, free: float, distance: float, culprit: int) -> None:
    if not math.isinf(distance):
        _brake_for(fleet, i, stopping_acceleration(speed, free, distance, fleet.driver[i]), culprit)


@kernel
def _brake_for(fleet: Fleet, i: int, acceleration: float, culprit: int) -> None:
    """Takes `acceleration` if it is the least so far; `culprit` is to blame then, once it holds the vehicle up."""
    if acceleration < fleet.brake[i]:
        fleet.brake[i] = acceleration
        fleet.blame[i] = culprit
