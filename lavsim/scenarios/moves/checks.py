"""Checks that parameters of hazards share."""

from __future__ import annotations

from typing import Any

from lavsim.errors import ConfigError
from lavsim.scenarios.parameters import Interval

DIRECTIONS = ("right", "left")


def check_positive(config: Any, *names: str) -> None:
    """Raises ConfigError for a field that is not above zero; of an interval both ends must be."""
    for name in names:
        value = getattr(config, name)
        low = value.low if isinstance(value, Interval) else value
        if low <= 0.0:
            raise ConfigError(f"{name} must be positive, got {low:g}.")


def check_direction(config: Any) -> None:
    """Raises ConfigError when `direction` names no side."""
    if config.direction not in DIRECTIONS:
        raise ConfigError(f"direction must be 'right' or 'left', got {config.direction!r}.")
