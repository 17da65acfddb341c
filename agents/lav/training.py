"""The one training loop: every stage runs in it, can be killed at any step, and goes on as if it had not been.

The samples of a step are a function of seed and step, augmentations are hashed draws of the step, and a checkpoint
holds weights, averages and Adam's moments; so with one thread on a CPU a training that was resumed equals one that was
not, to the bit. Devices, processes and precision are lightning-fabric's.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor

from agents.lav.config import LavConfig
from agents.lav.devices import make_fabric, moved
from agents.lav.feed import Order, fed
from agents.lav.records import MEASURES, Pace, Records, Watch
from agents.lav.stages.base import Stage, StepContext, TrainConfig
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.config import resolved
from lavsim.errors import ConfigError
from lavsim.random import Draws

CHECKPOINT = "checkpoint.safetensors"
_HALVINGS = 5  # of the learning rate over a run
_AVERAGE_GROWTH = 10.0  # steps: at the start the average is short, so that it forgets the untrained weights


def train_stage(
    name: str,
    stage: Stage,
    config: LavConfig,
    train: TrainConfig,
    folder: Path,
    lineage: Mapping[str, Any] | None = None,
    on_step: Callable[[Pace], None] | None = None,
    stop_at: int | None = None,
    fabric: Fabric | None = None,
) -> Path | None:
    """Trains a stage to its end, from its checkpoint if there is one.

    Args:
        name: Of the stage.
        stage: Its data, network and loss.
        config: Sizes, saved with the weights.
        train: How long and how fast.
        folder: Checkpoint, curve, measures, pictures and weights go there.
        lineage: What the weights say of their origin.
        on_step: Told of every step.
        stop_at: Stops after that many steps, as a kill would.
        fabric: Device and processes; this process on a CPU if None.

    Returns:
        The weights' file; None if it stopped before the end.

    Raises:
        ConfigError: the folder holds a checkpoint of another configuration, or a batch can't be shared out.
    """
    final = folder / f"{name}.safetensors"
    if final.exists():
        return final
    fabric = fabric or make_fabric(train.precision)
    if train.batch % fabric.world_size:
        raise ConfigError(f"a batch of {train.batch} can't be shared by {fabric.world_size} processes evenly.")
    folder.mkdir(parents=True, exist_ok=True)
    run = _Run(stage, train, fabric)
    run.load(folder, config)
    done = _follow(run, name, config, folder, on_step, stop_at)
    if done and fabric.is_global_zero:
        origin = {**run.identity(), "measures": json.loads((folder / MEASURES).read_text()), **(lineage or {})}
        write_weights(final, Weights(name, config, run.averaged(), origin))
        (folder / CHECKPOINT).unlink(missing_ok=True)
    fabric.barrier()
    return final if done else None


def _follow(
    run: _Run,
    name: str,
    config: LavConfig,
    folder: Path,
    on_step: Callable[[Pace], None] | None,
    stop_at: int | None,
) -> bool:
    """Runs the steps, leaving records; whether it came to the end."""
    train, fabric = run.train, run.fabric
    last = run.steps if stop_at is None else min(stop_at, run.steps)
    records = Records(folder, run.step) if fabric.is_global_zero else None
    watch = Watch(folder, run.step, train.batch)
    batches = fed(run.load_step, range(run.step, last), train.workers)
    while run.step < last:
        row = run.advance(watch.next(batches))
        step = run.step
        is_saved = step == last or step % train.save_every == 0
        is_shown = step == run.steps or (train.show_every > 0 and step % train.show_every == 0)
        if records is not None:
            pace = watch.pace(step, run.steps, row["loss"])
            records.row(row)
            if on_step is not None:
                on_step(pace)
            if is_saved:
                run.save(folder, name, config)
                records.pace(pace)
            if is_shown:
                with run.averaged_in_place():
                    records.shown(step, run.stage.measure(), run.stage.pictures())
        if is_saved or is_shown:
            fabric.barrier()
    if records is not None:
        records.close()
    return run.step == run.steps


class _Run:
    """Network, optimiser and average of a training under way."""

    def __init__(self, stage: Stage, train: TrainConfig, fabric: Fabric) -> None:
        self.stage, self.train, self.fabric = stage, train, fabric
        self.steps = max(1, math.ceil(train.epochs * len(stage) / train.batch))
        self.step = 0
        self._order = Order(len(stage), train)
        self._network = stage.network.to(fabric.device)
        self._parameters = dict(self._network.named_parameters())
        self._optimiser = torch.optim.Adam(self._parameters.values(), lr=train.learning_rate)
        self._wrapped, self._stepper = fabric.setup(self._network, self._optimiser)
        stage.network = self._wrapped
        self._average = {name: value.detach().clone() for name, value in self._network.state_dict().items()}
        self._draws = Draws.of_seed(train.seed).stream("steps")

    def load_step(self, step: int) -> Any:
        """What this process learns from in a step."""
        rank, shares = self.fabric.global_rank, self.fabric.world_size
        return self.stage.load(self._order.samples(step)[rank::shares], self._augment(step))

    def advance(self, batch: Any) -> dict[str, float]:
        """One step; what is worth a line of the curve."""
        rate = rate_at(self.step / self.steps, self.train)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self._network.train()
        # Dropout is the one draw that is torch's own; this makes it a function of the step.
        torch.manual_seed(int(self._draws.bits(self.step, 1)[0] >> np.uint64(1)) + self.fabric.global_rank)
        device = self.fabric.device
        context = StepContext(self._augment(self.step), self.step / self.steps, device)
        loss, parts = self.stage.loss(moved(batch, device), context)
        self._optimiser.zero_grad(set_to_none=True)
        self.fabric.backward(loss)
        norm = self.fabric.clip_gradients(self._wrapped, self._stepper, max_norm=self.train.clip)
        assert norm is not None
        self._stepper.step()
        self.step += 1
        self._average_on()
        return {"step": self.step, "loss": loss.item(), "gradient": float(norm), "rate": rate, **parts}

    def averaged(self) -> dict[str, Tensor]:
        """The averaged weights, or the last ones where nothing is averaged."""
        return {name: value.clone() for name, value in self._average.items()}

    @contextmanager
    def averaged_in_place(self) -> Iterator[None]:
        """The stage's network as it will be saved, to be looked at; then the training's again."""
        live = {name: value.detach().clone() for name, value in self._network.state_dict().items()}
        self._network.load_state_dict(self._average)
        self._network.eval()
        self.stage.network = self._network
        try:
            with torch.no_grad():
                yield
        finally:
            self._network.load_state_dict(live)
            self.stage.network = self._wrapped

    def save(self, folder: Path, name: str, config: LavConfig) -> None:
        """Writes the checkpoint."""
        tensors = {f"network.{key}": value for key, value in self._network.state_dict().items()}
        tensors |= {f"average.{key}": value for key, value in self._average.items()}
        for key, parameter in self._parameters.items():
            for part, value in self._optimiser.state.get(parameter, {}).items():
                tensors[f"adam.{part}.{key}"] = value
        write_weights(folder / CHECKPOINT, Weights(name, config, tensors, {"step": self.step, **self.identity()}))

    def load(self, folder: Path, config: LavConfig) -> None:
        """Goes on from the checkpoint, if there is one."""
        path = folder / CHECKPOINT
        if not path.exists():
            return
        saved = read_weights(path)
        self._compare(path, saved, config)
        self._network.load_state_dict(saved.part("network"))
        self._average = {name: value.to(self.fabric.device) for name, value in saved.part("average").items()}
        for key, parameter in self._parameters.items():
            state = {part: saved.tensors[f"adam.{part}.{key}"] for part in ("step", "exp_avg", "exp_avg_sq")
                     if f"adam.{part}.{key}" in saved.tensors}  # fmt: skip
            if state:
                moments = {part: value.to(parameter.device) for part, value in state.items() if part != "step"}
                self._optimiser.state[parameter] = {"step": state["step"], **moments}
        self.step = int(saved.lineage["step"])

    def identity(self) -> dict[str, Any]:
        """What a checkpoint must share with the training that goes on from it."""
        return {"steps": self.steps, "samples": len(self.stage), "train": resolved(self.train)}

    def _compare(self, path: Path, saved: Weights, config: LavConfig) -> None:
        """Refuses a checkpoint that something else began."""
        if saved.config != config:
            raise ConfigError(f"{path} was trained with other sizes ({saved.config.name}, not {config.name}).")
        for key, value in self.identity().items():
            if saved.lineage.get(key) != value:
                raise ConfigError(f"{path} was begun with {key} {saved.lineage.get(key)!r}, not {value!r}.")

    def _augment(self, step: int) -> Draws:
        """The step's own stream, one a process."""
        draws, rank = self._draws.stream("augment", step), self.fabric.global_rank
        return draws.stream("process", rank) if rank else draws

    def _average_on(self) -> None:
        decay = min(self.train.average, (1.0 + self.step) / (_AVERAGE_GROWTH + self.step))
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
