"""Keys as a driver's hands and feet: pedals and wheel move towards what is pressed, a little each tick."""

from __future__ import annotations

from dataclasses import dataclass

from lavsim.types import Control
from lavsim.world.dynamics import steer_curvature

_TURN, _RETURN = 0.08, 0.16  # of the full steer a tick: 0.6 s to the lock, 0.3 s back
_PRESS, _LIFT = 0.1, 0.25  # of a pedal's way a tick
_LATERAL = 4.5  # [m/s²] that keys alone can ask for: at speed they steer less
_STANDING = 1.0  # [m/s] below which the gear changes


@dataclass(frozen=True)
class Keys:
    """What is pressed: throttle and brake 0 to 1, steer -1 to 1 with the right positive."""

    throttle: float = 0.0
    brake: float = 0.0
    steer: float = 0.0


class Wheel:
    """Controls that follow the keys.

    Attributes:
        keys: What is pressed.
        wants_reverse: The gear asked for; taken at walking pace.
        control: Of the last tick.
    """

    def __init__(self) -> None:
        self.keys = Keys()
        self.wants_reverse = False
        self.control = Control()

    def turn(self, speed: float) -> Control:
        """The control of the next tick at a speed ahead [m/s]."""
        last, keys = self.control, self.keys
        limit = min(1.0, _LATERAL / max(speed * speed * steer_curvature(1.0), 1e-6))
        aim = max(-limit, min(limit, keys.steer))
        is_return = abs(aim) < abs(last.steer) or aim * last.steer < 0.0
        self.control = Control(
            throttle=_towards(last.throttle, keys.throttle, _PRESS if keys.throttle > last.throttle else _LIFT),
            steer=_towards(last.steer, aim, _RETURN if is_return else _TURN),
            brake=_towards(last.brake, keys.brake, _PRESS if keys.brake > last.brake else _LIFT),
            reverse=self.wants_reverse if abs(speed) < _STANDING else last.reverse,
        )
        return self.control


def _towards(value: float, aim: float, step: float) -> float:
    return max(value - step, min(value + step, aim))
