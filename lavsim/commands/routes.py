"""List, check and make routes."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any

import typer

from lavsim.commands import complete
from lavsim.commands.base import AsJson, TownPath, app, print_findings, print_list, towns_at
from lavsim.commands.scenarios import ScenarioPath
from lavsim.errors import ConfigError, OutputError, UnknownName


class _RouteCommands(typer.core.TyperGroup):
    """`lavsim routes FILE` stands for `lavsim routes list FILE`."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and not args[0].startswith("-") and not difflib.get_close_matches(args[0], self.commands, 1, 0.75):
            args = ["list", *args]
        return super().resolve_command(ctx, args)


routes_app = typer.Typer(cls=_RouteCommands, help="List, check and make routes.", rich_markup_mode=None)
app.add_typer(routes_app, name="routes")


@routes_app.callback(invoke_without_command=True)
def routes(context: typer.Context, as_json: AsJson = False) -> None:
    """List, check and make routes; without a command, list the bundled ones."""
    if context.invoked_subcommand is None:
        _list_routes(None, as_json)


@routes_app.command("list")
def list_routes(
    file: Annotated[
        str | None,
        typer.Argument(
            help="Name of a bundled route file, or a path; all bundled ones by default.",
            autocompletion=complete.routes,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the routes of a file."""
    _list_routes(file, as_json)


def _list_routes(file: str | None, as_json: bool) -> None:
    from leaderboard.routes import read_routes, route_files

    entries = [
        {
            "file": name,
            "id": entry.id,
            "town": entry.town,
            "waypoint_length": round(entry.length, 1),
            "generation": entry.generation,
            "traffic": entry.traffic or "",
            "scenarios": [s.type for s in entry.scenarios],
        }
        for name in ([file] if file is not None else route_files())
        for entry in read_routes(name)
    ]
    print_list(entries, as_json)


@routes_app.command("check")
def check_routes(
    file: Annotated[
        str, typer.Argument(help="A route file, or the name of a bundled one.", autocompletion=complete.routes)
    ],
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> int:
    """Say what is wrong in a route file; exit code 2 if anything."""
    from leaderboard.route_check import check_routes as findings_of

    return print_findings(file, findings_of(file, towns_at(town_path)), as_json)


@routes_app.command("make")
def make_routes(
    town: Annotated[str, typer.Option(help="Where.", autocompletion=complete.towns)],
    out: Annotated[Path, typer.Option(help="The route file to write.")],
    count: Annotated[int, typer.Option(help="Routes.")] = 10,
    length: Annotated[str, typer.Option(help="Shortest and longest in metres: '500-2000'.")] = "500-2000",
    seed: Annotated[int, typer.Option(help="Of everything that is drawn.")] = 0,
    traffic: Annotated[str, typer.Option(help="Traffic profile of the file: leaderboard, lav or empty.")] = "lav",
    hazard: Annotated[
        list[str] | None, typer.Option(help="Type of hazards to draw from, 'all' for all; may be given again.")
    ] = None,
    spacing: Annotated[float, typer.Option(help="Least distance between such hazards in metres.")] = 200.0,
    weather: Annotated[
        list[str] | None, typer.Option(help="Weather to draw from ('clear noon'); may be given again.")
    ] = None,
    scenario_path: ScenarioPath = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    town_path: TownPath = None,
) -> None:
    """Make random routes through a town, with hazards where they fit; walkers at the kerb if none are chosen."""
    from lavsim.map.town_files import load_town
    from lavsim.random import Draws
    from lavsim.scenarios.user_files import use_folders
    from lavsim.traffic.profiles import TRAFFIC_PROFILES
    from leaderboard.hazard_maker import chosen_types, put_hazards
    from leaderboard.route_maker import WEATHERS, RouteWish
    from leaderboard.route_maker import make_routes as make
    from leaderboard.route_writer import write_routes

    use_folders(scenario_path or [])
    kinds = chosen_types(hazard or [])
    for name in weather or []:
        if name not in WEATHERS:
            raise UnknownName("weather", name, WEATHERS)
    shortest, longest = _interval(length)
    if traffic not in TRAFFIC_PROFILES:
        raise UnknownName("traffic profile", traffic, TRAFFIC_PROFILES)
    if out.exists() and not overwrite:
        raise OutputError(f"{out} is there already; --overwrite replaces it.")
    if not out.parent.is_dir():
        raise OutputError(f"there is no folder {str(out.parent)!r} to write {out.name} into.")
    pairs = tuple((a, b) for a in weather or WEATHERS for b in weather or WEATHERS)
    where = load_town(town, towns_at(town_path))
    entries = make(where, RouteWish(count, shortest, longest, seed, weathers=pairs))
    if kinds:
        draws = Draws.of_seed(seed).stream("hazards")
        entries = [put_hazards(where, e, kinds, spacing, draws.stream(e.id)) for e in entries]
        if not any(entry.scenarios for entry in entries):
            names = ", ".join(kind for _, kind in kinds)
            raise ConfigError(
                f"no route has room for {names}; 'lavsim scenarios --suggest {town} {kinds[0][1]}' lists places, "
                "--count and --seed draw other routes."
            )
    try:
        out.write_bytes(write_routes(entries, traffic))
    except OSError as error:
        raise OutputError(f"can't write {out}: {error.strerror}") from None
    hazards = sum(len(entry.scenarios) for entry in entries)
    typer.echo(f"{out}  {len(entries)} routes, {hazards} hazards")


def _interval(text: str) -> tuple[float, float]:
    low, dash, high = text.partition("-")
    try:
        return float(low), float(high if dash else low)
    except ValueError:
        raise typer.BadParameter(f"--length: expected two numbers like 500-2000, got {text!r}") from None
