"""What commands share: the application they register on, common options, and how they print."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from lavsim.errors import OutputError

app = typer.Typer(
    name="lavsim",
    help="Drive and score driving agents in OpenDRIVE towns, on the CPU.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _tell_version(asked: bool) -> None:
    if asked:
        from lavsim import __version__

        typer.echo(__version__)
        raise typer.Exit()


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_tell_version, help="Print the version and leave.")
    ] = False,
) -> None:
    pass


AsJson = Annotated[bool, typer.Option("--json", help="One JSON array on stdout and nothing else.")]
TownPath = Annotated[
    list[Path] | None, typer.Option("--town-path", help="Folder with towns (*.xodr); may be given again.")
]


def towns_at(folders: list[Path] | None) -> tuple[Path, ...]:
    """The search path for towns."""
    given = tuple(folders or ())
    for folder in given:
        if not folder.is_dir():
            raise OutputError(f"--town-path: there is no folder {str(folder)!r}.")
    return given


def summary_of(thing: Any) -> str:
    return (thing.__doc__ or "").strip().split("\n")[0]


def print_list(entries: list[dict[str, Any]], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(entries, ensure_ascii=False))
        return
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    columns = list(dict.fromkeys(key for entry in entries for key in entry))
    table = Table(*(c.replace("_", " ") for c in columns), box=SIMPLE_HEAD, pad_edge=False)
    for entry in entries:
        table.add_row(*(Text(_cell(entry.get(column, ""))) for column in columns))
    print_rich(table)


def _cell(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{k}={v}" for k, v in value.items())
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def print_rich(content: Any) -> None:
    from rich.console import Console

    console = Console()
    # Into a file or a pipe the table keeps its own width instead of being folded at 80 columns.
    (console if console.is_terminal else Console(width=160)).print(content)


def print_findings(what: str, findings: Sequence[str], as_json: bool) -> int:
    """Prints what a check found; the exit code."""
    if as_json:
        typer.echo(json.dumps([{"file": what, "finding": finding} for finding in findings], ensure_ascii=False))
    else:
        for finding in findings:
            typer.echo(" ".join(finding.split()))
        if not findings:
            typer.echo(f"{what}: nothing is wrong.")
    return 2 if findings else 0
