"""What an action of the environment means: pedals and wheel, or points to be driven to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lavsim.types import Control
from lavsim.world.dynamics import FRONT_LENGTH, MAX_WHEEL_ANGLE, REAR_LENGTH
from lavsim.world.snapshot import EgoState

WAYPOINTS = 4
INTERVAL = 0.5  # [s] from one waypoint to the next
REACH = 12.0  # [m] of a waypoint along an axis, at most
_GAIN = 0.8  # of the pedals, for 1 m/s too slow or too fast
_STANDING = 0.3  # [m/s] a wish below it is to stand


class ActionSpace(Protocol):
    """A kind of action."""

    @property
    def space(self) -> Any:
        """What actions there are."""

    def control(self, action: NDArray[np.float32], ego: EgoState) -> Control:
        """The control for one tick."""


class Controls:
    """Two numbers in -1 to 1: brake to throttle, and wheel from left to right."""

    space = spaces.Box(-1.0, 1.0, (2,), np.float32)

    def control(self, action: NDArray[np.float32], ego: EgoState) -> Control:
        pedal, steer = (float(np.clip(value, -1.0, 1.0)) for value in action)
        return Control(throttle=max(pedal, 0.0), steer=steer, brake=max(-pedal, 0.0))


class Waypoints:
    """Four points ahead and right of the ego [m], half a second apart; numbers in -1 to 1 span 12 m."""

    space = spaces.Box(-1.0, 1.0, (WAYPOINTS, 2), np.float32)

    def control(self, action: NDArray[np.float32], ego: EgoState) -> Control:
        points = np.clip(np.asarray(action, np.float64), -1.0, 1.0) * REACH
        steps = np.diff(np.concatenate([np.zeros((1, 2)), points]), axis=0)
        wanted = float(np.hypot(steps[:, 0], steps[:, 1]).mean()) / INTERVAL
        if wanted < _STANDING:
            return Control(brake=1.0)
        pedal = _GAIN * (wanted - ego.forward_speed)
        ahead, aside = points[1]
        distance = max(math.hypot(ahead, aside), 2.0)
        wheel = math.atan(2.0 * (FRONT_LENGTH + REAR_LENGTH) * math.sin(math.atan2(aside, ahead)) / distance)
        return Control(
            throttle=min(max(0.4 + pedal, 0.0), 1.0) if pedal > -0.2 else 0.0,
            steer=min(max(wheel / MAX_WHEEL_ANGLE, -1.0), 1.0),
            brake=min(max(-pedal, 0.0), 1.0) if pedal < -0.4 else 0.0,
        )


ACTIONS: Mapping[str, type[ActionSpace]] = MappingProxyType({"controls": Controls, "waypoints": Waypoints})
