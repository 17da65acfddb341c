"""What a user sets of the expert: by the name of a manner, by a TOML file, or by JSON text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import Field, field_validator

from agents.behavior.manner import MANNERS, Manner
from lavsim.config import Config, parse_config, read_config
from lavsim.errors import ConfigError, UnknownName


class Sight(Config):
    """From when on another road user counts as seen."""

    least_hits: int = Field(default=3, ge=1, description="returns of a turn of the LiDAR, or")
    least_pixels: int = Field(default=10, ge=1, description="pixels of the cameras")
    memory: float = Field(default=1.0, ge=0.0, description="time for which it is not forgotten afterwards [s]")


class ExpertConfig(Config):
    """How the expert drives and what it knows."""

    manner: Manner = Field(default=MANNERS["expert"], description="numbers, or the name of a set")
    visible_only: bool = Field(default=False, description="drives by what LiDAR and cameras could have seen")
    sight: Sight = Field(default=Sight(), description="what counts as seen")

    @field_validator("manner", mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if value not in MANNERS:
            raise UnknownName("manner", value, MANNERS)
        return MANNERS[value]


def config_of(text: str | None) -> ExpertConfig:
    """The configuration that an agent's `--agent-config` names.

    Args:
        text: Name of a manner, "visible" (the expert by what can be seen), a TOML file, or JSON text; None: the expert.

    Raises:
        UnknownName: no such manner.
        ConfigError: the file or text can't be read, or a key or value in it does not fit.
    """
    if text is None or not text.strip():
        return ExpertConfig()
    text = text.strip()
    if text.startswith("{"):
        return parse_config(ExpertConfig, _object(text))
    if text.endswith(".toml"):
        return read_config(ExpertConfig, Path(text))
    if text == "visible":
        return ExpertConfig(visible_only=True)
    if text not in MANNERS:
        raise UnknownName("manner of the expert", text, [*MANNERS, "visible", "FILE.toml", '{"manner": …}'])
    return ExpertConfig(manner=MANNERS[text])


def _object(text: str) -> dict[str, Any]:
    try:
        values = json.loads(text)
    except json.JSONDecodeError as error:
        raise ConfigError(f"the expert's configuration is no JSON: {error}.") from None
    if not isinstance(values, dict):
        raise ConfigError(f"the expert's configuration must be a JSON object, got {text!r}.")
    return values
