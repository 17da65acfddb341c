"""What a stage of the training is: data, networks, a loss, and measures on frames it has not seen."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
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

    batch: int = Field(default=64, gt=0, description="Samples a step.")
    epochs: float = Field(default=6.0, gt=0.0, description="Passes over the data.")
    learning_rate: float = Field(default=3e-4, gt=0.0, description="Adam's, at first.")
    schedule: str = Field(default="cosine", pattern="^(constant|halving|cosine)$", description="Halves every fifth.")
    clip: float = Field(default=10.0, gt=0.0, description="Largest norm of the gradient.")
    average: float = Field(default=0.998, ge=0.0, lt=1.0, description="Decay of averaged weights; 0 keeps the last.")
    seed: int = 0
    save_every: int = Field(default=200, gt=0, description="Steps between checkpoints.")


@dataclass(frozen=True)
class StageInput:
    """What a stage is made from.

    Attributes:
        config: Sizes.
        train: How it is trained.
        data: What it learns from.
        validation: What it is measured on, or None.
        parents: Weights of the stages before it.
    """

    config: LavConfig
    train: TrainConfig
    data: Dataset
    validation: Dataset | None = None
    parents: Mapping[str, Weights] = field(default_factory=dict)


@dataclass(frozen=True)
class StepContext:
    """Where the training stands.

    Attributes:
        draws: The step's own stream.
        progress: 0 at the first step, 1 at the last.
    """

    draws: Draws
    progress: float


class Stage(ABC):
    """One stage.

    Class attributes:
        parents: Stages whose weights it needs.
        defaults: How it is trained if nobody says otherwise.

    Attributes:
        network: What is trained and saved.
    """

    parents: ClassVar[Sequence[str]] = ()
    defaults: ClassVar[TrainConfig] = TrainConfig()
    network: nn.Module

    @abstractmethod
    def __init__(self, given: StageInput) -> None: ...

    @abstractmethod
    def __len__(self) -> int:
        """Samples to learn from."""

    @abstractmethod
    def loss(self, samples: NDArray[np.int64], context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """The loss of samples, and what of it is worth a curve."""

    @abstractmethod
    def measure(self) -> dict[str, float]:
        """Measures of the network, in evaluation mode, on the validation data."""


STAGES: Registry[type[Stage]] = Registry("stage", "agents.lav.stages")
