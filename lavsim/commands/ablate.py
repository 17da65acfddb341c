"""The paper's ablations, trained and driven."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lavsim.commands.base import app
from lavsim.errors import ConfigError

if TYPE_CHECKING:
    from agents.lav.ablation import Scores, Training
    from agents.lav.records import Pace
    from leaderboard.run import Run

_TOLD_EVERY = 50  # steps
_AGENT = "agents.lav:LavAgent"


@app.command()
def ablate(
    data: Annotated[Path, typer.Option(help="Dataset to learn from.")],
    out: Annotated[Path, typer.Option(help="Folder of all trainings and runs, and of the tables.")],
    tables: Annotated[
        list[str] | None, typer.Option("--table", help="components, radius, perception, refinement; all without.")
    ] = None,
    rows: Annotated[
        list[str] | None, typer.Option("--row", help="Some rows of them: 'ego-only', 'refinements-0'.")
    ] = None,
    preset: Annotated[str, typer.Option(help="Sizes: tiny, small, paper, micro.")] = "tiny",
    validation: Annotated[Path | None, typer.Option(help="Dataset of unseen towns, to measure on.")] = None,
    config: Annotated[Path | None, typer.Option(help="TOML with fields of 'lav' and 'train'.")] = None,
    sets: Annotated[list[str] | None, typer.Option("--set", help="A field: 'train.epochs=3'.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Trainings of each row; their drives have the same seeds.")] = 1,
    routes: Annotated[str, typer.Option(help="Name of a bundled route file, or a path.")] = "validation",
    route_ids: Annotated[str | None, typer.Option(help="Some routes of the file: '0,3-5'.")] = None,
    shipped_eyes: Annotated[
        bool, typer.Option("--shipped-eyes", help="Segmentation and brake network are those that ship.")
    ] = False,
    workers: Annotated[int, typer.Option(min=1, help="Rows that are trained and driven side by side.")] = 1,
    device: Annotated[str, typer.Option(help="cpu, cuda, or auto: where it trains.")] = "cpu",
) -> None:
    """Train and drive what the paper's tables compare; stages that do not differ are trained once. Goes on where it
    was stopped."""
    try:
        from agents.lav import ablation
        from agents.lav.train import TrainTask
    except ImportError as error:
        raise ConfigError(f"ablations need {error.name}: pip install 'lavsim[lav]'.") from None

    asked = ablation.tables_of(tables or [], rows or [])
    eyes = [ablation.shipped_eyes(out / "shipped", preset)] if shipped_eyes else []
    task = TrainTask("all", data, out, preset, validation, config, sets or (), device=device, shared=eyes)
    trainings, stands_for = ablation.trainings_of([name for rows in asked.values() for name in rows], seeds, task)
    whole = [training for training in trainings if training.variant == ablation.FULL]
    for training in _each(_train_shared, whole, workers):
        typer.echo(f"{training.variant}, seed {training.seed}: what others share is trained")
    for training in _each(partial(_train_and_drive, routes=routes, ids=route_ids), trainings, workers):
        typer.echo(f"{training.variant}, seed {training.seed}: done")
    text = "\n".join(_tables(asked, trainings, stands_for))
    (out / "ablations.md").write_text(text)
    typer.echo(text)


def _each(work: Callable[[Training], Training], trainings: Sequence[Training], workers: int) -> Iterable[Training]:
    if workers == 1:
        yield from map(work, trainings)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(work, trainings)


def _train_shared(training: Training) -> Training:
    from agents.lav.ablation import LAST
    from agents.lav.train import train

    train(replace(training.task, later=[LAST]), _Teller(training))
    return training


class _Teller:
    """Prints a line about a training now and then; several train side by side, so there is no bar."""

    def __init__(self, training: Training) -> None:
        self._title = f"{training.variant}, seed {training.seed}"
        self._stage, self._began, self._first = "", 0.0, 0

    def __call__(self, stage: str, pace: Pace) -> None:
        from agents.lav.train import describe

        if stage != self._stage:
            self._stage, self._began, self._first = stage, time.monotonic(), pace.step
        if pace.step % _TOLD_EVERY == 0 or pace.step == pace.steps:
            each = (time.monotonic() - self._began) / max(pace.step - self._first, 1)
            left = timedelta(seconds=round(each * (pace.steps - pace.step)))
            typer.echo(f"{self._title}: {describe(stage, pace)}, {left} left", err=True)


def _train_and_drive(training: Training, routes: str, ids: str | None) -> Training:
    from agents.lav.train import train
    from leaderboard.config import EvaluationConfig
    from leaderboard.evaluator import evaluate

    train(training.task, _Teller(training))
    evaluate(EvaluationConfig.of(
        agent=_AGENT, agent_config=str(training.task.out), routes=routes, route_ids=ids, seed=training.seed,
        out=training.runs, resume=True,
    ))  # fmt: skip
    return training


def _tables(asked: dict[str, list[str]], trainings: Sequence[Training], stands_for: dict[str, str]) -> Iterable[str]:
    from agents.lav.ablation import FULL, table_text
    from leaderboard.run import Run

    runs = {name: [Run.load(each.runs) for each in trainings if each.variant == name] for name in stands_for.values()}
    for title, rows in asked.items():
        yield table_text(title, {row: _scores(runs[FULL], runs[stands_for[row]]) for row in rows})


def _scores(base: Sequence[Run], runs: Sequence[Run]) -> Scores:
    from agents.lav.ablation import Scores
    from leaderboard.report.compare import compare

    scores = Scores([_mean(run, "score_composed") for run in runs], [_mean(run, "score_route") for run in runs])
    if runs is base:
        return scores
    found = compare(_pooled(base), _pooled(runs)).differences[0]
    smallest = found.smallest if math.isfinite(found.smallest) else math.inf
    return replace(scores, difference=found.mean, low=found.low, high=found.high, smallest=smallest)


def _mean(run: Run, name: str) -> float:
    return sum(float(record["scores"][name]) for record in run.records) / max(len(run.records), 1)


def _pooled(runs: Sequence[Run]) -> Run:
    """All drives of runs as those of one."""
    from leaderboard.run import Run

    records: list[dict[str, Any]] = []
    drives: list[dict[str, Any]] = []
    for run in runs:
        for record in run.records:
            drives.append({**run.drive(record["index"]), "index": len(records)})
            records.append({**record, "index": len(records)})
    return Run(runs[0].folder, {"_checkpoint": {"records": records}}, {"drives": drives})
