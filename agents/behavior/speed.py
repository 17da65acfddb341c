"""How fast to go: a profile along the path, and the accelerations that keep distances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.behavior.path import STEP, ReferencePath

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Manner:
    """How the expert drives.

    Attributes:
        limit_share: Part of the speed limit it drives at.
        top_speed: Never faster [m/s].
        lateral: Largest lateral acceleration in bends [m/s²].
        comfort_braking: Deceleration of foreseeable braking [m/s²].
        acceleration: Largest acceleration [m/s²].
        headway: Time gap to a leader [s].
        standstill: Gap to a standing leader [m].
    """

    limit_share: float = 0.88
    top_speed: float = 45.0 / 3.6
    lateral: float = 2.2
    comfort_braking: float = 2.0
    acceleration: float = 2.0
    headway: float = 1.3
    standstill: float = 2.5


def speed_profile(path: ReferencePath, limits: Floats, manner: Manner) -> Floats:
    """Highest speed (S,) [m/s] along `path` from which every bend ahead is still reached by comfortable braking."""
    bend = np.sqrt(manner.lateral / np.maximum(np.abs(path.curvature), 1e-4))
    speed = np.minimum(np.minimum(limits * manner.limit_share, manner.top_speed), bend)
    square = speed**2
    # v² may fall by 2 b ds a step: the lowest of all v²(s') + 2 b (s' - s) ahead, as one running minimum.
    slope = 2.0 * manner.comfort_braking * STEP * np.arange(len(square))
    return np.sqrt(np.minimum.accumulate((square + slope)[::-1])[::-1] - slope)


def towards(speed: float, target: float, slope: float, manner: Manner) -> float:
    """Acceleration [m/s²] from `speed` to the profile's `target`, which itself changes by `slope` [m/s²]."""
    wanted = slope + (target - speed) / 0.6
    return min(
        max(wanted, -3.5), manner.acceleration * min(1.0, 0.35 + (target - speed) / 2.0) if target > speed else wanted
    )


def following(speed: float, gap: float, leader: float, desired: float, manner: Manner) -> float:
    """Acceleration [m/s²] behind a vehicle `gap` [m] ahead at speed `leader` [m/s].

    Source: Treiber, Hennecke & Helbing 2000, Phys. Rev. E 62, 1805; harder braking where that alone would not do.
    """
    free = gap - 0.3
    if free <= 0.0:
        return -12.0
    a, b = manner.acceleration, manner.comfort_braking
    closing = speed - leader
    wanted = manner.standstill + max(0.0, speed * manner.headway + speed * closing / (2.0 * math.sqrt(a * b)))
    result = a * (1.0 - (speed / max(desired, 0.5)) ** 4 - (wanted / gap) ** 2)
    if closing > 0.0:
        needed = closing * closing / (2.0 * max(gap - 1.0, 0.2))
        if needed > 3.5:
            result = min(result, -1.2 * needed)
    return max(result, -12.0)


def merging(speed: float, ahead: Floats, times: Floats, leader: float) -> float:
    """Acceleration [m/s²] that leaves room for somebody who comes into the way later.

    Args:
        speed: Own speed [m/s].
        ahead: (K,) how far the ego may be before it would touch the other at `times` [m].
        times: (K,) [s], > 0.
        leader: Speed of the other along the way [m/s].
    """
    lowest = math.inf
    for room, time in zip((ahead - 1.5 - 0.6 * leader).tolist(), times.tolist(), strict=True):
        if room <= 0.3:
            wanted = -8.0 if time < 1.5 else -2.5
        else:
            wanted = 2.0 * (room - speed * time) / time**2
            if speed + wanted * time < 0.0:
                wanted = -speed * speed / (2.0 * room)
        lowest = min(lowest, wanted)
    return max(lowest, -8.0)


def stopping(speed: float, distance: float, manner: Manner) -> float:
    """Acceleration [m/s²] that brings the vehicle to rest within `distance` [m]; large where there is time."""
    if distance <= 0.15:
        return -12.0 if speed > 1.0 else -3.0
    needed = speed * speed / (2.0 * distance)
    if needed > 3.5:
        return max(-1.15 * needed, -12.0)
    wanted = 0.25 * speed + speed * speed / (2.0 * manner.comfort_braking)
    if wanted < 0.8 * distance:
        # Far enough: free to approach, at a speed from which the rest is a comfortable stop.
        allowed = math.sqrt(2.0 * manner.comfort_braking * max(distance - 0.25 * speed, 0.05))
        return min((allowed - speed) / 0.8, manner.acceleration)
    return -needed * (wanted / distance) ** 0.5


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
