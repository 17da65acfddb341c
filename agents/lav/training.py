"""The one training loop: every stage runs in it, can be killed at any step, and goes on as if it had not been.

The samples of a step are a function of seed and step, augmentations are hashed draws of the step, and a checkpoint
holds weights, averages and Adam's moments; so with one thread on a CPU a training that was resumed equals one that was
not, to the bit.
"""

from __future__ import annotations

import csv
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.lav.config import LavConfig
from agents.lav.stages.base import Stage, StepContext, TrainConfig
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.config import resolved
from lavsim.errors import ConfigError
from lavsim.random import Draws

CHECKPOINT, CURVE, MEASURES = "checkpoint.safetensors", "curve.csv", "measures.json"
_HALVINGS = 5  # of the learning rate over a run


@dataclass(frozen=True)
class Pace:
    """How a training stands, for progress bars.

    Attributes:
        step, steps: Done and in all.
        loss: Of the last step.
        samples_per_s: Since this process began.
    """

    step: int
    steps: int
    loss: float
    samples_per_s: float


def train_stage(
    name: str,
    stage: Stage,
    config: LavConfig,
    train: TrainConfig,
    folder: Path,
    lineage: Mapping[str, Any] | None = None,
    on_step: Callable[[Pace], None] | None = None,
    stop_at: int | None = None,
) -> Path | None:
    """Trains a stage to its end, from its checkpoint if there is one.

    Args:
        name: Of the stage.
        stage: Its data, network and loss.
        config: Sizes, saved with the weights.
        train: How long and how fast.
        folder: Checkpoint, curve, measures and weights go there.
        lineage: What the weights say of their origin.
        on_step: Told of every step.
        stop_at: Stops after that many steps, as a kill would.

    Returns:
        The weights' file; None if it stopped before the end.

    Raises:
        ConfigError: the folder holds a checkpoint of another configuration.
    """
    final = folder / f"{name}.safetensors"
    if final.exists():
        return final
    folder.mkdir(parents=True, exist_ok=True)
    steps = max(1, math.ceil(train.epochs * len(stage) / train.batch))
    run = _Run(stage, train, steps)
    run.load(folder, config)
    order, begun, first = Order(len(stage), train), time.monotonic(), run.step
    last = steps if stop_at is None else min(stop_at, steps)
    while run.step < last:
        row = run.advance(order.samples(run.step))
        _write_row(folder / CURVE, row)
        if on_step is not None:
            elapsed = max(time.monotonic() - begun, 1e-9)
            on_step(Pace(run.step, steps, row["loss"], (run.step - first) * train.batch / elapsed))
        if run.step % train.save_every == 0 or run.step == last:
            run.save(folder, name, config)
    if run.step < steps:
        return None
    averaged = run.averaged()
    stage.network.load_state_dict(averaged)
    stage.network.eval()
    with torch.no_grad():
        measures = stage.measure()
    (folder / MEASURES).write_text(json.dumps(measures, indent=1, sort_keys=True) + "\n")
    origin = {"steps": steps, "samples": len(stage), "train": resolved(train), "measures": measures, **(lineage or {})}
    write_weights(final, Weights(name, config, averaged, origin))
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return final


class Order:
    """Which samples a step takes: a new permutation each epoch, drawn by hash."""

    def __init__(self, count: int, train: TrainConfig) -> None:
        if count < 1:
            raise ConfigError("there is nothing to learn from: the data holds no sample for this stage.")
        self._count, self._batch = count, train.batch
        self._draws = Draws.of_seed(train.seed).stream("order")
        self._epoch, self._permutation = -1, np.zeros(0, np.int64)

    def samples(self, step: int) -> NDArray[np.int64]:
        """(batch,) numbers of the samples of a step; a batch may span two epochs."""
        places = np.arange(step * self._batch, (step + 1) * self._batch)
        return np.array([self._at(int(place)) for place in places], np.int64)

    def _at(self, place: int) -> int:
        epoch, index = divmod(place, self._count)
        if epoch != self._epoch:
            self._epoch, self._permutation = epoch, self._draws.permutation(epoch, self._count)
        return int(self._permutation[index])


class _Run:
    """Network, optimiser and average of a training under way."""

    def __init__(self, stage: Stage, train: TrainConfig, steps: int) -> None:
        self._stage, self._train, self._steps = stage, train, steps
        self._network = stage.network
        self._parameters = dict(self._network.named_parameters())
        self._optimiser = torch.optim.Adam(self._parameters.values(), lr=train.learning_rate)
        self._average = {name: value.detach().clone() for name, value in self._network.state_dict().items()}
        self._draws = Draws.of_seed(train.seed).stream("steps")
        self.step = 0

    def advance(self, samples: NDArray[np.int64]) -> dict[str, float]:
        """One step; what is worth a line of the curve."""
        rate = rate_at(self.step / self._steps, self._train)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self._network.train()
        # Dropout is the one draw that is torch's own; this makes it a function of the step.
        torch.manual_seed(int(self._draws.bits(self.step, 1)[0] >> np.uint64(1)))
        context = StepContext(self._draws.stream("augment", self.step), self.step / self._steps)
        loss, parts = self._stage.loss(samples, context)
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self._parameters.values(), self._train.clip)
        self._optimiser.step()
        self.step += 1
        self._follow()
        return {"step": self.step, "loss": loss.item(), "gradient": float(norm), "rate": rate, **parts}

    def averaged(self) -> dict[str, Tensor]:
        """The averaged weights, or the last ones where nothing is averaged."""
        return {name: value.clone() for name, value in self._average.items()}

    def save(self, folder: Path, name: str, config: LavConfig) -> None:
        """Writes the checkpoint."""
        tensors = {f"network.{key}": value for key, value in self._network.state_dict().items()}
        tensors |= {f"average.{key}": value for key, value in self._average.items()}
        for key, parameter in self._parameters.items():
            for part, value in self._optimiser.state.get(parameter, {}).items():
                tensors[f"adam.{part}.{key}"] = value
        write_weights(folder / CHECKPOINT, Weights(name, config, tensors, {"step": self.step, **self._identity()}))

    def load(self, folder: Path, config: LavConfig) -> None:
        """Goes on from the checkpoint, if there is one; the curve forgets what came after it."""
        path = folder / CHECKPOINT
        if not path.exists():
            (folder / CURVE).unlink(missing_ok=True)
            return
        saved = read_weights(path)
        self._compare(path, saved, config)
        self._network.load_state_dict(saved.part("network"))
        self._average = saved.part("average")
        for key, parameter in self._parameters.items():
            state = {part: saved.tensors[f"adam.{part}.{key}"] for part in ("step", "exp_avg", "exp_avg_sq")
                     if f"adam.{part}.{key}" in saved.tensors}  # fmt: skip
            if state:
                self._optimiser.state[parameter] = state
        self.step = int(saved.lineage["step"])
        _cut_curve(folder / CURVE, self.step)

    def _compare(self, path: Path, saved: Weights, config: LavConfig) -> None:
        """Refuses a checkpoint that something else began."""
        if saved.config != config:
            raise ConfigError(f"{path} was trained with other sizes ({saved.config.name}, not {config.name}).")
        for key, value in self._identity().items():
            if saved.lineage.get(key) != value:
                raise ConfigError(f"{path} was begun with {key} {saved.lineage.get(key)!r}, not {value!r}.")

    def _identity(self) -> dict[str, Any]:
        return {"steps": self._steps, "samples": len(self._stage), "train": resolved(self._train)}

    def _follow(self) -> None:
        # At the start the average is short, so that it forgets the untrained weights.
        decay = min(self._train.average, (1.0 + self.step) / (10.0 + self.step))
        for name, value in self._network.state_dict().items():
            held = self._average[name]
            if held.dtype.is_floating_point:
                held.lerp_(value.detach(), 1.0 - decay)
            else:
                held.copy_(value)


def rate_at(progress: float, train: TrainConfig) -> float:
    """The learning rate at a share of the run."""
    if train.schedule == "halving":
        return train.learning_rate * 0.5 ** int(progress * _HALVINGS)
    if train.schedule == "cosine":
        return train.learning_rate * (0.5 + 0.5 * math.cos(math.pi * progress))
    return train.learning_rate


def _write_row(path: Path, row: Mapping[str, float]) -> None:
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if is_new:
            writer.writerow(row)
        writer.writerow([repr(value) for value in row.values()])


def _cut_curve(path: Path, step: int) -> None:
    """Leaves the curve's first `step` rows."""
    if path.exists():
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(lines[: step + 1]), encoding="utf-8")
