"""What a page may ask of a drive: small JSON objects, each checked field by field before anything acts on it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

LARGEST = 4096  # [bytes] of a message
SPEEDS = (0.25, 8.0)  # times real time; 0 is as fast as can be
_MOST_STEPS = 200
_LONGEST_NAME = 80


class CommandError(ValueError):
    """A message that is no command; the text says why."""


@dataclass(frozen=True)
class Command:
    """Something to be done, its values in range.

    Attributes:
        name: A key of the table below.
        values: Its fields.
    """

    name: str
    values: Mapping[str, Any]


def parse(message: str | bytes) -> Command:
    """The command in a message, `{"do": NAME, FIELD: VALUE, …}`.

    Raises:
        CommandError: it is no such object, or a field is missing, unknown, of the wrong type or out of range.
    """
    if isinstance(message, bytes):
        raise CommandError("a text message was expected, got bytes")
    try:
        told = json.loads(message, parse_constant=_no_constant)
    except (ValueError, RecursionError):
        raise CommandError("the message is no JSON") from None
    if not isinstance(told, dict):
        raise CommandError("the message is no JSON object")
    name = told.pop("do", None)
    checks = _COMMANDS.get(name) if isinstance(name, str) else None
    if checks is None:
        raise CommandError(f"'do' must be one of {', '.join(_COMMANDS)}")
    if set(told) != set(checks):
        raise CommandError(f"{name!r} takes {', '.join(checks) or 'no fields'}")
    values = {}
    for field, check in checks.items():
        try:
            values[field] = check(told[field])
        except CommandError as error:
            raise CommandError(f"{name!r}: {field!r} must be {error}") from None
    return Command(str(name), values)


def _no_constant(_: str) -> float:
    raise ValueError


Check = Callable[[Any], Any]


def _number(low: float, high: float) -> Check:
    def check(value: Any) -> float:
        fits = isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
        if not fits or not math.isfinite(value):
            raise CommandError(f"a number from {low:g} to {high:g}")
        return float(value)

    return check


def _whole(low: int, high: int) -> Check:
    def check(value: Any) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise CommandError(f"a whole number from {low} to {high}")
        return value

    return check


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise CommandError("true or false")
    return value


def _name(value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= _LONGEST_NAME or not value.isprintable():
        raise CommandError(f"a name of at most {_LONGEST_NAME} characters")
    return value


def _speed(value: Any) -> float:
    try:
        number: float = _number(0.0, SPEEDS[1])(value)
    except CommandError:
        number = -1.0
    if number != 0.0 and number < SPEEDS[0]:
        raise CommandError(f"0 or a number from {SPEEDS[0]:g} to {SPEEDS[1]:g}")
    return number


_TICK = _whole(0, 10**9)
_COMMANDS: dict[str, dict[str, Check]] = {
    "drive": {"throttle": _number(0.0, 1.0), "brake": _number(0.0, 1.0), "steer": _number(-1.0, 1.0)},
    "reverse": {},
    "pause": {"on": _flag},
    "step": {"ticks": _whole(1, _MOST_STEPS)},
    "speed": {"value": _speed},
    "hazards": {},
    "hazard": {"type": _name},
    "save": {},
    "look": {"tick": _TICK},
    "fork": {"tick": _TICK},
    "restart": {"seed": _whole(0, 2**31 - 1)},
    "seen": {"frame": _TICK},
}
