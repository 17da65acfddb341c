"""From a plan to a control: two PIDs, and what overrules them (paper, appendix; reference `lav.md` 6.2 to 6.4)."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import TIME_STEP, DriveConfig, PidConfig
from lavsim.types import DT, Control
from lavsim.world.dynamics import FULL_STEER_CURVATURE

Floats = NDArray[np.float64]

_STANDS = 0.1  # [m/s]
_CREEP_THROTTLE = 0.4
_FLICKER = 0.5  # [s] that a sure score of the brake network lasts
_DOUBT = 4.0  # [s] to get away in
_CREPT = 2.0  # [m] that a burst of it drives
_BEHIND = 2.0  # [m] others whose first forecast lies that far behind can't be run into
_CRAWLS = 0.5  # [m/s]
_FORGETS = 0.5  # [m] driven that make up for a second of standing
_LEAST_AIM = 3.0  # [m] the wheel is not turned for nearer waypoints
_ALLOWED_GAIN = 0.5  # brakes for a metre per second more than allowed
ALLOWED_SLACK = 0.7  # [m/s] below what is allowed it speeds up no more
_STEP = 0.15  # [m] between waypoints below which a path has no direction
STOP = Control(brake=1.0)


class Pid:
    """P e + I mean(last errors) + D (e - previous e), once a tick."""

    def __init__(self, config: PidConfig) -> None:
        self._config = config
        self._errors: deque[float] = deque([0.0] * config.window, maxlen=config.window)

    def step(self, error: float) -> float:
        """The answer to an error."""
        config, previous = self._config, self._errors[-1]
        self._errors.append(error)
        mean = sum(self._errors) / len(self._errors)
        return config.proportional * error + config.integral * mean + config.derivative * (error - previous)


class Controller:
    """Steers along plans in the planner frame (x right, y backward [m])."""

    def __init__(self, config: DriveConfig) -> None:
        self._config = config
        self._steering, self._speed = Pid(config.steering), Pid(config.speed)

    def follow(self, plan: Floats, speed: float, command: int, allowed: float = math.inf) -> Control:
        """The control that drives a plan.

        Args:
            plan: (T, 2), `TIME_STEP` apart.
            speed: Of the ego [m/s].
            command: 0 to 5.
            allowed: Speed that what lies ahead allows [m/s].
        """
        config = self._config
        if not np.isfinite(plan).all():
            return STOP
        planned = planned_speed(plan) * config.speed_ratio[command]
        wanted = min(planned, max(allowed - ALLOWED_SLACK, 0.0))
        steer = min(max(self._turn(aim_point(plan, config.aim[command])), -1.0), 1.0)
        error = min(max(wanted - speed, 0.0), config.error_clip)
        throttle = min(max(self._speed.step(error), 0.0), config.most_throttle)
        if wanted < config.stop_below:
            return Control(steer=steer, brake=1.0)
        if speed > allowed:
            return Control(steer=steer, brake=min(_ALLOWED_GAIN * (speed - allowed), 1.0))
        if speed > wanted + config.over_speed:
            return Control(steer=steer, brake=min(0.2 * (speed - wanted), 1.0))
        return Control(throttle=throttle if speed < config.speed_cap else 0.0, steer=steer)

    def _turn(self, aim: Floats) -> float:
        """The wheel (-1 to 1, or beyond) for a waypoint (2,) that is steered at.

        The paper's gains answer the angle alone: at 7 m/s that is the arc through the waypoint, at 2 m/s a third of it.
        """
        angle = math.atan2(aim[0], -aim[1])
        if not self._config.pursuit:
            return self._steering.step(angle / (math.pi / 2.0))
        return 2.0 * math.sin(angle) / math.hypot(aim[0], aim[1]) / FULL_STEER_CURVATURE


class StuckCounter:
    """Lets the ego creep when it has stood for long and nobody stands right before it."""

    def __init__(self, config: DriveConfig) -> None:
        self._patience, self._length = round(config.stuck / DT), round(config.creep / DT)
        self._long_patience = round(config.stuck_held / DT)
        self._stood = self._held = self._left = 0

    def step(self, control: Control, speed: float, is_free: bool, is_held: bool = False) -> Control:
        """The control, or one that creeps straight on where that is free.

        Straight on only: plans that come too near to somebody lead beside him, and in a queue between two lanes.

        Args:
            control: What else would be done.
            speed: Of the ego [m/s].
            is_free: Whether nobody is in the way of a burst of creeping.
            is_held: Whether it stands because it is told to, as before a red light: that may last.
        """
        if speed >= _STANDS:
            self._stood = self._held = 0
        self._stood += not is_held and speed < _STANDS
        self._held += is_held and speed < _STANDS
        if self._held >= self._long_patience or (self._stood >= self._patience and not is_held):
            self._left = self._length
        if self._left <= 0 or not is_free:
            return control
        self._left -= 1
        return Control(throttle=max(control.throttle, _CREEP_THROTTLE))


class Caution:
    """The room before walkers, kept for a while: forecasts of who starts to walk come into the way and leave it again.

    Args:
        config: For how long.
    """

    def __init__(self, config: DriveConfig) -> None:
        self._length = round(config.caution / DT)
        self._left, self._room = 0, math.inf

    def step(self, room: float, speed: float) -> float:
        """The room [m] that counts at this tick.

        Args:
            room: Before walkers that are in the way now [m]; infinite if none is.
            speed: Of the ego [m/s].
        """
        self._left -= 1
        self._room = self._room - speed * DT if self._left > 0 else math.inf
        if math.isfinite(room):
            self._left = self._length
        self._room = min(room, max(self._room, 0.0))
        return self._room


class Impatience:
    """How much nearer the ego passes others the longer it stands: boxes err, and one found too near would hold it.

    Args:
        config: How much, and how soon.
    """

    def __init__(self, config: DriveConfig) -> None:
        self._config = config
        self._stood = 0.0  # [s]

    def step(self, speed: float, helps: bool) -> float:
        """What margins are smaller by [m], at this tick.

        Args:
            speed: Of the ego [m/s].
            helps: Whether the smallest margins would free its way; behind a queue they do not.
        """
        config = self._config
        if speed < _CRAWLS:
            self._stood = min(self._stood + helps * DT, config.patience + config.yield_time)
        else:
            self._stood = max(self._stood - speed * DT / _FORGETS, 0.0)
        share = max(self._stood - config.patience, 0.0) / config.yield_time
        return config.most_yield * share


class BrakeHold:
    """Whether the brake network holds the ego.

    A network that has seen experts wait says of most standing frames that they should wait: a false alarm would hold
    for good. Who has stood for a while is held only by what is surer, and for as long as it takes to get away.
    """

    def __init__(self, config: DriveConfig) -> None:
        self._config = config
        self._scores: deque[float] = deque(maxlen=round(_FLICKER / DT))
        self._stood = self._doubting = 0

    def step(self, score: float, speed: float) -> bool:
        """Whether to brake, by the network's score (0 to 1) of this tick."""
        self._scores.append(score)
        self._stood = self._stood + 1 if speed < _STANDS else 0
        self._doubting = round(_DOUBT / DT) if self._stood * DT >= self._config.hold else max(self._doubting - 1, 0)
        if self._doubting:
            return max(self._scores) > self._config.standing_score
        return score > self._config.brake_score


def aim_point(plan: Floats, first: int) -> Floats:
    """(2,) the waypoint that is steered at: `first` or, where that is too near, a later one.

    The direction of a point half a metre ahead is that of its error, and would turn the wheels from lock to lock.
    """
    far = np.hypot(plan[:, 0], plan[:, 1]) >= _LEAST_AIM
    far[: min(first, len(plan) - 1)] = False
    if far.any():
        return np.asarray(plan[int(np.argmax(far))])
    return np.array([plan[-1, 0], min(plan[-1, 1], -_LEAST_AIM)])


def planned_speed(plan: Floats) -> float:
    """Mean speed [m/s] over a plan (T, 2)."""
    steps = np.diff(plan, axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).mean()) / TIME_STEP


def creep_path(steps: int) -> Floats:
    """(T, 2) the way that a burst of creeping drives."""
    return np.stack([np.zeros(steps), -_CREPT * np.arange(1, steps + 1) / steps], axis=1)


def touched(
    plan: Floats,
    others: Floats,
    likelihood: Floats,
    boxes: Floats,
    config: DriveConfig,
    less: float = 0.0,
    front: float = 0.0,
) -> NDArray[np.bool_]:
    """(N, T) whom the ego, on its plan, touches on a likely forecast at the same time, and when.

    Boxes are compared, not centres as in the original: two metres between centres stop the ego beside every parked car,
    and miss the end of a bus.

    Args:
        plan: (T, 2) in the planner frame [m].
        others: (N, B, T, 2) forecasts there.
        likelihood: (N, B) of each.
        boxes: (1 + N, 3) heading now [rad], half length and half width [m], the ego's first.
        config: Margins.
        less: What the margin beside the ego is smaller by [m].
        front: What the margin before the ego is larger by [m].
    """
    if not len(others):
        return np.zeros((0, len(plan)), np.bool_)
    own = _poses(plan, boxes[0, 0])
    poses = _poses(others, boxes[1:, None, 0])
    half = np.broadcast_to(boxes[1:, None, None, 1:], (*poses.shape[:3], 2))
    size = boxes[0, 1:] + config.collision_margin + np.array([0.5 * front, -less])
    middle = 0.5 * front * np.stack([np.sin(own[:, 2]), -np.cos(own[:, 2]), np.zeros(len(own))], axis=1)
    touch = _overlap(own + middle, size, poses, half)
    counts = (likelihood >= config.likely) & (others[:, :, 0, 1] <= _BEHIND)
    return np.asarray((touch & counts[..., None]).any(axis=1))


def _poses(paths: Floats, heading: Floats | float) -> Floats:
    """(…, T, 3) x, y and the unit heading's angle along paths (…, T, 2); who hardly moves keeps its heading."""
    steps = np.diff(paths, axis=-2, prepend=paths[..., :1, :])
    steps[..., 0, :] = steps[..., 1, :]
    along = np.arctan2(steps[..., 0], -steps[..., 1])
    moves = np.hypot(steps[..., 0], steps[..., 1]) > _STEP
    yaw = np.where(moves, along, np.broadcast_to(np.asarray(heading)[..., None], along.shape))
    return np.concatenate([paths, yaw[..., None]], axis=-1)


def _overlap(first: Floats, first_half: Floats, second: Floats, second_half: Floats) -> NDArray[np.bool_]:
    """Whether boxes (…, 3) x, y, yaw with half sizes (…, 2) meet: no axis of either parts them."""
    offset = second[..., :2] - first[..., :2]
    parted = np.zeros(offset.shape[:-1], np.bool_)
    turn = second[..., 2] - first[..., 2]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    for yaw, own, other in ((first[..., 2], first_half, second_half), (second[..., 2], second_half, first_half)):
        ahead = offset[..., 0] * np.sin(yaw) - offset[..., 1] * np.cos(yaw)
        aside = offset[..., 0] * np.cos(yaw) + offset[..., 1] * np.sin(yaw)
        parted |= np.abs(ahead) > own[..., 0] + other[..., 0] * cos + other[..., 1] * sin
        parted |= np.abs(aside) > own[..., 1] + other[..., 0] * sin + other[..., 1] * cos
    return ~parted
