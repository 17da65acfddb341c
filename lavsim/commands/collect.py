"""Make datasets: collect, render."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lavsim.commands.base import TownPath, app, towns_at

if TYPE_CHECKING:
    from lavsim.dataset.tally import Progress


@app.command()
def collect(
    out: Annotated[Path, typer.Option(help="Folder of the dataset.")],
    towns: Annotated[str, typer.Option(help="Names, or 'training', 'test', 'full': 'eu_small_a,us_large_a'.")] = "",
    frames: Annotated[int | None, typer.Option(help="Kept frames, 4 a second of driving.")] = None,
    hours: Annotated[float | None, typer.Option(help="The same in hours of driving.")] = None,
    seed: Annotated[int | None, typer.Option(help="Root of everything that is drawn.")] = None,
    weathers: Annotated[
        str | None, typer.Option(help="'lav' (drawn anew every 10 s), or presets: 'ClearNoon,HardRainSunset'.")
    ] = None,
    traffic: Annotated[str | None, typer.Option(help="leaderboard, lav or empty.")] = None,
    vehicles: Annotated[
        str | None, typer.Option(help="Fewest and most: '20-120'; the town's number by default.")
    ] = None,
    walkers: Annotated[str | None, typer.Option(help="Fewest and most: '0-60'; the town's number by default.")] = None,
    hazards: Annotated[str | None, typer.Option(help="'none', 'lav', 'all', or types: 'Scenario3,Accident'.")] = None,
    hazards_per_km: Annotated[float | None, typer.Option(help="Places for hazards along a route.")] = None,
    length: Annotated[str | None, typer.Option(help="Of routes in metres: '150-1000'.")] = None,
    sensors: Annotated[str | None, typer.Option(help="Sensor suite: lav_data, lav.")] = None,
    look: Annotated[str | None, typer.Option(help="Of the cameras: fast or full.")] = None,
    noise: Annotated[bool, typer.Option("--noise", help="Disturb the steering in short bursts.")] = False,
    agent: Annotated[str | None, typer.Option(help="Who drives: 'module:Class'.")] = None,
    agent_config: Annotated[str | None, typer.Option(help="Handed to the agent's setup.")] = None,
    log_only: Annotated[
        bool, typer.Option("--log-only", help="Keep the logs alone; 'lavsim render' makes the rest of them.")
    ] = False,
    config: Annotated[Path | None, typer.Option(help="TOML with fields of the plan; options come on top.")] = None,
    sets: Annotated[list[str] | None, typer.Option("--set", help="A field of the plan: 'noise.push=1.5'.")] = None,
    workers: Annotated[int, typer.Option(help="Processes that drive side by side; the dataset is the same.")] = 1,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Ray cluster that drives; 'local' starts one.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the dataset in the folder.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a dataset in the folder.")] = False,
    town_path: TownPath = None,
) -> None:
    """Drive the behaviour agent through random routes and record a dataset."""
    from lavsim.config import parse_config, read_config
    from lavsim.dataset.collect import collect as run
    from lavsim.dataset.hazards import named_hazards
    from lavsim.dataset.plan import FRAMES_PER_HOUR, CollectPlan, named_towns

    if frames is not None and hours is not None:
        raise typer.BadParameter("--frames and --hours say the same: give one of them")
    given: dict[str, Any] = {
        "towns": named_towns(towns) if towns else None,
        "frames": frames if hours is None else max(round(hours * FRAMES_PER_HOUR), 1),
        "seed": seed,
        "weathers": _names(weathers),
        "traffic": traffic,
        "vehicles": _interval("--vehicles", vehicles),
        "walkers": _interval("--walkers", walkers),
        "hazards": named_hazards(hazards) if hazards is not None else None,
        "hazards_per_km": hazards_per_km,
        "length": _interval("--length", length),
        "suite": sensors,
        "look": look,
        "noise": {} if noise else None,
        "agent": agent,
        "agent_config": agent_config,
        "log_only": log_only or None,
    }
    base = read_config(CollectPlan, config)
    plan = parse_config(CollectPlan, {**base.model_dump(), **{k: v for k, v in given.items() if v is not None}})
    plan = read_config(CollectPlan, sets=sets or (), base=plan)
    with _FramesBar("collecting") as bar:
        made = run(
            plan,
            out,
            workers=workers,
            cluster=cluster,
            resume=resume,
            overwrite=overwrite,
            town_path=towns_at(town_path),
            on_progress=bar.update,
        )
    typer.echo(f"{out}  {made.frames} frames in {len(made.records)} episodes, {_size(made.bytes)}")


@app.command()
def fork(
    runs: Annotated[list[Path], typer.Argument(help="Runs of 'lavsim score' whose failures are to be done better.")],
    out: Annotated[Path, typer.Option(help="Folder of the logs that are written.")],
    before: Annotated[float | None, typer.Option(help="The expert takes over so long before a failure [s].")] = None,
    after: Annotated[float | None, typer.Option(help="And drives for so long [s].")] = None,
    kinds: Annotated[
        str | None, typer.Option(help="Infractions that count: 'collisions_pedestrian,red_light'; all without.")
    ] = None,
    agent: Annotated[str | None, typer.Option(help="Who takes over: 'module:Class'.")] = None,
    agent_config: Annotated[str | None, typer.Option(help="Handed to its setup.")] = None,
    workers: Annotated[int, typer.Option(help="Processes that drive side by side.")] = 1,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the logs in the folder.")] = False,
    town_path: TownPath = None,
) -> None:
    """Let an expert take over before each failure of recorded drives; 'lavsim render' makes a dataset of the logs."""
    from lavsim.config import parse_config
    from lavsim.dataset.fork import ForkConfig
    from lavsim.dataset.fork import fork as run_forks
    from leaderboard.failures import failures_of, named_kinds
    from leaderboard.run import Run

    given = {"before": before, "after": after, "agent": agent, "agent_config": agent_config}
    config = parse_config(ForkConfig, {name: value for name, value in given.items() if value is not None})
    wanted = named_kinds(kinds)
    failures = [failure for path in runs for failure in failures_of(Run.load(path), wanted)]
    if not failures:
        typer.echo("no failures, no forks")
        return
    made = run_forks(failures, out, config, workers=workers, resume=resume, town_path=towns_at(town_path),
                     on_done=lambda task, ending: typer.echo(
                         f"{task.out.name}  {task.failure.log.stem}, {task.failure.what}: {ending}"))  # fmt: skip
    typer.echo(f"{len(made)} logs in {out}; next: lavsim render {out} --out DATA")


@app.command()
def render(
    source: Annotated[Path, typer.Argument(help="A dataset, a log (*.lavlog), or a folder of logs.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the dataset that is made; a dataset of logs alone gets its own.")
    ] = None,
    sensors: Annotated[str | None, typer.Option(help="Sensor suite; the dataset's own, or lav_data.")] = None,
    look: Annotated[str | None, typer.Option(help="Of the cameras: fast or full.")] = None,
    no_labels: Annotated[
        bool, typer.Option("--no-labels", help="Don't ask the agents that drove again what they thought.")
    ] = False,
    workers: Annotated[int, typer.Option(help="Processes that render side by side; the bytes are the same.")] = 1,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Ray cluster that renders; 'local' starts one.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the dataset in --out.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a dataset in --out.")] = False,
    town_path: TownPath = None,
) -> None:
    """Make tables and sensor readings for recorded drives, without driving again."""
    from lavsim.dataset.rerender import render as run

    with _FramesBar("rendering") as bar:
        made = run(
            source,
            out,
            suite=sensors,
            look=look,
            labels=not no_labels,
            workers=workers,
            cluster=cluster,
            resume=resume,
            overwrite=overwrite,
            town_path=towns_at(town_path),
            on_progress=bar.update,
        )
    typer.echo(f"{made.root}  {made.frames} frames in {len(made.records)} episodes, {_size(made.bytes)}")


class _FramesBar:
    """Frames, frames a second, time left and bytes on stderr, and a line for each episode."""

    def __init__(self, verb: str) -> None:
        self._verb = verb

    def __enter__(self) -> _FramesBar:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as Bars

        self._console = Console(stderr=True)
        self._bars = Bars(
            TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[rest]}"),
            console=self._console, transient=True,
        )  # fmt: skip
        self._task = self._bars.add_task("preparing (the first run on a machine compiles for minutes)", rest="")
        self._begun: float | None = None
        if self._console.is_terminal:  # elsewhere a mistake found before the first drive gets its one line and no more
            self._bars.start()
        return self

    def update(self, progress: Progress) -> None:
        self._begun = self._begun or time.monotonic()
        rate = progress.fresh / max(time.monotonic() - self._begun, 1e-3)
        if progress.last is not None:
            last = progress.last
            self._console.print(
                f"{progress.frames}/{progress.wanted} episode {last.episode} in {last.town}: {last.frames} frames, "
                f"{last.ending}; {rate:.1f} frames/s, {_size(progress.bytes)}",
                highlight=False,
                markup=False,
                soft_wrap=True,
            )
        left = _duration(max(progress.wanted - progress.frames, 0) / rate) if rate > 0.0 else "?"
        self._bars.update(
            self._task,
            description=f"{self._verb} {progress.frames}/{progress.wanted} frames",
            completed=100.0 * min(progress.frames / max(progress.wanted, 1), 1.0),
            rest=f"{rate:.1f} frames/s, {left} left, {_size(progress.bytes)} ({_size(progress.free)} free)",
        )

    def __exit__(self, *_: object) -> None:
        if self._bars.live.is_started:
            self._bars.stop()


def _names(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(name.strip() for name in text.split(",") if name.strip())


def _interval(option: str, text: str | None) -> tuple[float, float] | None:
    """Two numbers, 20-120, or one."""
    if text is None:
        return None
    low, dash, high = text.partition("-")
    try:
        return float(low), float(high if dash else low)
    except ValueError:
        raise typer.BadParameter(f"{option}: expected two numbers like 20-120, got {text!r}") from None


def _size(count: int) -> str:
    size = float(count)
    for unit in ("B", "kB", "MB"):
        if size < 1000.0:
            return f"{size:.0f} {unit}"
        size /= 1000.0
    return f"{size:.2f} GB"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"
