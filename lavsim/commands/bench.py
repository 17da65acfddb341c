"""How fast each part runs."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from lavsim.commands.base import app, print_list


@app.command()
def bench(as_json: Annotated[bool, typer.Option("--json", help="One JSON object and nothing else.")] = False) -> None:
    """Measure how fast each part runs on this machine."""
    from lavsim.bench import bench as measure

    figures = measure()
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        print_list([{"figure": name, "value": f"{value:.4g}"} for name, value in figures.items()], False)
