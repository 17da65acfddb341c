"""How vehicles answer to their controls: a fitted kinematic bicycle, scaled by class.

Source: the steering constants of "World on Rails" and the longitudinal fit of PDM-Lite (reference `carla.md` 2.3), both
of the Lincoln MKZ. The other classes are scaled from it; their numbers are ours, within the bounds given there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lavsim.kernel import kernel
from lavsim.portable_math import atan, sin, tan
from lavsim.types import DT, ActorClass
from lavsim.world.weather import Weather

MAX_WHEEL_ANGLE = 0.36848336  # [rad] at full steer
FRONT_LENGTH, REAR_LENGTH = -0.090769015, 1.4178275  # [m] effective, an artefact of the fit
FULL_STEER_CURVATURE = 0.26897079  # [1/m] of the fit
THROTTLE_DEAD_BAND = 0.3
COAST_DECELERATION = 0.6  # [m/s²] engine drag; the fit leaves the speed unchanged, real cars lose 0.3 to 1
VALID_KMH = 80.0  # the fit diverges above
REVERSE_TOP_SPEED = 12.0  # [m/s]

_THROTTLE = (
    0.963873001, 4.37535692e-4, -0.380192912, 1.74950069, 0.0916787414, -0.070546153, -1.05996152e-3, 6.71079346e-4,
)  # fmt: skip
_BRAKE = (
    9.31711370e-3, 0.0820967431, -2.83832427e-3, 5.06587474e-5, -4.90357228e-7, 2.44419284e-9, -4.91381935e-12,
)  # fmt: skip


@dataclass(frozen=True)
class Handling:
    """What vehicles of a class can do, on a dry road.

    Attributes:
        acceleration: Share of the fitted car's acceleration.
        braking: Share of its deceleration.
        top_speed: [m/s].
        curvature: At full steer [1/m].
        lateral: Largest lateral acceleration [m/s²]: faster than that, a bend is driven wide.
    """

    acceleration: float
    braking: float
    top_speed: float
    curvature: float
    lateral: float


HANDLING: Mapping[ActorClass, Handling] = {
    ActorClass.CAR: Handling(1.0, 1.0, 50.0, FULL_STEER_CURVATURE, 10.0),
    ActorClass.VAN: Handling(0.75, 0.9, 45.0, 0.25, 8.5),
    ActorClass.TRUCK: Handling(0.5, 0.7, 30.0, 0.2, 6.5),
    ActorClass.BUS: Handling(0.45, 0.7, 28.0, 0.16, 6.5),
    ActorClass.MOTORCYCLE: Handling(1.0, 0.9, 55.0, 0.4, 9.0),
    ActorClass.BICYCLE: Handling(0.3, 0.5, 9.0, 0.5, 5.0),
}
MOST_ACCELERATION = 12.0  # [m/s²] that any other driver than the ego's may ask for
STILL = Handling(0.0, 0.0, 0.0, 0.0, 0.0)  # of walkers and props


def road_grip(weather: Weather) -> float:
    """Grip of a wet road as a share of a dry one's, 0.55 to 1.

    A wet surface keeps about 0.7 of the dry friction, standing water takes up to 0.15 more; the numbers are those of
    passenger tyres on asphalt, rounded. CARLA itself never changes friction with the weather.
    """
    puddles = weather.precipitation_deposits / 100.0
    wet = min(max(weather.wetness / 100.0, weather.precipitation / 100.0, puddles, 0.0), 1.0)
    return 1.0 - 0.3 * wet - 0.15 * min(max(puddles, 0.0), 1.0)


@kernel
def throttle_acceleration(speed: float, throttle: float) -> float:
    """Acceleration [m/s²] of the fitted car at forward `speed` [m/s] under `throttle` (0 to 1) without brake."""
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
def speed_after(
    speed: float,
    throttle: float,
    brake: float,
    reverse: bool,
    acceleration: float = 1.0,
    braking: float = 1.0,
    top_speed: float = 50.0,
) -> float:
    """Signed speed one tick later [m/s]; reverse drives backward, and the brake wins over the throttle.

    Args:
        speed: Before the tick [m/s], negative backward.
        throttle: 0 to 1.
        brake: 0 to 1.
        reverse: Which gear is in.
        acceleration: Share of the fitted car's, by class and grip.
        braking: The same of its deceleration.
        top_speed: Forward [m/s]; above it the engine only drags.
    """
    direction = -1.0 if reverse else 1.0
    along = direction * speed
    if along < 0.0:  # rolling against the gear: the engine brakes
        loss = COAST_DECELERATION + braking * brake_deceleration(-along, brake)
        return direction * min(0.0, along + loss * DT)
    if brake > 0.0:
        loss = max(braking * brake_deceleration(along, brake), COAST_DECELERATION)
        return direction * max(0.0, along - loss * DT)
    gain = throttle_acceleration(along, throttle)
    if gain > 0.0:
        gain *= acceleration
    top = min(top_speed, REVERSE_TOP_SPEED) if reverse else top_speed
    after = min(along + gain * DT, max(top, along - COAST_DECELERATION * DT))
    return direction * max(0.0, after)


@kernel
def steer_curvature(steer: float) -> float:
    """Curvature of the fitted car's path [1/m], positive to the right, at `steer` (-1 to 1)."""
    slip = atan(REAR_LENGTH / (FRONT_LENGTH + REAR_LENGTH) * tan(MAX_WHEEL_ANGLE * steer))
    return sin(slip) / REAR_LENGTH
