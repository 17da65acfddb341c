"""What the expert says of itself beside its control: whether it brakes, for what, and how fast it wants to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lavsim.types import ActorClass

FELT = -0.3  # [m/s²] a wish above this is no braking
HELD = 0.2  # [m/s²] below this a vehicle at rest stays there
EMERGENCY = -3.5  # [m/s²] that hard it brakes for nobody who only drives slower
AT_REST = 0.5  # [m/s]
AHEAD = 1.0  # [s] over which its wish of acceleration makes its target speed
NO_ACTOR = 0

_CAUSES = {"light": "light", "stop sign": "stop_sign", "junction": "junction", "goal": "goal"}


def labels_of(
    truth: Mapping[str, Any], reason: str, acceleration: float, wanted: float, stops: bool
) -> dict[str, int | float | str]:
    """The labels of a tick.

    Args:
        truth: The reading it drove by.
        reason: What held it back: "free", "actor 12", "light", "stop sign", "junction" or "goal".
        acceleration: What it asked for [m/s²].
        wanted: Speed it would drive alone here [m/s].
        stops: Whether what holds it back brings it to rest; a slower leader doesn't.

    Returns:
        `brake`: 1 where it comes to rest or stays there for a light, a road user, a thing or a stop sign, as LAV's
        collector has it: driving slower behind somebody is no brake. `brake_cause`: "none", "light", "vehicle",
        "walker", "prop", "stop_sign", "junction" (its exit is full) or "goal". `brake_actor`: id of the actor or 0.
        `target_speed`: what it is after [m/s]; 0 with the brake.
    """
    speed = float(truth["ego_speed"])
    is_held = acceleration < FELT or (speed < AT_REST and acceleration < HELD)
    cause, actor = _cause(truth, reason) if is_held else ("none", NO_ACTOR)
    brake = cause not in ("none", "goal") and (stops or acceleration < EMERGENCY)
    target = 0.0 if brake else min(max(speed + AHEAD * acceleration, 0.0), max(wanted, 0.0))
    return {"brake": int(brake), "brake_cause": cause, "brake_actor": actor, "target_speed": target}


def _cause(truth: Mapping[str, Any], reason: str) -> tuple[str, int]:
    kind, _, number = reason.partition(" ")
    if kind != "actor":
        return _CAUSES.get(reason, "none"), NO_ACTOR
    actor = int(number)
    kind_of = ActorClass(int(truth["classes"][int(np.flatnonzero(truth["ids"] == actor)[0])]))
    return {ActorClass.WALKER: "walker", ActorClass.PROP: "prop"}.get(kind_of, "vehicle"), actor
