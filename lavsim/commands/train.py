"""Train LAV's stages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lavsim.commands.base import app
from lavsim.commands.progress import Shares
from lavsim.errors import ConfigError


@app.command()
def train(
    stage: Annotated[str, typer.Argument(help="A stage, or 'all': those before it first.")],
    data: Annotated[Path, typer.Option(help="Dataset to learn from.")],
    out: Annotated[Path, typer.Option(help="Folder of the weights.")],
    preset: Annotated[str, typer.Option(help="Sizes: tiny, small, paper, micro.")] = "tiny",
    validation: Annotated[Path | None, typer.Option(help="Dataset of towns it has not seen, to measure on.")] = None,
    config: Annotated[Path | None, typer.Option(help="TOML with fields of 'lav' and 'train'.")] = None,
    sets: Annotated[list[str] | None, typer.Option("--set", help="A field: 'train.epochs=3'.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the training in the folder.")] = False,
    threads: Annotated[int, typer.Option(help="Threads of each process.")] = 1,
    variant: Annotated[
        str | None, typer.Option(help="A row of the paper's tables: 'ego-only', 'refinements-1'.")
    ] = None,
    shared: Annotated[
        list[Path] | None, typer.Option(help="Another training's folder: stages that do not differ are taken from it.")
    ] = None,
    device: Annotated[str, typer.Option(help="cpu, cuda, or auto.")] = "cpu",
    processes: Annotated[int, typer.Option(min=1, help="Processes that share each batch: cores, or GPUs.")] = 1,
    start: Annotated[Path | None, typer.Option(help="Weights that the stage begins from.")] = None,
    export: Annotated[bool, typer.Option(help="Write networks as TorchScript too, for fast inference.")] = False,
) -> None:
    """Train one stage of LAV, or all of them; what is finished is not trained again."""
    try:
        from agents.lav.train import TrainTask, describe
        from agents.lav.train import train as run
    except ImportError as error:
        raise ConfigError(f"training needs {error.name}: pip install 'lavsim[lav]'.") from None

    task = TrainTask(
        stage, data, out, preset, validation, config, sets or (), resume, threads, variant, shared or (), device,
        processes, start, export,
    )  # fmt: skip
    with Shares() as shares:
        measures = run(task, lambda name, pace: shares.update(name, pace.step / pace.steps, describe(name, pace)))
    for name, values in measures.items():
        typer.echo(f"{name}: {json.dumps({key: round(value, 4) for key, value in values.items()})}")
