"""From a plan to a control: two PIDs, and what overrules them (paper, appendix; reference `lav.md` 6.2 to 6.4)."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import TIME_STEP, DriveConfig, PidConfig
from lavsim.types import DT, Control

Floats = NDArray[np.float64]

_STANDS = 0.1  # [m/s]
_CREEP_THROTTLE = 0.4
_BEHIND = 2.0  # [m] others whose first forecast lies that far behind can't be run into
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

    def follow(self, plan: Floats, speed: float, command: int) -> Control:
        """The control that drives a plan.

        Args:
            plan: (T, 2), `TIME_STEP` apart.
            speed: Of the ego [m/s].
            command: 0 to 5.
        """
        config = self._config
        if not np.isfinite(plan).all():
            return STOP
        wanted = planned_speed(plan) * config.speed_ratio[command]
        aim = plan[min(config.aim[command], len(plan) - 1)]
        angle = math.atan2(aim[0], -aim[1])  # clockwise from straight ahead
        steer = min(max(self._steering.step(angle / (math.pi / 2.0)), -1.0), 1.0)
        error = min(max(wanted - speed, 0.0), config.error_clip)
        throttle = min(max(self._speed.step(error), 0.0), config.most_throttle)
        if wanted < config.stop_below:
            return Control(steer=steer, brake=1.0)
        if speed > wanted + config.over_speed:
            return Control(steer=steer, brake=min(0.2 * (speed - wanted), 1.0))
        return Control(throttle=throttle if speed < config.speed_cap else 0.0, steer=steer)


class StuckCounter:
    """Lets the ego creep when it has stood for long."""

    def __init__(self, config: DriveConfig) -> None:
        self._patience, self._length = round(config.stuck / DT), round(config.creep / DT)
        self._stood = self._left = 0

    def step(self, control: Control, speed: float) -> Control:
        """The control, or a creeping one."""
        self._stood = self._stood + 1 if speed < _STANDS else 0
        if self._stood >= self._patience:
            self._left = self._length
        if self._left <= 0:
            return control
        self._left -= 1
        return Control(throttle=max(control.throttle, _CREEP_THROTTLE), steer=control.steer)


def planned_speed(plan: Floats) -> float:
    """Mean speed [m/s] over a plan (T, 2)."""
    steps = np.diff(plan, axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).mean()) / TIME_STEP


def collides(plan: Floats, others: Floats, likelihood: Floats, config: DriveConfig) -> bool:
    """Whether a plan comes too near a likely forecast at the same time.

    Args:
        plan: (T, 2) in the planner frame [m].
        others: (N, 6, T, 2) forecasts there, by command.
        likelihood: (N, 6) of each.
    """
    if not len(others):
        return False
    gap = np.hypot(*np.moveaxis(others - plan, -1, 0)).min(axis=-1)
    counts = (likelihood >= config.likely) & (others[:, :, 0, 1] <= _BEHIND)
    return bool(np.any(counts & (gap < config.collision_distance)))
