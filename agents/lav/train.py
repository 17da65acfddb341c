"""Trains one stage or all that lead to the end, skipping what is finished."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import torch
from lightning_fabric import Fabric

from agents.lav.config import LavConfig, find_preset
from agents.lav.devices import make_fabric
from agents.lav.export import EXPORTED, export
from agents.lav.records import MEASURES, Pace
from agents.lav.stages.base import STAGES, Stage, StageInput, TrainConfig
from agents.lav.training import train_stage
from agents.lav.variants import find_variant
from agents.lav.weights import digest_of_file, read_weights, stored_config, write_elsewhere
from lavsim.config import Config, read_config, resolved
from lavsim.dataset.reader import Dataset
from lavsim.errors import ConfigError, LavsimError, OutputError

ALL = "all"
DRIVES = ("segmentation", "brake", "full")  # stages whose networks the agent reads
DONE = "done.json"  # what a stage without a network leaves last
OnPace = Callable[[str, Pace], None]
_TOLD_EVERY = 20  # steps between lines, where several processes train


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
        threads: Of each process.
        variant: A row of the paper's tables (`agents.lav.variants`), or None.
        shared: Folders of other trainings; what is finished there and does not differ is taken from there.
        device: "cpu", "cuda" or "auto".
        processes: That share each batch.
        start: Weights that the stage begins from, or None.
        export: Whether networks are written as TorchScript too.
        later: Stages that are left out of "all".
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
    variant: str | None = None
    shared: Sequence[Path] = ()
    device: str = "cpu"
    processes: int = 1
    start: Path | None = None
    export: bool = False
    later: Sequence[str] = ()


def train(task: TrainTask, on_pace: OnPace | None = None) -> dict[str, dict[str, float]]:
    """Trains and gives each stage's measures.

    Raises:
        UnknownName: no such stage, preset or variant.
        ConfigError: settings don't fit, the data holds nothing to learn from, or a parent's weights are missing or of
            other sizes.
        DatasetError: the data can't be read.
        OutputError: the folder holds a training and `resume` is not set.
    """
    names = needed(task)
    settings = {name: settings_of(task, name) for name in names}
    if not task.resume and any((task.out / name).exists() for name in names):
        raise OutputError(f"{task.out} holds a training; --resume goes on with it.")
    Dataset(task.data)
    if task.validation is not None:
        Dataset(task.validation)
    for name in names:
        if _finished(task, name, settings[name].lav) is not None:
            continue
        job = _Job(task, name, settings[name], _parents(task, name, settings[name].lav))
        _work(job, on_pace)
    _note_shared(task, settings)
    if task.export:
        _export(task, names)
    return {name: _measures(task, name, settings[name].lav) for name in names}


def needed(task: TrainTask) -> list[str]:
    """The stages of a task, parents first; of all, what the agent reads and what leads to those not yet finished."""
    config = settings_of(task).lav
    order = stages_of(task.stage, config)
    if task.stage != ALL:
        return order
    found: set[str] = set()
    for name in reversed(order):
        unfinished = [other for other in found if _finished(task, other, config) is None]
        if name in DRIVES or any(name in STAGES[other].needs(config) for other in unfinished):
            found.add(name)
    is_own = {name for name in order if _marker(task.out / name, name).exists()}
    return [name for name in order if name in found | is_own and name not in task.later]


def _note_shared(task: TrainTask, settings: Mapping[str, Settings]) -> None:
    """Notes beside the weights where those that were taken from other trainings lie."""
    found = {name: _finished(task, name, each.lav) for name, each in settings.items() if STAGES[name].is_trained}
    files = {name: _weights(path, name) for name, path in found.items() if path and path != task.out / name}
    if files:
        write_elsewhere(task.out, files)


def _export(task: TrainTask, names: Sequence[str]) -> None:
    for name in names:
        path = _weights(task.out / name, name)
        if name in EXPORTED and path.exists():
            export(path)


def stages_of(name: str, config: LavConfig | None = None) -> list[str]:
    """The stages that a name stands for, parents first; "all" is every one that leads to an end of LAV.

    Args:
        name: A stage's, or "all".
        config: Which may make a stage needless; the paper's if None.

    Raises:
        UnknownName: there is no such stage.
    """
    if name != ALL:
        STAGES[name]
        return [name]
    order: list[str] = []

    def visit(stage: str) -> None:
        for parent in STAGES[stage].needs(config or LavConfig()):
            visit(parent)
        if stage not in order:
            order.append(stage)

    names = [str(stage) for stage in STAGES if STAGES[stage].is_lav]
    parents = {parent for stage in names for parent in STAGES[stage].parents}
    for stage in names:
        if stage not in parents:
            visit(stage)
    return order


def settings_of(task: TrainTask, stage: str | None = None) -> Settings:
    """Sizes and loop of a stage (or only sizes): preset, then variant, then file, then overrides.

    Raises:
        UnknownName: no such preset or variant.
        ConfigError: a setting does not fit.
    """
    base = Settings(lav=find_preset(task.preset), train=STAGES[stage].defaults if stage else TrainConfig())
    if task.variant is not None:
        base = read_config(Settings, None, find_variant(task.variant).sets, base)
    return read_config(Settings, task.config, task.sets, base)


@dataclass(frozen=True)
class _Job:
    """One stage to train; may be handed to other processes.

    Attributes:
        task: Of which it is a part.
        name: The stage.
        settings: Its own.
        parents: Folder of each stage before it.
    """

    task: TrainTask
    name: str
    settings: Settings
    parents: Mapping[str, Path]

    @property
    def folder(self) -> Path:
        """Of the stage."""
        return self.task.out / self.name

    def input(self) -> StageInput:
        """What the stage is made from."""
        validation = Dataset(self.task.validation) if self.task.validation is not None else None
        weights = {name: read_weights(_weights(path, name)) for name, path in self.parents.items()
                   if STAGES[name].is_trained}  # fmt: skip
        lav, loop = self.settings.lav, self.settings.train
        return StageInput(lav, loop, Dataset(self.task.data), validation, weights, dict(self.parents))

    def lineage(self, data: Dataset) -> dict[str, Any]:
        """What the result says of its origin."""
        parents = {name: digest_of_file(_marker(path, name)) for name, path in self.parents.items()}
        start = digest_of_file(self.task.start) if self.task.start is not None else None
        found = {"data": data.root.name, "frames": len(data), "variant": self.task.variant, "start": start}
        return found | {"parents": parents}


def _work(job: _Job, on_pace: OnPace | None) -> None:
    if not STAGES[job.name].is_trained:
        _make(job, on_pace)
        return
    fabric = make_fabric(job.settings.train.precision, job.task.device, job.task.processes)
    if job.task.processes == 1:
        _train_one(fabric, job, on_pace)
        return
    # Fabric takes arguments apart in search of networks, which a frozen dataclass does not stand; a partial it leaves.
    problem = fabric.launch(partial(_train_among_others, job=job))
    if problem is not None:
        raise ConfigError(problem)


def _train_one(fabric: Fabric, job: _Job, on_pace: OnPace | None) -> None:
    torch.set_num_threads(job.task.threads)
    given = job.input()
    stage = STAGES[job.name](given)
    if job.task.start is not None:
        _begin_from(job.task.start, stage, job)
    on_step = None if on_pace is None else lambda pace: on_pace(job.name, pace)
    lav, loop = job.settings.lav, job.settings.train
    _write_settings(job)
    train_stage(job.name, stage, lav, loop, job.folder, job.lineage(given.data), on_step, fabric=fabric)


def _begin_from(path: Path, stage: Stage, job: _Job) -> None:
    """Gives a stage's network the weights in a file, of the same stage and sizes."""
    start = read_weights(path)
    if start.stage != job.name:
        raise ConfigError(f"{path} holds the weights of stage {start.stage!r}, not of {job.name!r}.")
    try:
        stage.network.load_state_dict(start.tensors)
    except RuntimeError:
        raise ConfigError(f"{path} has other sizes ({start.config.name}) than this training.") from None


def _train_among_others(fabric: Fabric, job: _Job) -> str | None:
    """One of several processes; a mistake of the user's is handed back, since it would arrive as a traceback."""
    try:
        _train_one(fabric, job, _tell if fabric.is_global_zero else None)
    except LavsimError as error:
        return str(error)
    return None


def _make(job: _Job, on_pace: OnPace | None) -> None:
    """The work of a stage without a network."""
    given = job.input()
    stage = STAGES[job.name](given)
    _write_settings(job)

    def on_share(share: float) -> None:
        if on_pace is not None:
            on_pace(job.name, Pace(round(share * len(stage)), len(stage), 0.0, 0.0))

    measures = stage.run(job.folder, on_share)
    (job.folder / MEASURES).write_text(json.dumps(measures, indent=1, sort_keys=True) + "\n")
    notes = {"stage": job.name, "config": resolved(job.settings.lav), "lineage": job.lineage(given.data)}
    partial = job.folder / (DONE + ".partial")
    partial.write_text(json.dumps(notes, indent=1, sort_keys=True) + "\n")
    partial.replace(job.folder / DONE)


def _write_settings(job: _Job) -> None:
    if int(torch.distributed.get_rank()) if torch.distributed.is_initialized() else 0:
        return
    job.folder.mkdir(parents=True, exist_ok=True)
    (job.folder / "config.json").write_text(json.dumps(resolved(job.settings), indent=1, sort_keys=True) + "\n")


def _tell(name: str, pace: Pace) -> None:
    if pace.step % _TOLD_EVERY == 0 or pace.step == pace.steps:
        print(describe(name, pace), file=sys.stderr, flush=True)


def describe(name: str, pace: Pace) -> str:
    """A line about a training under way."""
    return (
        f"{name}: step {pace.step}/{pace.steps}, loss {pace.loss:.3f}, {pace.samples_per_s:.1f} samples/s, "
        f"{pace.waiting:.0%} of it waiting for data"
    )


def _finished(task: TrainTask, name: str, config: LavConfig) -> Path | None:
    """Folder in which a stage is finished: its own, or the first shared one in which it has the same sizes."""
    own = task.out / name
    if _marker(own, name).exists():
        _check_sizes(own, name, config)
        return own
    for other in task.shared:
        shared = other / name
        if _marker(shared, name).exists() and _differing(shared, name, config) is None:
            return shared
    return None


def _parents(task: TrainTask, name: str, config: LavConfig) -> dict[str, Path]:
    """Folders of the stages before a stage.

    Raises:
        ConfigError: one is not finished, or of other sizes.
    """
    found = {}
    for parent in STAGES[name].needs(config):
        folder = _finished(task, parent, config)
        if folder is None:
            raise ConfigError(
                f"stage {parent!r} comes first: there are no weights at {str(_marker(task.out / parent, parent))!r}."
            )
        found[parent] = folder
    return found


def _check_sizes(folder: Path, name: str, config: LavConfig) -> None:
    differing = _differing(folder, name, config)
    if differing is not None:
        raise ConfigError(f"{_marker(folder, name)} was trained with another '{differing}' than this training has.")


def _differing(folder: Path, name: str, config: LavConfig) -> str | None:
    """The first of the sizes that matter to a stage in which a finished one differs from a configuration."""
    if STAGES[name].is_trained:
        other = read_weights(_weights(folder, name)).config
    else:
        other = stored_config(json.loads((folder / DONE).read_text())["config"])
    return next((size for size in STAGES[name].sizes if attrgetter(size)(other) != attrgetter(size)(config)), None)


def _measures(task: TrainTask, name: str, config: LavConfig) -> dict[str, float]:
    folder = _finished(task, name, config)
    assert folder is not None
    measures: dict[str, float] = json.loads((folder / MEASURES).read_text())
    return measures


def _marker(folder: Path, name: str) -> Path:
    """The file whose presence says that a stage is finished."""
    return _weights(folder, name) if STAGES[name].is_trained else folder / DONE


def _weights(folder: Path, name: str) -> Path:
    return folder / f"{name}.safetensors"
