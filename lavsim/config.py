"""Typed configuration: frozen trees read from TOML, with dotted overrides; what is unknown is refused by its name.

A tree is a subclass of `Config` whose fields have defaults and, in their descriptions, units. It is read by
`read_config`, changed by `--set a.b=c`, and saved resolved (`resolved`) beside every result.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from lavsim.errors import ConfigError

C = TypeVar("C", bound="Config")


class Config(BaseModel):
    """Base of all configuration trees: frozen, and closed to unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


def read_config(kind: type[C], file: Path | None = None, sets: Sequence[str] = (), base: C | None = None) -> C:
    """A configuration.

    Args:
        kind: Which tree.
        file: TOML with some of its fields, or None.
        sets: Overrides "a.b=c" in order, applied after the file; `c` is read as TOML, and as a text where that fails.
        base: Values of all other fields; the defaults if None.

    Raises:
        ConfigError: the file can't be read, or a key or value does not fit; the message names the key, what came, what
            was expected, and the nearest known key.
    """
    values = base.model_dump() if base is not None else {}
    if file is not None:
        _merge(values, _read_toml(file))
    for text in sets:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise ConfigError(f"--set expects a.b=value, got {text!r}.")
        _merge(values, _nested(path.strip().split("."), _value(value.strip())))
    return parse_config(kind, values)


def parse_config(kind: type[C], values: Mapping[str, Any]) -> C:
    """The configuration that `values` describe.

    Raises:
        ConfigError: as `read_config`.
    """
    try:
        return kind.model_validate(dict(values))
    except ValidationError as error:
        raise ConfigError(_first_problem(kind, error)) from None


def resolved(config: Config) -> dict[str, Any]:
    """The whole tree in JSON types."""
    loaded: dict[str, Any] = json.loads(config.model_dump_json())
    return loaded


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"can't read the configuration {str(file)!r}: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file} is no TOML: {error}") from None


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _nested(path: Sequence[str], value: Any) -> dict[str, Any]:
    for name in reversed(path):
        value = {name: value}
    nested: dict[str, Any] = value
    return nested


def _merge(values: dict[str, Any], more: Mapping[str, Any]) -> None:
    """Puts `more` into `values`, tables into tables."""
    for key, value in more.items():
        known = values.get(key)
        if isinstance(value, Mapping) and isinstance(known, dict):
            _merge(known, value)
        else:
            values[key] = dict(value) if isinstance(value, Mapping) else value


def _first_problem(kind: type[Config], error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    path = [str(part) for part in first["loc"]]
    name = ".".join(path)
    if first["type"] != "extra_forbidden":
        message = first["msg"].removeprefix("Value error, ").rstrip(".")
        return f"{name or kind.__name__}: {message}, got {first['input']!r}."
    known = _known(kind, path[:-1])
    near = difflib.get_close_matches(path[-1], known, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else f" Known: {', '.join(known)}."
    return f"unknown key {name!r}.{hint}"


def _known(kind: type[BaseModel], path: Sequence[str]) -> list[str]:
    """Names of the fields of the tree at `path`."""
    for name in path:
        inner = kind.model_fields[name].annotation if name in kind.model_fields else None
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        kind = inner
    return list(kind.model_fields)
