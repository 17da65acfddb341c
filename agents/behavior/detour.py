"""Passing what stands in the way: when it is an obstacle, on which side there is room, and whether the gap suffices."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.behavior.aside import emergency, keep_right, kept_right, made_way, make_way
from agents.behavior.beside import AGAINST, Neighbours, ground, neighbours
from agents.behavior.forecast import FLAT
from agents.behavior.gaps import is_free
from agents.behavior.hazards import Ego
from agents.behavior.look import Look
from agents.behavior.memory import SPEED, STOOD
from agents.behavior.path import STEP, ReferencePath
from agents.behavior.way import BEND, Shift, Way
from lavsim.map.town_map import TownMap
from lavsim.types import ActorClass, Role, VehicleLight

Floats = NDArray[np.float64]

MAKES_WAY, KEEPS_RIGHT = "makes way", "keeps right"  # what a shift is for that passes nothing
EVERY = 4  # ticks between looks
REACH = 65.0  # [m] at which an obstacle is gone round
BACKING_ROOM = 8.0  # [m] kept free behind it when it drives back
STANDOFF = 10.0  # [m] at which it waits for a gap: nearer, it could not steer past
CLEARANCE = 0.55  # [m] kept from what stands
CLEARANCE_RIDER = 0.9  # [m] from who rides or stands on foot
SLOW = 4.5  # [m/s] riders slower than that are passed
STOOD_LONG = 6.0  # [s] after which a vehicle that stands alone is an obstacle
QUEUE_LASTS = 25.0  # [s] after which a queue of others than the traffic is passed too
QUEUE_GAP = 12.0  # [m] to somebody ahead, in whose queue it then stands
LINE_REACH = 35.0  # [m] before a stop line or a junction vehicles stand for it
JAM = 60.0  # [s] after which one of the traffic is
TIGHTEST = 0.2  # [1/m] bend of the sharpest ramp
RAMP_TIME, RAMP_LEAST, RAMP_MOST = 2.2, 10.0, 32.0  # [s], [m], [m]
PICKED_UP = 6.0  # [m/s] by which it gets faster on its way past
JOINED = 18.0  # [m] between obstacles that are passed in one go
STRAIGHT, BEND_LENGTH = 0.03, 20.0  # [1/m], [m] it passes nothing where the road bends more over that length
GIVING_UP = 3.5  # [m/s²] braking for it
STUCK = 0.75  # patience with which it gives up a pass in which it has come to stand
OUT = 0.35  # of the way aside, up to which it gives up what it began

_FLASHING = int(VehicleLight.LEFT_BLINKER | VehicleLight.RIGHT_BLINKER)
_SPECIAL = int(VehicleLight.SPECIAL1 | VehicleLight.SPECIAL2)


class Obstacle(NamedTuple):
    """What is passed in one go: extent along and across the path [m], and speed along it [m/s]."""

    rear: float
    front: float
    left: float
    right: float
    speed: float
    is_rider: bool


class Detour:
    """Decides on shifts of the way.

    Args:
        way: What is driven.
        town: The town's map; without it nothing is passed.
        lines: Places of stop lines and beginnings of junctions along the way [m].

    Attributes:
        shift: The stretch that is driven beside the path now, or None.
        waits: Place at which it waits for a gap [m along the path, of the front]; inf where it needn't.
        waits_for: Id of the obstacle it waits before.
        eases: Speed at which it comes near something that it is going to pass against traffic [m/s]; inf otherwise.
        backs: Whether it drives back now, because it stands too near to an obstacle to steer round it.
    """

    def __init__(self, way: Way, town: TownMap | None, lines: Sequence[float] = ()) -> None:
        self._way, self._town, self._lines = way, town, np.array(lines, dtype=np.float64)
        self.shift: Shift | None = None
        self.waits = math.inf
        self.waits_for = 0
        self.eases = math.inf
        self.backs = False
        self._kind = ""
        self._tick = 0
        self._look = Look()

    def update(
        self, ego: Ego, truth: Mapping[str, Any], memory: Floats, touched: int, is_faced: bool, patience: float
    ) -> None:
        """Looks at the road every few ticks.

        Args:
            ego: Where the ego is.
            truth: The reading.
            memory: (N, 5) what is remembered of its actors.
            touched: Row of the actor that stands or drives in its way first; -1 if nobody does.
            is_faced: Whether somebody comes towards it on its way.
            patience: 1 at first; falls to 0 while the ego stands for others.
        """
        if self.shift is not None and ego.s > self.shift.end:
            self._end()
        self._tick += 1
        if self._tick % EVERY or self._town is None:
            return
        self.waits, self.eases, self.backs = math.inf, math.inf, False
        sure, long = _obstacles(truth, memory, np.array([touched] if touched >= 0 else [], dtype=np.int64))
        hurries = emergency(truth, memory)
        if self.shift is None and not (np.any(sure | long) or is_faced or hurries >= 0):
            return
        near = neighbours(self._way.base, ego.s, truth)
        if self.shift is not None and self._goes_on(ego, near, truth, memory, hurries, patience):
            return
        if np.any(sure) or (np.any(long) and self._is_alone(touched, near, self._lasts(truth, memory, touched))):
            blocks = np.logical_or(*_obstacles(truth, memory, near.row))
            self._begin(ego, near, blocks, truth, touched, patience)
        if self.shift is None and hurries >= 0:
            made = make_way(ego, near, hurries, partial(self._leads, ego), self._way.limit_at(ego.s))
            self._take(ego, made, MAKES_WAY)
        if self.shift is None and is_faced:
            self._take(ego, keep_right(ego, near, partial(self._leads, ego)), KEEPS_RIGHT)

    def _goes_on(
        self, ego: Ego, near: Neighbours, truth: Mapping[str, Any], memory: Floats, hurries: int, patience: float
    ) -> bool:
        """Whether it stays aside; the shift is fitted to what is there now."""
        shift = self.shift
        assert shift is not None
        if self._kind == MAKES_WAY:
            self._take(ego, made_way(ego, near, hurries, shift, partial(self._leads, ego)), self._kind)
        elif self._kind == KEEPS_RIGHT:
            self._take(ego, kept_right(ego, near, shift, partial(self._leads, ego)), self._kind)
            return False
        elif self._gives_up(ego, near) or (ego.speed < 0.1 and patience < STUCK and ego.s < shift.full):
            self._end()
        else:
            self._prolong(ego, near, np.logical_or(*_obstacles(truth, memory, near.row)), truth)
        return self.shift is not None

    def _take(self, ego: Ego, shift: Shift | None, kind: str) -> None:
        if shift is not None and shift != self.shift:
            self.shift, self._kind = shift, kind
            self._way.take(shift, ego.s)

    def _end(self) -> None:
        self.shift = None
        self._way.clear()

    def _gives_up(self, ego: Ego, near: Neighbours) -> bool:
        """Whether somebody comes after all, and it is still on its lane with room to wait there."""
        shift = self.shift
        assert shift is not None
        if ego.s > shift.begin + OUT * (shift.full - shift.begin):
            return False
        room = shift.full + 0.5 - STANDOFF - ego.s
        if room < 0.0 or ego.speed**2 > 2.0 * GIVING_UP * room:
            return False
        return not self._is_free(ego, shift, self._kind, near, 0.5)

    def _is_alone(self, row: int, near: Neighbours, is_lasting: bool) -> bool:
        """Whether somebody stands for itself: not before a light or a junction, and in no queue unless that lasts."""
        own = np.flatnonzero(near.row == row)
        if not len(own):
            return False
        front = float(near.front[own[0]])
        ahead = (near.rear > front - 1.0) & (near.rear < front + QUEUE_GAP) & (near.left < 1.5) & (near.right > -1.5)
        held = np.any((self._lines > front - 2.0) & (self._lines < front + LINE_REACH))
        return not held and (is_lasting or not np.any(ahead & (np.abs(near.speed) < SLOW)))

    @staticmethod
    def _lasts(truth: Mapping[str, Any], memory: Floats, row: int) -> bool:
        return bool(truth["roles"][row] != Role.TRAFFIC and memory[row, STOOD] > QUEUE_LASTS)

    def _begin(
        self,
        ego: Ego,
        near: Neighbours,
        blocks: NDArray[np.bool_],
        truth: Mapping[str, Any],
        row: int,
        patience: float,
    ) -> None:
        """Goes round the obstacle that begins with `row`, or waits before it."""
        first = int(np.flatnonzero(near.row == row)[0]) if row in near.row else -1
        if first < 0 or near.rear[first] - ego.s > REACH or near.front[first] < ego.s:
            return
        obstacle = _together(near, blocks, first, ego.half_width, truth)
        self._look.note(obstacle.rear, truth, row)
        options, is_tight = [], False
        for offset in _offsets(obstacle, ego.half_width):
            shift = self._plan(ego, obstacle, offset)
            if shift is None:
                is_tight = is_tight or self._passes_from_afar(ego, obstacle, offset)
            elif kind := self._ground(ego, shift):
                options.append((kind == AGAINST, abs(offset), shift, kind))
        if not options:
            self.backs = is_tight and self._backs(ego, obstacle, near)
            return
        for is_against, _size, shift, kind in sorted(options, key=lambda option: option[:2]):
            if self._is_free(ego, shift, kind, near, patience):
                over = 0.5 * (shift.begin + shift.full) - ego.s
                self.eases = self._look.pace(over, ego.speed) if is_against else math.inf
                if math.isinf(self.eases):
                    self._take(ego, shift, kind)
                return
        if obstacle.speed < 0.3:
            self.waits, self.waits_for = obstacle.rear - STANDOFF, int(truth["ids"][row])

    def _passes_from_afar(self, ego: Ego, obstacle: Obstacle, offset: float) -> bool:
        """Whether there would be a way round if it stood farther off."""
        afar = ego._replace(s=min(ego.s, obstacle.rear - ego.half_length - STANDOFF), speed=0.0)
        shift = self._plan(afar, obstacle, offset)
        return shift is not None and self._ground(afar, shift) is not None

    def _backs(self, ego: Ego, obstacle: Obstacle, near: Neighbours) -> bool:
        """Whether it drives back to have room to steer round what it stands before."""
        room = obstacle.rear - ego.s - ego.half_length
        if obstacle.speed > 0.3 or ego.speed > 1.5 or room >= STANDOFF or room < -1.0:
            return False
        back = ego.s - ego.half_length
        behind = (near.left < 1.5) & (near.right > -1.5) & (near.rear < back) & (near.front > back - BACKING_ROOM)
        line = np.any((self._lines > back - STANDOFF) & (self._lines < ego.s))
        return not (behind.any() or line)

    def _prolong(self, ego: Ego, near: Neighbours, blocks: NDArray[np.bool_], truth: Mapping[str, Any]) -> None:
        """Stays aside where there is more to pass."""
        shift = self.shift
        assert shift is not None
        half = ego.half_width + CLEARANCE
        ahead = blocks & (near.front > ego.s - ego.half_length) & (near.rear < shift.end + 2.0)
        ahead &= (near.left < half) & (near.right > -half)
        if not ahead.any():
            return
        obstacle = _joined(near, np.flatnonzero(ahead), truth)
        leave = obstacle.front + ego.half_length + 1.0 + 2.0 * obstacle.speed
        needed = [offset for offset in _offsets(obstacle, ego.half_width) if offset * shift.offset > 0.0]
        offset = max([shift.offset, *needed], key=abs)
        if leave > shift.leave + 0.5 or abs(offset) > abs(shift.offset) + 0.1:
            fall = max(shift.end - shift.leave, _ramp(offset, RAMP_LEAST))
            leave = max(leave, shift.leave)
            self._take(ego, replace(shift, leave=leave, end=leave + fall, offset=offset), self._kind)

    def _plan(self, ego: Ego, obstacle: Obstacle, offset: float) -> Shift | None:
        """The shift that passes `obstacle` on the side of `offset`; None where there is no room to steer."""
        full = obstacle.rear - ego.half_length - 0.5
        if obstacle.speed > 0.3:  # where it is caught up with
            closing = max(ego.wanted - obstacle.speed, 1.0)
            gap = max(full - ego.s, 0.0)
            full += obstacle.speed * max(gap - 12.0, 0.0) / closing
        room = full - ego.s
        least = math.sqrt(BEND * abs(offset) / TIGHTEST)
        if room < least:
            if obstacle.speed < 0.3 or room < 0.5 * least:
                return None
            room = least
            full = ego.s + least
        ramp = min(max(RAMP_TIME * ego.speed, RAMP_LEAST, least), RAMP_MOST, room)
        leave = obstacle.front + ego.half_length + 1.0
        if obstacle.speed > 0.3:
            closing = max(ego.wanted - obstacle.speed, 1.0)
            leave += obstacle.speed * (leave - ego.s) / closing
        fall = max(_ramp(offset, RAMP_LEAST), min(2.0 * min(ego.wanted, ego.speed + PICKED_UP), 20.0))
        return Shift(full - ramp, full, leave, leave + fall, offset)

    def _ground(self, ego: Ego, shift: Shift) -> str | None:
        """The lane a shift leads over; None where it can't."""
        path = self._way.base
        if shift.end > path.end or _bends(path, max(shift.begin, ego.s), shift.end):
            return None
        return self._leads(ego, shift.full, shift.leave, shift.offset)

    def _leads(self, ego: Ego, begin: float, end: float, offset: float) -> str | None:
        """What lies `offset` metres beside a stretch of the path."""
        assert self._town is not None
        return ground(self._way.base, self._town, max(begin - 2.0, 0.0), end + 2.0, offset, ego.half_width)

    def _is_free(self, ego: Ego, shift: Shift, kind: str, near: Neighbours, patience: float) -> bool:
        return is_free(ego, shift, kind, near, self._way.limit_at(ego.s), patience)


def _obstacles(
    truth: Mapping[str, Any], memory: Floats, rows: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of `rows` are to be passed instead of waited for: for sure, and because they have stood for long."""
    kind, role, lights = truth["classes"][rows], truth["roles"][rows], truth["vehicle_lights"][rows]
    speed, stood = memory[rows, SPEED], memory[rows, STOOD]
    stands = (kind <= ActorClass.WALKER) & (speed <= 0.3)
    marked = (role == Role.PROP) | (role == Role.PARKED) | (lights & _FLASHING == _FLASHING) | (lights & _SPECIAL != 0)
    sure = stands & marked
    sure |= (kind == ActorClass.PROP) & (truth["sizes"][rows, 2] > FLAT)
    along = np.cos(truth["yaw"][rows] - truth["yaw"][0]) > 0.8
    rides = (kind == ActorClass.BICYCLE) & (speed > 0.3) & (speed < SLOW)
    sure |= rides & along & (role != Role.TRAFFIC)
    return sure, stands & (stood > np.where(role == Role.TRAFFIC, JAM, STOOD_LONG))


def _together(
    near: Neighbours, blocks: NDArray[np.bool_], first: int, half_width: float, truth: Mapping[str, Any]
) -> Obstacle:
    """`first` with all that blocks the path close behind it."""
    half = half_width + CLEARANCE
    in_way = blocks & (near.left < half) & (near.right > -half)
    in_way[first] = True
    order = np.flatnonzero(in_way & (near.rear >= near.rear[first] - 0.5))
    order = order[np.argsort(near.rear[order], kind="stable")]
    chosen, front = [], near.front[first]
    for k in order.tolist():
        if near.rear[k] > front + JOINED:
            break
        chosen.append(k)
        front = max(front, near.front[k])
    return _joined(near, np.array(chosen), truth)


def _joined(near: Neighbours, chosen: NDArray[np.int64], truth: Mapping[str, Any]) -> Obstacle:
    """All of `chosen` as one."""
    classes = truth["classes"][near.row[chosen]]
    return Obstacle(
        float(near.rear[chosen].min()), float(near.front[chosen].max()), float(near.left[chosen].min()),
        float(near.right[chosen].max()), float(max(near.speed[chosen].max(), 0.0)),
        bool(np.any((classes == ActorClass.BICYCLE) | (classes == ActorClass.WALKER))),
    )  # fmt: skip


def _offsets(obstacle: Obstacle, half_width: float) -> tuple[float, float]:
    """How far aside to pass on the left and on the right."""
    clear = CLEARANCE_RIDER if obstacle.is_rider else CLEARANCE
    return min(obstacle.left - clear - half_width, -0.1), max(obstacle.right + clear + half_width, 0.1)


def _ramp(offset: float, least: float) -> float:
    return max(least, math.sqrt(BEND * abs(offset) / TIGHTEST))


def _bends(path: ReferencePath, begin: float, end: float) -> bool:
    """Whether the road bends there; the route's own lane changes swing out and back."""
    s = np.arange(begin, end, BEND_LENGTH / 4.0)
    ahead, behind = (_sample(path, s + sign * BEND_LENGTH / 2.0) for sign in (1.0, -1.0))
    return bool(np.any(np.abs(path.yaw[ahead] - path.yaw[behind]) > STRAIGHT * BEND_LENGTH))


def _sample(path: ReferencePath, s: Floats) -> NDArray[np.int64]:
    return np.clip(s / STEP, 0, len(path) - 1).astype(np.int64)
