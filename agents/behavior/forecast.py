"""Where others will be in the next seconds: along their lanes where they keep one, straight or turning otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.behavior.memory import ACCELERATION, SPEED, TURN
from agents.behavior.ways import MAX_LANES, MAX_WAYS, Ways, find_ways, roll_back, roll_way, slow_for_bends, ways_of
from lavsim.kernel import kernel
from lavsim.map.town_map import TownMap
from lavsim.types import ActorClass, VehicleLight

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DT = 0.3  # [s] between forecast poses
COUNT = 21  # 0 to 6 s
TIMES: Floats = np.arange(COUNT, dtype=np.float64) * DT
HORIZON = DT * (COUNT - 1)
ON_LANE = 1.3  # [m] off the centre, and …
ALONG_LANE = 0.6  # [rad] off the direction of a lane that a vehicle is taken to follow
WRONG_WAY, OFF_WRONG_LANE = 2.6, 2.0  # [rad], [m]: who drives against a lane, over the line or by it
MOVING = 0.3  # [m/s]
FLAT = 0.3  # [m] things lower than that are driven over
SAME_LEVEL = 3.0  # [m] actors farther apart in z don't meet
DRIFT = 0.4  # [m/s] sideways, away from its lane's middle: it changes lanes
FIRM_DRIFT = 1.2  # [m/s] within junctions
KEEPS_OFF = 6.0  # [s] who would take longer than that to its lane's middle doesn't go there
RUNS_RED = 5.0  # [m/s²] who would have to brake harder than that for a red light doesn't
CHANGES_LAST = 1.5  # [s] for which changes of speed go on, but braking goes on to a stop
LANE_WIDTH = 3.5  # [m] by which who drifts is taken to move over

_WALKER, _PROP = int(ActorClass.WALKER), int(ActorClass.PROP)
_LEFT, _RIGHT = int(VehicleLight.LEFT_BLINKER), int(VehicleLight.RIGHT_BLINKER)


@dataclass
class Forecast:
    """Ways of all others that matter, H of them; one actor may have several.

    Attributes:
        poses: (H, COUNT, 3) x, y [m], yaw [rad] of the box centre.
        half: (H, 2) half length and width [m].
        speed: (H,) now [m/s].
        row: (H,) row of the actor in the readings.
        kind: (H,) `ActorClass`.
    """

    poses: Floats
    half: Floats
    speed: Floats
    row: Ints
    kind: NDArray[np.uint8]

    @cached_property
    def is_prop(self) -> NDArray[np.bool_]:
        """(H,) things that never move."""
        return self.kind == _PROP


class Forecaster:
    """Tells the ways of others on a town's lanes; without a town all move freely."""

    def __init__(self, town: TownMap | None) -> None:
        self._town = town
        self._ways: Ways = ways_of(town)

    def update(self, truth: Mapping[str, Any], memory: Floats, window: Floats) -> Forecast:
        """Forecast of all who can come near the ego's way within the horizon.

        Args:
            truth: The reading.
            memory: (N, 5) what is remembered of its actors.
            window: (S, 2) the ego's way ahead [m].
        """
        xyz, classes, sizes = truth["xyz"], truth["classes"], truth["sizes"]
        rows, moving = _relevant(xyz, classes, sizes, memory, window)
        hits = np.full((len(rows), 4), -1.0)  # lane, u, offset, yaw
        if self._town is not None and len(moving):
            found = self._town.nearest(xyz[rows[moving], :2])
            hits[moving, 0], hits[moving, 1], hits[moving, 2], hits[moving, 3] = (
                found.lane, found.u, found.offset, found.yaw,
            )  # fmt: skip
        count = len(rows) + len(moving) * (MAX_WAYS - 1)
        poses, index = np.empty((count, COUNT, 3)), np.empty(count, np.int64)
        made = _roll_all(
            rows, hits, xyz, truth["yaw"], truth["velocities"], classes, sizes, memory, truth["vehicle_lights"],
            truth["lights"], self._ways, poses, index,
        )  # fmt: skip
        row = rows[index[:made]]
        return Forecast(poses[:made], sizes[row, :2] / 2.0, memory[row, SPEED], row, classes[row])


@kernel
def _relevant(
    xyz: Floats, classes: NDArray[np.uint8], sizes: NDArray[np.float32], memory: Floats, window: Floats
) -> tuple[Ints, Ints]:
    """Rows of those who can come to the box around the way, and which of these are vehicles that move."""
    x0, x1, y0, y1 = math.inf, -math.inf, math.inf, -math.inf
    for k in range(len(window)):
        x0, x1 = min(x0, window[k, 0]), max(x1, window[k, 0])
        y0, y1 = min(y0, window[k, 1]), max(y1, window[k, 1])
    rows, moving = np.empty(len(xyz), np.int64), np.empty(len(xyz), np.int64)
    count, movers = 0, 0
    for k in range(1, len(xyz)):
        if abs(xyz[k, 2] - xyz[0, 2]) >= SAME_LEVEL or (classes[k] == _PROP and sizes[k, 2] <= FLAT):
            continue
        speed = memory[k, SPEED]
        reach = HORIZON * (speed + CHANGES_LAST * max(min(memory[k, ACCELERATION], 1.5), 0.0))
        reach += 0.5 * (sizes[k, 0] + sizes[k, 1]) + 4.0
        x, y = xyz[k, 0], xyz[k, 1]
        if x < x0 - reach or x > x1 + reach or y < y0 - reach or y > y1 + reach:
            continue
        if classes[k] < _WALKER and speed >= MOVING:
            moving[movers] = count
            movers += 1
        rows[count] = k
        count += 1
    return rows[:count], moving[:movers]


@kernel
def _roll_all(
    rows: Ints,
    hits: Floats,
    xyz: Floats,
    yaw: Floats,
    velocities: Floats,
    classes: NDArray[np.uint8],
    sizes: NDArray[np.float32],
    memory: Floats,
    signals: NDArray[np.int32],
    lights: NDArray[np.uint8],
    ways: Ways,
    poses: Floats,
    index: Ints,
) -> int:
    """Fills `poses` and `index` (which of `rows` each belongs to); returns how many."""
    made = 0
    travelled, slowed = np.empty(COUNT), np.empty(COUNT)
    chains, sizes_of = np.empty((MAX_WAYS, MAX_LANES), np.int64), np.empty(MAX_WAYS, np.int64)
    for i in range(len(rows)):
        row = rows[i]
        speed, kind = memory[row, SPEED], classes[row]
        _cover(speed, min(max(memory[row, ACCELERATION], -6.0), 1.5), travelled)
        off = yaw[row] - hits[i, 3]
        off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
        if hits[i, 0] >= 0.0 and abs(off) > WRONG_WAY and abs(hits[i, 2]) < OFF_WRONG_LANE:
            roll_back(ways, int(hits[i, 0]), hits[i, 1], hits[i, 2], travelled, poses[made])
            index[made] = i
            made += 1
            continue
        if hits[i, 0] < 0.0 or abs(hits[i, 2]) > ON_LANE or abs(off) > ALONG_LANE:
            rate = memory[row, TURN] if kind < _WALKER and speed > 1.0 else 0.0
            heading = yaw[row]
            if kind == _WALKER and speed > 0.1:
                heading = math.atan2(velocities[row, 1], velocities[row, 0])
            _roll_free(xyz[row, 0], xyz[row, 1], heading, rate, travelled, poses[made])
            index[made] = i
            made += 1
            continue
        found = find_ways(
            ways, int(hits[i, 0]), signals[row] & _LEFT != 0, signals[row] & _RIGHT != 0, chains, sizes_of
        )
        sideways = speed * math.sin(off)
        offset = hits[i, 2]
        drifts = abs(sideways) > DRIFT and (offset * sideways > 0.0 or abs(offset) < 0.3)
        if ways.junction[int(hits[i, 0])] >= 0:  # lanes that bend are cut a little
            drifts = drifts and abs(sideways) > FIRM_DRIFT and abs(memory[row, TURN]) < abs(off)
        goal = math.copysign(LANE_WIDTH, sideways) if drifts else 0.0
        if not drifts and offset * sideways > -offset * offset / KEEPS_OFF:
            goal = offset  # rides at the edge of its lane and stays there
        for k in range(found):
            nose = hits[i, 1] + 0.5 * sizes[row, 0]
            slow_for_bends(ways, chains[k], sizes_of[k], hits[i, 1], speed, travelled, DT, slowed)
            roll_way(
                ways, chains[k], sizes_of[k], hits[i, 1], nose, offset, goal, max(abs(sideways), 0.5), speed, slowed,
                TIMES, lights, RUNS_RED, poses[made],
            )  # fmt: skip
            index[made] = i
            made += 1
    return made


@kernel
def _cover(speed: float, acceleration: float, travelled: Floats) -> None:
    """Distance [m] at the forecast times: nobody speeds up for long, and who brakes may come to rest."""
    span = CHANGES_LAST
    if acceleration < -0.3:
        span = min(span, -speed / acceleration)
    level = max(speed + acceleration * span, 0.0)
    for k in range(COUNT):
        t = TIMES[k]
        if t <= span:
            travelled[k] = max(speed * t + 0.5 * acceleration * t * t, 0.0)
        else:
            travelled[k] = max(speed * span + 0.5 * acceleration * span * span + level * (t - span), 0.0)


@kernel
def _roll_free(x: float, y: float, yaw: float, rate: float, travelled: Floats, out: Floats) -> None:
    """Constant turn rate for 2 s, then straight."""
    px, py, heading = x, y, yaw
    out[0, 0], out[0, 1], out[0, 2] = px, py, heading
    cos, sin = math.cos(heading), math.sin(heading)
    for k in range(1, len(travelled)):
        step = travelled[k] - travelled[k - 1]
        if rate != 0.0:
            turned = rate * DT if TIMES[k] <= 2.0 else 0.0
            cos, sin = math.cos(heading + 0.5 * turned), math.sin(heading + 0.5 * turned)
            heading += turned
        px += step * cos
        py += step * sin
        out[k, 0], out[k, 1], out[k, 2] = px, py, heading
