"""From a wanted path and acceleration to pedals and wheel: the inverse of the vehicle's fitted model."""

from __future__ import annotations

import math

from agents.behavior.path import ReferencePath
from lavsim.kernel import kernel
from lavsim.types import DT, Control
from lavsim.world.dynamics import (
    COAST_DECELERATION,
    FRONT_LENGTH,
    MAX_WHEEL_ANGLE,
    REAR_LENGTH,
    THROTTLE_DEAD_BAND,
    brake_deceleration,
    throttle_acceleration,
)

MAX_THROTTLE = 0.75  # CARLA's usual cap
OFFSET_GAIN = 1.0  # [1/s]
SOFT_SPEED = 2.5  # [m/s] keeps the correction mild at walking pace
STEER_RATE = 0.16  # a tick: full lock takes 0.3 s
JERK = 8.0  # [m/s³] for what was foreseen; emergencies are not smoothed
EMERGENCY = -4.0  # [m/s²]
BACKING_SPEED, BACKING_THROTTLE = 1.2, 0.4  # [m/s]
PULLING_AWAY = 0.6  # [m/s²] at which it starts
RELEASED = -1.5  # [m/s²] the brake comes off at once down to here


class Controller:
    """Holds the last command, to change it smoothly."""

    def __init__(self) -> None:
        self._steer = 0.0
        self._acceleration = 0.0

    def command(
        self,
        path: ReferencePath,
        s: float,
        offset: float,
        yaw: float,
        speed: float,
        acceleration: float,
        is_firm: bool = False,
    ) -> Control:
        """Pedals and wheel for a vehicle at `s` with `offset` to the right of the path [m].

        A wish that is firm is not smoothed, and may take the whole throttle.
        """
        if speed > 0.05 or acceleration > 0.0:  # wheels are not turned at rest
            self._steering(path, s, offset, yaw, speed)
        steer = min(max(self._steer, -1.0), 1.0)
        step = JERK * DT
        if acceleration > EMERGENCY and not is_firm:
            low = min(self._acceleration, 0.0) - step
            high = max(self._acceleration, RELEASED if speed > 0.5 else PULLING_AWAY) + 0.5 * step
            acceleration = min(max(acceleration, low), high)
        self._acceleration = acceleration
        throttle, brake = pedals(speed, acceleration, 1.0 if is_firm else MAX_THROTTLE)
        return Control(throttle=throttle, steer=steer, brake=brake)

    def back(self, speed: float) -> Control:
        """Drives straight back at walking pace; `speed` is negative then [m/s]."""
        self._acceleration = 0.0
        self._steer = 0.0
        return Control(throttle=BACKING_THROTTLE if speed > -BACKING_SPEED else 0.0, reverse=True)

    def _steering(self, path: ReferencePath, s: float, offset: float, yaw: float, speed: float) -> None:
        """Steers the course, not the heading: in the fitted bicycle the slip angle follows the wheel at once.

        The course is set to the path's plus a correction for the offset; the heading then follows with the length
        constant of the rear (1.4 m).
        """
        # No preview: over the tick the course turns on by itself, with the heading.
        course = path.at(path.yaw, s) - math.atan(OFFSET_GAIN * offset / (speed + SOFT_SPEED))
        slip = math.remainder(course - yaw, 2.0 * math.pi)
        limit = math.atan(REAR_LENGTH / (FRONT_LENGTH + REAR_LENGTH) * math.tan(MAX_WHEEL_ANGLE))
        slip = min(max(slip, -limit), limit)
        wheel = math.atan((FRONT_LENGTH + REAR_LENGTH) / REAR_LENGTH * math.tan(slip))
        wanted = wheel / MAX_WHEEL_ANGLE
        self._steer = min(max(wanted, self._steer - STEER_RATE), self._steer + STEER_RATE)


def pedals(speed: float, acceleration: float, most: float = MAX_THROTTLE) -> tuple[float, float]:
    """Throttle and brake that give `acceleration` [m/s²] at `speed` [m/s] in the fitted model."""
    if speed < 0.1 and acceleration <= 0.0:
        return 0.0, 1.0 if acceleration < -1.0 else 0.5
    throttle, brake = _pedals(max(speed, 0.0), acceleration, most)
    return float(throttle), float(brake)


@kernel
def _pedals(speed: float, acceleration: float, most: float) -> tuple[float, float]:
    if acceleration < -COAST_DECELERATION:
        full = brake_deceleration(speed, 1.0)
        return 0.0, min(1.0, -acceleration / max(full, 0.5))
    least = throttle_acceleration(speed, THROTTLE_DEAD_BAND)
    if acceleration < least:
        near_coast = acceleration + COAST_DECELERATION < least - acceleration
        return (0.0, 0.0) if near_coast else (THROTTLE_DEAD_BAND, 0.0)
    low, high = THROTTLE_DEAD_BAND, most
    for _ in range(12):
        middle = 0.5 * (low + high)
        if throttle_acceleration(speed, middle) < acceleration:
            low = middle
        else:
            high = middle
    return high, 0.0
