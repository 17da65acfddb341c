"""What every background driver does in a tick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import lean_kernel as kernel
from lavsim.traffic.corridor import Corridor
from lavsim.traffic.drivers import MIN_GAP
from lavsim.traffic.fleet import NOBODY, Fleet, advance, follow_plan
from lavsim.traffic.following import horizon_of, idm_acceleration, obstacle_ahead, speed_ahead
from lavsim.traffic.guests import Guests, greet_guests, track_guests
from lavsim.traffic.junctions import line_ahead
from lavsim.traffic.near import Near, leader_in_lane, survey
from lavsim.traffic.network import Lanes, lane_height
from lavsim.traffic.obstacles import Boxes, Grid
from lavsim.traffic.sorting import Sorting, sort_boxes
from lavsim.traffic.steering import lamps, steer
from lavsim.types import DT

_UPSET_TICKS = 100  # after a contact a driver brakes for 5 s
_LOST = 2.5  # [m] off its way: pushed aside, the driver stays there
_UPSET_BRAKE = 6.0  # [m/s²]
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
        sorting, grid, guests, near: Kept or rebuilt from tick to tick.
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


@kernel
def drive(
    scene: Scene,
    fleet: Fleet,
    tick: int,
    lamps_on: int,
    command: NDArray[np.float64],
    vehicle_lights: NDArray[np.int32],
) -> None:
    """Writes what every background driver does in this tick.

    Args:
        scene: What they see.
        fleet: The drivers; where they are is updated.
        tick: Now.
        lamps_on: `VehicleLight` bits of the weather and the hour.
        command: (N, 2) speed after the tick [m/s] and curvature [1/m]; filled for the fleet's rows.
        vehicle_lights: (N,) `VehicleLight`; filled likewise.
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
    for i in range(len(fleet.row)):
        row = fleet.row[i]
        if row < 0 or not boxes.present[row]:
            continue
        speed = max(boxes.forward[row], 0.0)
        follow_plan(fleet, i, speed * DT)
        upset = scene.touched[row] >= 0 and (tick - scene.touched[row] < _UPSET_TICKS or abs(fleet.offset[i]) > _LOST)
        acceleration = -_UPSET_BRAKE if upset else _decide(scene, fleet, vehicle_lights, i, speed, tick)
        fleet.brake[i] = acceleration
        fleet.still[i] = fleet.still[i] + 1 if speed < _AT_REST else 0
        command[row, 0] = max(0.0, speed + acceleration * DT)
        command[row, 1] = steer(lanes, fleet, boxes, i, speed)
        vehicle_lights[row] = lamps_on | lamps(lanes, fleet, scene.near, i, acceleration, speed)


@kernel
def _decide(scene: Scene, fleet: Fleet, vehicle_lights: NDArray[np.int32], i: int, speed: float, tick: int) -> float:
    """Acceleration of vehicle `i` [m/s²]; notes its gap and for whom it waits."""
    lanes, boxes, near = scene.lanes, scene.boxes, scene.near
    half = boxes.half[fleet.row[i], 0]
    horizon = horizon_of(half, speed)
    allowed = speed_ahead(lanes, fleet, i, half, horizon)
    gap, leader, who = leader_in_lane(lanes, fleet, boxes, near, i, i, horizon)
    reach = min(horizon, half + gap + 2.0)
    ahead, pace, blocker = obstacle_ahead(lanes, fleet, boxes, scene.grid, scene.cells, i, speed, reach)
    driver = fleet.driver[i]
    acceleration = idm_acceleration(speed, allowed, gap, speed - leader, driver)
    fleet.blame[i] = who if gap < 10.0 else NOBODY
    fleet.gap[i] = min(gap, ahead)
    if blocker >= 0:
        behind = idm_acceleration(speed, allowed, ahead, speed - pace, driver)
        if behind < acceleration:
            acceleration = behind
            fleet.blame[i] = blocker
    line, culprit = line_ahead(
        lanes, fleet, scene.guests, boxes, near, scene.lights, vehicle_lights, i, speed, False, tick
    )
    if not math.isinf(line):  # a standing leader behind the line, so that the bumper stops at it
        before = idm_acceleration(speed, allowed, line + driver[MIN_GAP], speed, driver)
        if before < acceleration:
            acceleration = before
            fleet.blame[i] = culprit
    return acceleration
