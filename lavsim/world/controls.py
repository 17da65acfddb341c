"""Keeps what an agent asks for within what a vehicle has: no value out of range, none that is not a number."""

from __future__ import annotations

import logging
import math

import numpy as np

from lavsim.types import Control

_LOG = logging.getLogger(__name__)
_ROUNDING = 1e-3  # a value that far out of its range is cut without a word


class ControlFilter:
    """Clamps controls; a value that is not finite is replaced by the last good one. Says so once."""

    def __init__(self) -> None:
        self._last = Control()
        self._has_warned = False

    def clean(self, control: Control) -> Control:
        """The control that is applied."""
        last = self._last
        self._last = Control(
            self._within("throttle", control.throttle, 0.0, last.throttle),
            self._within("steer", control.steer, -1.0, last.steer),
            self._within("brake", control.brake, 0.0, last.brake),
            bool(control.hand_brake),
            bool(control.reverse),
        )
        return self._last

    def _within(self, name: str, value: float, low: float, last: float) -> float:
        number = float(value)
        if not math.isfinite(number):
            self._warn(name, number, low, f"kept {last:g}")
            return last
        clamped = min(max(number, low), 1.0)
        if abs(clamped - number) > _ROUNDING:
            self._warn(name, number, low, f"took {clamped:g}")
        return float(np.float32(clamped))  # what the log holds is exactly what the world applies

    def _warn(self, name: str, value: float, low: float, done: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            _LOG.warning(
                "%s must lie in [%g, 1], got %g: %s; further values out of range are treated alike, silently.",
                name, low, value, done,
            )  # fmt: skip
