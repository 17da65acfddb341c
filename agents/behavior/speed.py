"""How fast to go: a profile along the path, and the accelerations that keep distances."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.behavior.manner import Manner, Pace
from agents.behavior.path import STEP, ReferencePath
from lavsim.kernel import kernel

Floats = NDArray[np.float64]


def speed_profile(path: ReferencePath, limits: Floats, manner: Manner) -> Floats:
    """Highest speed (S,) [m/s] along `path` from which every bend ahead is still reached by comfortable braking."""
    bend = np.sqrt(manner.lateral / np.maximum(np.abs(path.curvature), 1e-4))
    allowed = np.maximum(limits * manner.limit_share - manner.limit_gap, 0.5 * limits)
    square = np.minimum(np.minimum(allowed, manner.top_speed), bend) ** 2
    # v² may fall by 2 b ds a step: the lowest of all v²(s') + 2 b (s' - s) ahead, as one running minimum.
    slope = 2.0 * manner.comfort_braking * STEP * np.arange(len(square))
    return np.sqrt(np.minimum.accumulate((square + slope)[::-1])[::-1] - slope)


def time_along(profile: Floats, s: float, distance: float, speed: float, acceleration: float) -> float:
    """Seconds to drive `distance` [m] on from place `s`, accelerating from `speed` up to what the profile allows."""
    allowed = profile[max(int(s / STEP), 0) :][: max(math.ceil(distance / STEP), 1)]
    gained = np.sqrt(speed**2 + 2.0 * acceleration * STEP * (np.arange(len(allowed)) + 0.5))
    return float(np.sum(STEP / np.maximum(np.minimum(allowed, gained), 0.1)))


def towards(speed: float, target: float, slope: float, manner: Manner) -> float:
    """Acceleration [m/s²] from `speed` to the profile's `target`, which itself changes by `slope` [m/s²]."""
    wanted = slope + (target - speed) / 0.6
    if target > speed:
        return min(max(wanted, -3.5), manner.acceleration * min(1.0, 0.35 + (target - speed) / 2.0))
    return max(wanted, -3.5)


def following(speed: float, gap: float, leader: float, desired: float, manner: Manner) -> float:
    """Acceleration [m/s²] behind a vehicle `gap` [m] ahead at speed `leader` [m/s], see `follow`."""
    return float(follow(speed, gap, leader, desired, manner.pace))


def stopping(speed: float, distance: float, manner: Manner) -> float:
    """Acceleration [m/s²] that brings the vehicle to rest within `distance` [m]; large where there is time."""
    return float(stop_within(speed, distance, manner.pace))


@kernel
def follow(speed: float, gap: float, leader: float, desired: float, pace: Pace) -> float:
    """Acceleration [m/s²] behind a vehicle `gap` [m] ahead at speed `leader` [m/s].

    Source: Treiber, Hennecke & Helbing 2000, Phys. Rev. E 62, 1805; harder braking where that alone would not do.
    """
    if gap - 0.3 <= 0.0:
        return -12.0
    a, b = pace.acceleration, pace.comfort_braking
    closing = speed - leader
    wanted = pace.standstill + max(0.0, speed * pace.headway + speed * closing / (2.0 * math.sqrt(a * b)))
    result = a * (1.0 - (speed / max(desired, 0.5)) ** 4 - (wanted / gap) ** 2)
    if closing > 0.0:
        needed = closing * closing / (2.0 * max(gap - 1.0, 0.2))
        if needed > 3.5:
            result = min(result, -1.2 * needed)
    return max(result, -12.0)


@kernel
def merge(speed: float, room: float, time: float) -> float:
    """Acceleration [m/s²] that leaves room for somebody who comes into the way later.

    Args:
        speed: Own speed [m/s].
        room: How far the ego may be at `time` [m].
        time: [s], > 0.
    """
    if room <= 0.3:
        return -8.0 if time < 1.5 else -2.5
    wanted = 2.0 * (room - speed * time) / time**2
    if speed + wanted * time < 0.0:
        wanted = -speed * speed / (2.0 * room)
    return max(wanted, -8.0)


@kernel
def stop_within(speed: float, distance: float, pace: Pace) -> float:
    """Acceleration [m/s²] that brings the vehicle to rest within `distance` [m]; large where there is time."""
    if distance <= 0.15:
        return -12.0 if speed > 1.0 else -3.0
    needed = speed * speed / (2.0 * distance)
    if needed > 3.5:
        return max(-1.15 * needed, -12.0)
    wanted = 0.25 * speed + speed * speed / (2.0 * pace.comfort_braking)
    if wanted < 0.8 * distance:
        # Far enough: free to approach, at a speed from which the rest is a comfortable stop.
        allowed = math.sqrt(2.0 * pace.comfort_braking * max(distance - 0.25 * speed, 0.05))
        return min((allowed - speed) / 0.8, pace.acceleration)
    return -needed * (wanted / distance) ** 0.5


@kernel
def time_to_cover(distance: float, speed: float, acceleration: float, top: float) -> float:
    """Seconds to drive `distance` [m] from `speed`, accelerating up to `top`; inf if never."""
    if distance <= 0.0:
        return 0.0
    top = max(top, speed, 0.1)
    if acceleration <= 0.05:
        return distance / speed if speed > 0.3 else math.inf
    ramp = (top * top - speed * speed) / (2.0 * acceleration)
    if distance <= ramp:
        return (math.sqrt(speed * speed + 2.0 * acceleration * distance) - speed) / acceleration
    return (top - speed) / acceleration + (distance - ramp) / top
