"""How vehicles answer to their controls: a kinematic bicycle, and sliding while a contact has upset it.

Source: the steering constants of "World on Rails" and the longitudinal fit of PDM-Lite (reference `carla.md` 2.3).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lavsim.kernel import kernel
from lavsim.types import DT

MAX_WHEEL_ANGLE = 0.36848336  # [rad] at full steer
FRONT_LENGTH, REAR_LENGTH = -0.090769015, 1.4178275  # [m] effective, an artefact of the fit
THROTTLE_DEAD_BAND = 0.3
COAST_DECELERATION = 0.6  # [m/s²] engine drag; the fit leaves the speed unchanged, real cars lose 0.3 to 1
VALID_KMH = 80.0  # the fit diverges above

_THROTTLE = (
    0.963873001, 4.37535692e-4, -0.380192912, 1.74950069, 0.0916787414, -0.070546153, -1.05996152e-3, 6.71079346e-4,
)  # fmt: skip
_BRAKE = (
    9.31711370e-3, 0.0820967431, -2.83832427e-3, 5.06587474e-5, -4.90357228e-7, 2.44419284e-9, -4.91381935e-12,
)  # fmt: skip

TYRE_GRIP = 7.0  # [m/s²] lateral deceleration of a sliding car on a dry road
SPIN_GRIP = 5.0  # [rad/s²]
SUBSTEPS = 4

# How a row of the world moves.
DRIVEN = 0  # a vehicle: acceleration and curvature
WALKING = 1  # velocity as commanded
RESTING = 2  # parked cars, props, whoever was knocked down: still unless pushed
GONE = 3  # no longer in the world


@kernel
def throttle_acceleration(speed: float, throttle: float) -> float:
    """Acceleration [m/s²] at forward `speed` [m/s] under `throttle` (0 to 1) without brake."""
    if throttle < THROTTLE_DEAD_BAND:
        return -COAST_DECELERATION
    fast = 3.6 * speed
    u, t = min(fast, VALID_KMH), throttle
    p = _THROTTLE
    after = p[0] * u + p[1] * u * u + p[2] * t + p[3] * t * t + p[4] * u * t + p[5] * u * t * t
    after += p[6] * u * u * t + p[7] * u * u * t * t
    gain = (after - u) / 3.6 / DT
    if fast > VALID_KMH:  # fades to nothing at 180 km/h, so that it stays monotone in speed
        gain *= max(0.0, 1.0 - (fast - VALID_KMH) / 100.0)
    return max(gain, -COAST_DECELERATION)


@kernel
def brake_deceleration(speed: float, brake: float) -> float:
    """Deceleration [m/s²], positive, at `speed` [m/s] under `brake` (0 to 1); linear in the pedal."""
    u = min(3.6 * speed, VALID_KMH)
    after, power = 0.0, 1.0
    for q in _BRAKE:
        power *= u
        after += q * power
    return brake * (u - min(max(after, 0.0), u)) / 3.6 / DT


@kernel
def speed_after(speed: float, throttle: float, brake: float, reverse: bool) -> float:
    """Signed speed [m/s] one tick later; reverse drives backward, and the brake wins over the throttle."""
    direction = -1.0 if reverse else 1.0
    along = direction * speed
    if along < 0.0:  # rolling against the gear: the engine brakes
        return direction * min(0.0, along + (COAST_DECELERATION + brake_deceleration(-along, brake)) * DT)
    if brake > 0.0:
        loss = max(brake_deceleration(along, brake), COAST_DECELERATION)
        return direction * max(0.0, along - loss * DT)
    return direction * max(0.0, along + throttle_acceleration(along, throttle) * DT)


@kernel
def steer_curvature(steer: float) -> float:
    """Curvature of the path [1/m], positive to the right, at `steer` (-1 to 1)."""
    slip = math.atan(REAR_LENGTH / (FRONT_LENGTH + REAR_LENGTH) * math.tan(MAX_WHEEL_ANGLE * steer))
    return math.sin(slip) / REAR_LENGTH


@kernel
def integrate(
    motion: NDArray[np.uint8],
    pose: NDArray[np.float64],
    body: NDArray[np.float64],
    command: NDArray[np.float64],
    rear: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Moves every row by one tick as if nothing were in its way.

    Args:
        motion: (N,) `DRIVEN`, `WALKING`, `RESTING` or `GONE`.
        pose: (N, 3) x, y, yaw.
        body: (N, 3) forward speed, rightward slide [m/s], yaw rate [rad/s]; updated in place.
        command: (N, 2) driven: speed after the tick [m/s] and path curvature [1/m]; walking: velocity x, y [m/s].
        rear: (N,) distance from the reference point to the rear axle of the bicycle [m].
        out: (N, 5) displacement x, y, turn of the tick; velocity x, y after it.
    """
    for i in range(len(motion)):
        x = y = turn = 0.0
        yaw = pose[i, 2]
        if motion[i] == GONE:
            body[i, :] = 0.0
        elif motion[i] == WALKING:
            x, y = command[i, 0] * DT, command[i, 1] * DT
            body[i, 0] = math.sqrt(command[i, 0] ** 2 + command[i, 1] ** 2)
            out[i, 3], out[i, 4] = command[i, 0], command[i, 1]
        elif motion[i] == RESTING or body[i, 1] != 0.0:
            x, y, turn = _slide(body, i, yaw, command[i, 0] if motion[i] == DRIVEN else 0.0)
            out[i, 3], out[i, 4] = x / DT, y / DT
        else:
            after = command[i, 0]
            step = after * DT / SUBSTEPS  # semi-implicit, as the physics engines whose cars were fitted
            bend = step * command[i, 1]
            slip = math.asin(max(-0.9, min(0.9, command[i, 1] * rear[i])))
            for _ in range(SUBSTEPS):
                x += step * math.cos(yaw + 0.5 * bend + slip)
                y += step * math.sin(yaw + 0.5 * bend + slip)
                yaw += bend
            turn = yaw - pose[i, 2]
            body[i, 0], body[i, 2] = after, after * command[i, 1]
            out[i, 3], out[i, 4] = after * math.cos(yaw + slip), after * math.sin(yaw + slip)
        out[i, 0], out[i, 1], out[i, 2] = x, y, turn


@kernel
def _slide(body: NDArray[np.float64], i: int, yaw: float, target: float) -> tuple[float, float, float]:
    """One tick of a body that friction brings back to rolling: displacement x, y and turn."""
    ahead, aside, spin = body[i, 0], body[i, 1], body[i, 2]
    grip = TYRE_GRIP * DT
    ahead = max(target, ahead - grip) if ahead > target else min(target, ahead + grip)
    aside = max(0.0, aside - grip) if aside > 0.0 else min(0.0, aside + grip)
    loss = SPIN_GRIP * DT
    spin = max(0.0, spin - loss) if spin > 0.0 else min(0.0, spin + loss)
    body[i, 0], body[i, 1], body[i, 2] = ahead, aside, spin
    cos, sin = math.cos(yaw), math.sin(yaw)
    return (ahead * cos - aside * sin) * DT, (ahead * sin + aside * cos) * DT, spin * DT
