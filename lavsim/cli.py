"""The command line: each command builds a configuration and calls one function that a test can call too.

The scorer and the agents are loaded inside the commands that need them: `lavsim --help` stays quick, and the simulator
itself depends on neither.
"""

from __future__ import annotations

import difflib
import json
import logging
import os
import sys
from collections.abc import Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lavsim.errors import LavsimError, OutputError, UnknownName

if TYPE_CHECKING:
    from leaderboard.evaluator import Progress

app = typer.Typer(
    name="lavsim",
    help="Drive and score driving agents in OpenDRIVE towns, on the CPU.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

# Typer carries its own copy of click from some version on; this is the base of its errors in either.
_USAGE_ERROR: Any = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")

AsJson = Annotated[bool, typer.Option("--json", help="One JSON array on stdout and nothing else.")]
TownPath = Annotated[
    list[Path] | None, typer.Option("--town-path", help="Folder with towns (*.xodr); may be given again.")
]


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; the exit code is 0, or 2 for a user's mistake, told in one line on stderr."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s", stream=sys.stderr)
    try:
        code = app(args=None if arguments is None else list(arguments), prog_name="lavsim", standalone_mode=False)
    except LavsimError as error:
        return _refuse(str(error))
    except _USAGE_ERROR as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return 2
        context = getattr(error, "ctx", None)
        return _refuse(
            f"{error.format_message().rstrip('.')}. See '{context.command_path if context else 'lavsim'} --help'."
        )
    except (typer.Abort, KeyboardInterrupt):
        print("lavsim: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # `lavsim … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code if isinstance(code, int) else 0


def _refuse(message: str) -> int:
    print(f"lavsim: {' '.join(message.split())}", file=sys.stderr)
    return 2


@app.command()
def score(
    agent: Annotated[str, typer.Option(help="'module:Class', 'file.py' or 'file.py:Class'.")],
    routes: Annotated[str, typer.Option(help="Name of a bundled route file, or a path.")] = "quick",
    out: Annotated[Path, typer.Option(help="Folder for the run.")] = Path("runs/score"),
    agent_config: Annotated[str | None, typer.Option(help="Handed to the agent's setup.")] = None,
    rules: Annotated[str, typer.Option(help="1.0, 2.0, 2.1 or bench2drive.")] = "1.0",
    seed: Annotated[int, typer.Option(help="Root of everything that is drawn.")] = 0,
    route_ids: Annotated[str | None, typer.Option(help="Some routes of the file: '0,3-5'.")] = None,
    scenarios_json: Annotated[
        Path | None, typer.Option("--scenarios-json", help="Hazards of 1.0, matched with the routes.")
    ] = None,
    repetitions: Annotated[int, typer.Option(help="Drives of each route.")] = 1,
    track: Annotated[str | None, typer.Option(help="Track the agent must be on; its own by default.")] = None,
    traffic: Annotated[str | None, typer.Option(help="leaderboard, lav or empty, where the file names none.")] = None,
    sensors: Annotated[str | None, typer.Option(help="Suite rendered beside the agent's own sensors: lav.")] = None,
    latency: Annotated[
        str, typer.Option(help="Controls act late: ticks ('3'), a time ('0.12s'), or as measured in a run's folder.")
    ] = "0",
    town_path: TownPath = None,
    workers: Annotated[int, typer.Option(help="Processes that drive side by side; the results are the same.")] = 1,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Ray cluster that drives; 'local' starts one.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in the folder.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run in the folder.")] = False,
    drawings: Annotated[bool, typer.Option("--drawings", help="Keep what the agent shows of its inner view.")] = False,
) -> None:
    """Drive an agent over routes and score it by the leaderboard's rules."""
    from leaderboard.evaluator import EvaluationConfig, evaluate
    from leaderboard.latency import latency_ticks

    config = EvaluationConfig.of(
        agent=agent,
        routes=routes,
        out=out,
        agent_config=agent_config,
        rules=rules,
        seed=seed,
        route_ids=route_ids,
        scenarios_json=scenarios_json,
        repetitions=repetitions,
        track=track,
        traffic=traffic,
        sensors=sensors,
        latency=latency_ticks(latency),
        town_path=_towns_at(town_path),
        workers=workers,
        cluster=cluster,
        resume=resume,
        overwrite=overwrite,
        drawings=drawings,
    )
    with _Bar() as bar:
        run = evaluate(config, bar.update)
    from leaderboard.table import run_table

    _print(run_table(run))
    typer.echo(f"{out / 'results.json'}  {out / 'report.html'}")


@app.command()
def rescore(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    rules: Annotated[str, typer.Option(help="1.0, 2.0, 2.1 or bench2drive.")],
    out: Annotated[Path | None, typer.Option(help="Folder of the new run; below the old one by default.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run in the folder.")] = False,
    town_path: TownPath = None,
) -> None:
    """Judge recorded drives again by other rules, without driving."""
    from leaderboard.rescore import rescore as judge_again
    from leaderboard.table import run_table

    made = judge_again(run, rules, out, overwrite, _towns_at(town_path))
    _print(run_table(made))
    typer.echo(f"{made.folder / 'results.json'}  {made.folder / 'report.html'}")


@app.command()
def merge(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or results files of the leaderboard.")],
    out: Annotated[Path, typer.Option(help="Folder of the joined run.")],
    rules: Annotated[str | None, typer.Option(help="What results files were written under.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run in the folder.")] = False,
) -> None:
    """Join runs that shared out the routes of one benchmark."""
    from leaderboard.merge import merge as join
    from leaderboard.run import Run
    from leaderboard.table import run_table

    join(runs, out, rules, overwrite)
    _print(run_table(Run.load(out)))
    typer.echo(str(out / "results.json"))


@app.command()
def report(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    out: Annotated[
        Path | None, typer.Option(help="Where the comparison of several runs goes; comparison.html of the first.")
    ] = None,
) -> None:
    """Print the tables of runs, write their reports and replays again, and compare several of them."""
    from leaderboard.report.comparison import check_comparable, write_comparison
    from leaderboard.report.page import write_report
    from leaderboard.run import Run
    from leaderboard.table import run_table

    loaded = [Run.load(folder) for folder in runs]
    check_comparable(loaded)
    for run in loaded:
        if len(loaded) > 1:
            typer.echo(str(run.folder))
        _print(run_table(run))
        write_report(run)
    if len(loaded) > 1:
        typer.echo(str(write_comparison(loaded, out)))


@app.command()
def towns(
    check: Annotated[
        Path | None,
        typer.Option("--check", help="An OpenDRIVE file: say what is wrong in it; exit code 2 if anything."),
    ] = None,
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> int:
    """List the towns there are, or check a road network of one's own."""
    if check is not None:
        from lavsim.map.check import check_file

        if not check.is_file():
            raise OutputError(f"there is no file {str(check)!r} to check.")
        return _verdict(str(check), check_file(check), as_json)
    from lavsim.map.town_map import load_town, town_names
    from lavsim.towns.facts import facts_of
    from lavsim.types import LaneType

    search = _towns_at(town_path)
    entries: list[dict[str, Any]] = []
    for name in town_names(search):
        facts = facts_of(name)
        try:
            town = load_town(name, search)
        except LavsimError as error:
            entries.append({"name": name, "error": str(error)})
            continue
        driving = town.lanes.where(LaneType.DRIVING)
        entries.append(
            {
                "name": name,
                "split": facts.split if facts else "",
                "road_km": round(sum(road.length for road in town.network.roads if road.junction < 0) / 1000.0, 2),
                "lane_km": round(float(town.lanes.length[driving].sum()) / 1000.0, 2),
                "junctions": len(town.junctions),
                "lights": len(town.lights),
                "vehicles": facts.vehicles if facts else "",
                "layout": facts.layout if facts else "",
                "digest": town.digest,
            }
        )
    if as_json:
        _list(entries, True)
    else:
        _list([{key: value for key, value in entry.items() if key != "digest"} for entry in entries], False)
    return 0


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
        str | None, typer.Argument(help="Name of a bundled route file, or a path; all bundled ones by default.")
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
    _list(entries, as_json)


@routes_app.command("check")
def check_routes(
    file: Annotated[str, typer.Argument(help="A route file, or the name of a bundled one.")],
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> int:
    """Say what is wrong in a route file; exit code 2 if anything."""
    from leaderboard.route_check import check_routes as findings_of

    return _verdict(file, findings_of(file, _towns_at(town_path)), as_json)


@routes_app.command("make")
def make_routes(
    town: Annotated[str, typer.Option(help="Where.")],
    out: Annotated[Path, typer.Option(help="The route file to write.")],
    count: Annotated[int, typer.Option(help="Routes.")] = 10,
    length: Annotated[str, typer.Option(help="Shortest and longest in metres: '500-2000'.")] = "500-2000",
    seed: Annotated[int, typer.Option(help="Of everything that is drawn.")] = 0,
    traffic: Annotated[str, typer.Option(help="Traffic profile of the file: leaderboard, lav or empty.")] = "lav",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    town_path: TownPath = None,
) -> None:
    """Make random routes through a town, with hazards where they fit."""
    from lavsim.map.town_map import load_town
    from lavsim.traffic.profiles import TRAFFIC_PROFILES
    from leaderboard.route_maker import RouteWish
    from leaderboard.route_maker import make_routes as make
    from leaderboard.route_writer import write_routes

    shortest, longest = _interval(length)
    if traffic not in TRAFFIC_PROFILES:
        raise UnknownName("traffic profile", traffic, TRAFFIC_PROFILES)
    if out.exists() and not overwrite:
        raise OutputError(f"{out} is there already; --overwrite replaces it.")
    if not out.parent.is_dir():
        raise OutputError(f"there is no folder {str(out.parent)!r} to write {out.name} into.")
    entries = make(load_town(town, _towns_at(town_path)), RouteWish(count, shortest, longest, seed))
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


def _verdict(what: str, findings: Sequence[str], as_json: bool) -> int:
    """Prints what a check found; the exit code."""
    if as_json:
        typer.echo(json.dumps([{"file": what, "finding": finding} for finding in findings], ensure_ascii=False))
    else:
        for finding in findings:
            typer.echo(" ".join(finding.split()))
        if not findings:
            typer.echo(f"{what}: nothing is wrong.")
    return 2 if findings else 0


@app.command()
def agents(as_json: AsJson = False) -> None:
    """List the agents that ship."""
    from lavsim.agent_source import packaged_agents

    _list([{"agent": target, "summary": summary} for target, summary in packaged_agents()], as_json)


@app.command()
def sensors(as_json: AsJson = False) -> None:
    """List the sensors an agent may ask for."""
    from lavsim.sensors.base import SENSORS

    _list(
        [
            {"type": str(key), "privileged": bool(SENSORS[key].privileged), "summary": _summary(SENSORS[key])}
            for key in SENSORS
        ],
        as_json,
    )


@app.command()
def scenarios(as_json: AsJson = False) -> None:
    """List the hazards a route file may name."""
    from lavsim.scenarios.base import SCENARIOS

    entries = []
    for key in SCENARIOS:
        assert isinstance(key, tuple)
        scenario = SCENARIOS[key]
        entries.append(
            {
                "type": key[1],
                "generation": key[0],
                "summary": _summary(scenario),
                "parameters": {f.name: f.default for f in fields(scenario.Config) if f.default is not MISSING},
            }
        )
    _list(entries, as_json)


@app.command()
def show(
    what: Annotated[
        str, typer.Argument(help="A town, a route file (or bundled name), the folder of a run, or a *.lavlog.")
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; runs/show by default.")] = None,
    route_ids: Annotated[str | None, typer.Option(help="Some routes of a file: '0,3-5'.")] = None,
    html: Annotated[Path | None, typer.Option(help="Of a log: the replay, one page for the browser.")] = None,
    video: Annotated[Path | None, typer.Option(help="Of a log: a film, *.mp4, *.webm or *.gif.")] = None,
    strip: Annotated[Path | None, typer.Option(help="Of a log: a film strip of a moment, *.png.")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Of a log: a contact sheet of a moment, *.png.")] = None,
    at: Annotated[float | None, typer.Option(help="The moment [s]; the first infraction by default.")] = None,
    begin: Annotated[float | None, typer.Option("--from", help="Where the film begins [s].")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Where the film ends [s].")] = None,
    speed: Annotated[float, typer.Option(help="Of the film; 2 is twice as fast as the drive.")] = 1.0,
    panes: Annotated[bool, typer.Option("--panes", help="Cameras and LiDAR beside replay and film.")] = False,
    weathers: Annotated[
        str | None, typer.Option(help="Of a town: a sheet for each weather, 'lav', '1.0', '2.x'.")
    ] = None,
    town_path: TownPath = None,
) -> None:
    """Draw a town, routes, the drives of a run, or look at a recorded drive; prints the paths of the files."""
    search, folder = _towns_at(town_path), out or Path("runs/show")
    kind = _kind_of(what, search)
    if kind == "log":
        from lavsim.viewer.film import Cut
        from leaderboard.show import Wish, show_log

        if speed <= 0.0:
            raise typer.BadParameter(f"--speed: expected more than 0, got {speed:g}")
        stem = folder / Path(what).stem
        if not (html or video or strip or sheet):
            html, sheet = stem.with_suffix(".html"), stem.with_suffix(".png")
        wish = Wish(html, video, strip, sheet, at, panes, Cut(begin, end, speed=speed, panes=panes))
        with _Shares() as shares:
            pictures = show_log(Path(what), wish, search, shares.update)
    elif kind == "town":
        from lavsim.map.town_map import load_town
        from lavsim.render.birdseye import draw_town
        from lavsim.render.canvas import write_png

        folder.mkdir(parents=True, exist_ok=True)
        pictures = [folder / f"{what}.png"]
        write_png(draw_town(load_town(what, search)).image, pictures[0])
        if weathers is not None:
            from lavsim.sheets import weather_sheets
            from lavsim.world.weather_presets import weathers_of

            pictures += weather_sheets(load_town(what, search), weathers_of(weathers), folder)
    elif kind == "routes":
        from leaderboard.picture import draw_routes

        pictures = draw_routes(what, folder, route_ids, search)
    else:
        from leaderboard.run import Run

        run = Run.load(Path(what))
        pictures = sorted((run.folder / "pictures").glob("*.png"))
        if not pictures:
            raise OutputError(f"{what} has no pictures")
    for picture in pictures:
        typer.echo(str(picture))


@app.command()
def bench(as_json: Annotated[bool, typer.Option("--json", help="One JSON object and nothing else.")] = False) -> None:
    """Measure how fast each part runs on this machine."""
    from lavsim.bench import bench as measure

    figures = measure()
    if as_json:
        typer.echo(json.dumps(figures))
    else:
        _list([{"figure": name, "value": f"{value:.4g}"} for name, value in figures.items()], False)


def _kind_of(what: str, search: tuple[Path, ...]) -> str:
    from lavsim.map.town_map import town_names
    from leaderboard.routes import route_files

    if Path(what).is_dir():
        return "run"
    if what.endswith(".lavlog"):
        return "log"
    names, files = town_names(search), route_files()
    if what in names:
        return "town"
    if what in files or what.endswith(".xml"):
        return "routes"
    raise UnknownName("town, route file, run or log", what, [*names, *files])


def _towns_at(folders: list[Path] | None) -> tuple[Path, ...]:
    """The search path for towns."""
    given = tuple(folders or ())
    for folder in given:
        if not folder.is_dir():
            raise OutputError(f"--town-path: there is no folder {str(folder)!r}.")
    return given


def _summary(thing: Any) -> str:
    return (thing.__doc__ or "").strip().split("\n")[0]


def _list(entries: list[dict[str, Any]], as_json: bool) -> None:
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
    _print(table)


def _cell(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{k}={v}" for k, v in value.items())
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _print(content: Any) -> None:
    from rich.console import Console

    console = Console()
    # Into a file or a pipe the table keeps its own width instead of being folded at 80 columns.
    (console if console.is_terminal else Console(width=160)).print(content)


class _Shares:
    """Progress of one thing after another on stderr."""

    def __enter__(self) -> _Shares:
        from rich.console import Console
        from rich.progress import Progress as Bars

        self._bars = Bars(console=Console(stderr=True), transient=True)
        self._tasks: dict[str, Any] = {}
        if self._bars.console.is_terminal:
            self._bars.start()
        return self

    def update(self, name: str, share: float) -> None:
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=1.0)
        self._bars.update(self._tasks[name], completed=share)

    def __exit__(self, *_: object) -> None:
        if self._bars.live.is_started:
            self._bars.stop()


class _Bar:
    """Progress of a run on stderr: share of all drives, time left, and a line for each drive done."""

    def __enter__(self) -> _Bar:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars

        self._console = Console(stderr=True)
        self._bars = Bars(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
        )
        self._task = self._bars.add_task("preparing (the first run on a machine compiles for a minute)", total=1.0)
        self._told: set[int] = set()  # drives that have had their line
        if self._console.is_terminal:  # elsewhere a mistake found before the first drive gets its one line and no more
            self._bars.start()
        return self

    def update(self, progress: Progress) -> None:
        self._bars.start()
        records = progress.results.records
        for record in (r for r in records if r.index not in self._told):
            self._console.print(
                f"{len(records)}/{progress.total} {record.route_id}: {record.status}, "
                f"score {record.scores.composed:.1f}" + (f" ({progress.failure})" if progress.failure else ""),
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
        self._told = {record.index for record in records}
        text = f"{progress.name} in {progress.town}, {progress.game_time:.0f} s" if progress.town else progress.name
        if records:
            text += f", mean score {sum(r.scores.composed for r in records) / len(records):.1f}"
        self._bars.update(self._task, description=text, completed=min(progress.share, 1.0))

    def __exit__(self, *_: object) -> None:
        if self._bars.live.is_started:
            self._bars.stop()
