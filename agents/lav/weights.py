"""Weights on disk: safetensors with the configuration and the lineage that made them; no pickle."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from agents.lav.config import LavConfig
from lavsim.config import parse_config, resolved
from lavsim.errors import ConfigError

WEIGHTS_SCHEMA = 1
ELSEWHERE = "stages.json"  # where a training's stages lie that it took from others, by name


@dataclass(frozen=True)
class Weights:
    """Parameters and buffers of networks, and where they come from.

    Attributes:
        stage: The stage that trained them.
        config: Sizes.
        tensors: By name.
        lineage: In JSON types: data, seed, steps, measures, digests of the parents' weights.
    """

    stage: str
    config: LavConfig
    tensors: Mapping[str, Tensor]
    lineage: Mapping[str, Any] = field(default_factory=dict)

    def part(self, name: str) -> dict[str, Tensor]:
        """The tensors below `name.`, without it."""
        return {
            key.removeprefix(f"{name}."): value for key, value in self.tensors.items() if key.startswith(f"{name}.")
        }


def write_weights(path: Path, weights: Weights) -> None:
    """Writes a file in one move: a reader finds the old one or the whole new one."""
    notes = {
        "schema": str(WEIGHTS_SCHEMA),
        "stage": weights.stage,
        "config": _json(resolved(weights.config)),
        "lineage": _json(weights.lineage),
    }
    data = save({name: tensor.detach().contiguous().cpu() for name, tensor in weights.tensors.items()}, metadata=notes)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def read_weights(path: Path) -> Weights:
    """The weights in a file.

    Raises:
        ConfigError: there is none, or it is no such file, damaged, or of another version.
    """
    if not path.is_file():
        raise ConfigError(f"there are no weights at {str(path)!r}.")
    try:
        with safe_open(path, framework="pt") as file:
            notes = file.metadata() or {}
            if notes.get("schema") != str(WEIGHTS_SCHEMA):
                raise ConfigError(
                    f"{path.name} has weights of format {notes.get('schema')}; this version reads {WEIGHTS_SCHEMA}."
                )
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
            config = stored_config(json.loads(notes["config"]))
            return Weights(notes["stage"], config, tensors, json.loads(notes["lineage"]))
    except (SafetensorError, KeyError, ValueError) as error:
        raise ConfigError(f"{path.name} can't be read as weights: {error}.") from None


def stored_config(stored: dict[str, Any]) -> LavConfig:
    """The sizes that a file says it was made with.

    Raises:
        ConfigError: one is unknown or does not fit.
    """
    stored.get("temporal", {}).pop("filter", None)  # until 0.1 among the sizes, and read by nobody
    return parse_config(LavConfig, stored)


def stage_file(folder: Path, stage: str) -> Path:
    """The file of a stage's weights: a training's own, or the one that it took from another training."""
    own, notes = folder / stage / f"{stage}.safetensors", folder / ELSEWHERE
    if not own.exists() and notes.is_file():
        try:
            return folder / json.loads(notes.read_text())[stage]
        except (ValueError, KeyError, TypeError):
            return own
    return own


def write_elsewhere(folder: Path, files: Mapping[str, Path]) -> None:
    """Notes where the weights of stages lie that a training took from others."""
    notes = {stage: os.path.relpath(path, folder) for stage, path in files.items()}
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / (ELSEWHERE + ".partial")
    partial.write_text(json.dumps(notes, indent=1, sort_keys=True) + "\n")
    partial.replace(folder / ELSEWHERE)


def digest_of_file(path: Path) -> str:
    """A digest of a file's bytes."""
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
