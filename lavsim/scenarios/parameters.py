"""Parameters of a hazard: what a route file says becomes the fields of a frozen Config.

A file gives a number or a text, an interval (from, to) or a place (x, y, z and perhaps yaw); JSON gives the same as
lists or mappings.
"""

from __future__ import annotations

import difflib
import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, NamedTuple

from lavsim.errors import ScenarioError


class Interval(NamedTuple):
    """A range to draw from, `low` to `high`; a single number stands for itself."""

    low: float
    high: float

    @staticmethod
    def parse(value: Any) -> Interval:
        if isinstance(value, Mapping):
            value = (value["from"], value["to"])
        low, high = (value, value) if isinstance(value, int | float | str) else value
        result = Interval(_number(low), _number(high))
        if result.low > result.high:
            raise ValueError(f"{result.low:g} to {result.high:g} does not rise")
        return result


class Location(NamedTuple):
    """A place that a route file names: x, y, z [m] and yaw [rad] where it gives one."""

    x: float
    y: float
    z: float = 0.0
    yaw: float | None = None

    @staticmethod
    def parse(value: Any) -> Location:
        if isinstance(value, Mapping):
            value = [value[name] for name in ("x", "y", "z", "yaw") if name in value]
        numbers = [_number(v) for v in value if v is not None]
        if not 2 <= len(numbers) <= 4:
            raise ValueError("x, y, z and perhaps yaw expected")
        return Location(*numbers)


class OtherActor(NamedTuple):
    """An actor that a route file places itself."""

    place: Location
    model: str | None = None

    @staticmethod
    def parse(value: Any) -> OtherActor:
        if isinstance(value, Mapping) and "position" in value:
            place = Location.parse([*value["position"], value.get("yaw", 0.0)])
            return OtherActor(place, value.get("model"))
        return OtherActor(Location.parse(value))


def parse_parameters(config: type[Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """`given` as keyword arguments of `config`, each of its field's type.

    Raises:
        ScenarioError: an unknown or ill-typed parameter.
    """
    hints = typing.get_type_hints(config)
    known = {f.name: hints[f.name] for f in fields(config)}
    result = {}
    for name, value in given.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise ScenarioError(f"no parameter {name!r}.{hint} Known: {', '.join(known) or 'none'}.")
        try:
            result[name] = _parsed(known[name], value)
        except (TypeError, ValueError, KeyError, IndexError):
            raise ScenarioError(f"{name} must be {_described(known[name])}, got {value!r}.") from None
    for f in fields(config):
        if f.name not in result and f.default is MISSING and f.default_factory is MISSING:
            raise ScenarioError(f"{f.name} is missing.")
    return result


def _parsed(kind: Any, value: Any) -> Any:
    if isinstance(value, Mapping) and set(value) == {"value"}:
        value = value["value"]
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _parsed(next(k for k in inner if k is not type(None)), value)
    if origin is tuple:
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise TypeError
        return tuple(_parsed(inner[0], each) for each in value)
    if hasattr(kind, "parse"):
        return kind.parse(value)
    if kind in (float, int):
        return kind(_number(value))
    if kind is bool:
        return _truth(value)
    if kind is str:
        if not isinstance(value, str):
            raise TypeError
        return value
    return value  # a mapping of the 1.0 format: its hazard reads it


def _number(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError
    return number


def _truth(value: Any) -> bool:
    words = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}
    return words[str(value).lower()]


_WORDS = {
    float: "a float",
    int: "an int",
    str: "a str",
    bool: "true or false",
    Interval: "an interval (from, to)",
    Location: "a place (x, y, z)",
}


def _described(kind: Any) -> str:
    inner = typing.get_args(kind)
    return _described(inner[0]) if inner and kind not in _WORDS else _WORDS.get(kind, f"of type {kind}")
