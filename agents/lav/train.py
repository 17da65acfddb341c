"""Trains one stage or all that lead to the end, skipping what is finished."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from agents.lav.config import LavConfig, find_preset
from agents.lav.stages.base import STAGES, StageInput, TrainConfig
from agents.lav.training import Pace, train_stage
from agents.lav.weights import Weights, digest_of_file, read_weights
from lavsim.config import Config, read_config, resolved
from lavsim.dataset.reader import Dataset
from lavsim.errors import ConfigError, OutputError

ALL = "all"


class Settings(Config):
    """What may be set from the command line: sizes as `lav.…`, the loop as `train.…`."""

    lav: LavConfig = LavConfig()
    train: TrainConfig = TrainConfig()


@dataclass(frozen=True)
class TrainTask:
    """What to train.

    Attributes:
        stage: Its name, or "all".
        data: Dataset to learn from.
        out: Folder of the weights; each stage has a folder of its own there.
        preset: Sizes.
        validation: Dataset to measure on, or None.
        config: TOML with fields of `Settings`, or None.
        sets: Overrides "lav.motion.refinements=1", "train.epochs=3".
        resume: Whether to go on with what lies in `out`.
        threads: Of this process.
    """

    stage: str
    data: Path
    out: Path
    preset: str = "tiny"
    validation: Path | None = None
    config: Path | None = None
    sets: Sequence[str] = ()
    resume: bool = False
    threads: int = 1


OnPace = Callable[[str, Pace], None]


def train(task: TrainTask, on_pace: OnPace | None = None) -> dict[str, dict[str, float]]:
    """Trains and gives each stage's measures.

    Raises:
        UnknownName: no such stage or preset.
        ConfigError: settings don't fit, the data holds nothing to learn from, or a parent's weights are missing or of
            other sizes.
        DatasetError: the data can't be read.
        OutputError: the folder holds a training and `resume` is not set.
    """
    names = stages_of(task.stage)
    preset = find_preset(task.preset)
    settings = {name: _settings(task, preset, STAGES[name].defaults) for name in names}
    if not task.resume and any((task.out / name).exists() for name in names):
        raise OutputError(f"{task.out} holds a training; --resume goes on with it.")
    torch.set_num_threads(task.threads)
    data = Dataset(task.data)
    validation = Dataset(task.validation) if task.validation is not None else None
    for name in names:
        folder = task.out / name
        if (folder / f"{name}.safetensors").exists():
            continue
        lav, loop = settings[name].lav, settings[name].train
        parents = {parent: _parent(task.out, parent, lav) for parent in STAGES[name].parents}
        stage = STAGES[name](StageInput(lav, loop, data, validation, parents))
        lineage = {"data": data.root.name, "frames": len(data), "parents": _digests(task.out, name)}
        train_stage(name, stage, lav, loop, folder, lineage, _told(on_pace, name))
        (folder / "config.json").write_text(json.dumps(resolved(settings[name]), indent=1, sort_keys=True) + "\n")
    return {name: read_weights(task.out / name / f"{name}.safetensors").lineage["measures"] for name in names}


def stages_of(name: str) -> list[str]:
    """The stages that a name stands for, parents first; "all" is every one.

    Raises:
        UnknownName: there is no such stage.
    """
    if name != ALL:
        STAGES[name]
        return [name]
    order: list[str] = []

    def visit(stage: str) -> None:
        for parent in STAGES[stage].parents:
            visit(parent)
        if stage not in order:
            order.append(stage)

    for stage in STAGES:
        visit(str(stage))
    return order


def _settings(task: TrainTask, preset: LavConfig, loop: TrainConfig) -> Settings:
    return read_config(Settings, task.config, task.sets, Settings(lav=preset, train=loop))


def _parent(out: Path, name: str, config: LavConfig) -> Weights:
    path = out / name / f"{name}.safetensors"
    if not path.exists():
        raise ConfigError(f"stage {name!r} comes first: there are no weights at {str(path)!r}.")
    weights = read_weights(path)
    if weights.config != config:
        raise ConfigError(f"{path} has other sizes ({weights.config.name}) than this training ({config.name}).")
    return weights


def _digests(out: Path, name: str) -> dict[str, Any]:
    return {parent: digest_of_file(out / parent / f"{parent}.safetensors") for parent in STAGES[name].parents}


def _told(on_pace: OnPace | None, name: str) -> Callable[[Pace], None] | None:
    return None if on_pace is None else lambda pace: on_pace(name, pace)
