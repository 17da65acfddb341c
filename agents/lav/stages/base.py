"""What a stage of the training is: data, networks, a loss, and measures on frames it has not seen."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor, nn

from agents.lav.config import LavConfig
from agents.lav.weights import Weights
from lavsim.config import Config
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws
from lavsim.registry import Registry


class TrainConfig(Config):
    """How a stage is trained."""

    batch: int = Field(default=64, gt=0, description="Samples a step, of all processes together.")
    epochs: float = Field(default=6.0, gt=0.0, description="Passes over the data.")
    learning_rate: float = Field(default=3e-4, gt=0.0, description="Adam's, at first.")
    schedule: str = Field(default="cosine", pattern="^(constant|halving|cosine)$", description="Halves every fifth.")
    clip: float = Field(default=10.0, gt=0.0, description="Largest norm of the gradient.")
    average: float = Field(default=0.998, ge=0.0, lt=1.0, description="Decay of averaged weights; 0 keeps the last.")
    precision: Literal["auto", "float32", "bfloat16"] = Field(
        default="float32", description="Of convolutions; auto takes bfloat16 where the hardware multiplies it."
    )
    workers: int = Field(default=0, ge=0, description="Processes that load data; 0 is a thread beside the training.")
    seed: int = 0
    save_every: int = Field(default=200, gt=0, description="Steps between checkpoints.")
    show_every: int = Field(default=0, ge=0, description="Steps between measures and pictures; 0 only at the end.")


@dataclass(frozen=True)
class StageInput:
    """What a stage is made from.

    Attributes:
        config: Sizes.
        train: How it is trained.
        data: What it learns from.
        validation: What it is measured on, or None.
        parents: Weights of the stages before it, of those that have any.
        folders: Folder of each stage before it, for what it made beside weights.
    """

    config: LavConfig
    train: TrainConfig
    data: Dataset
    validation: Dataset | None = None
    parents: Mapping[str, Weights] = field(default_factory=dict)
    folders: Mapping[str, Path] = field(default_factory=dict)


_CPU = torch.device("cpu")


@dataclass(frozen=True)
class StepContext:
    """Where the training stands.

    Attributes:
        draws: The step's own stream.
        progress: 0 at the first step, 1 at the last.
        device: Of the network; what `load` gave already lies there.
    """

    draws: Draws
    progress: float
    device: torch.device = _CPU


class Stage(ABC):
    """One stage that trains a network, or, without one, makes something from data (`run`).

    Class attributes:
        parents: Stages that come first.
        defaults: How it is trained if nobody says otherwise.
        sizes: Fields of `LavConfig` ("grid", "training.others") that its weights depend on: a parent's fit where
            these are equal.
        is_trained: False for a stage without a network: `run` does its work.
        is_lav: False for what is trained like LAV but no part of it, as baselines are: `all` leaves it out.

    Attributes:
        network: What is trained and saved. The loop wraps it for several processes: call it, and no method of it.
    """

    parents: ClassVar[Sequence[str]] = ()
    defaults: ClassVar[TrainConfig] = TrainConfig()
    sizes: ClassVar[Sequence[str]] = tuple(name for name in LavConfig.model_fields if name not in ("name", "drive"))
    is_trained: ClassVar[bool] = True
    is_lav: ClassVar[bool] = True
    network: nn.Module

    @abstractmethod
    def __init__(self, given: StageInput) -> None: ...

    @classmethod
    def needs(cls, config: LavConfig) -> Sequence[str]:
        """Those of its parents that come first under a configuration."""
        return cls.parents

    @abstractmethod
    def __len__(self) -> int:
        """Samples to learn from."""

    def load(self, samples: NDArray[np.int64], draws: Draws) -> Any:
        """Samples from the disk, augmented by the step's draws; a pure function that leaves the network alone.

        It runs beside the training, in a thread or in processes of its own. Tensors in tuples, lists, dicts and
        dataclasses are then moved to the network's device.
        """
        return samples

    def loss(self, batch: Any, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """The loss of what `load` gave, and what of it is worth a curve."""
        raise NotImplementedError

    def measure(self) -> dict[str, float]:
        """Measures of the network, in evaluation mode, on the validation data."""
        return {}

    def pictures(self) -> Mapping[str, NDArray[np.uint8]]:
        """Pictures (H, W, 3), red first, of what the network makes of unseen frames, by name."""
        return {}

    def run(self, folder: Path, on_share: Callable[[float], None]) -> dict[str, float]:
        """The work of a stage without a network, into a folder; goes on where it was killed.

        Args:
            folder: Its own.
            on_share: To be told the share done, 0 to 1.

        Returns:
            Its measures.
        """
        raise NotImplementedError


def _find_baselines() -> None:
    importlib.import_module("agents.cloning.stage")


STAGES: Registry[type[Stage]] = Registry("stage", "agents.lav.stages", also=_find_baselines)
