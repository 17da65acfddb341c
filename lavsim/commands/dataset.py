"""Datasets: what is in them, checks, merging and splitting, pictures, and other formats."""

from __future__ import annotations

import json
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lavsim.commands.base import AsJson, TownPath, app, print_findings, print_list, towns_at
from lavsim.commands.progress import Shares

if TYPE_CHECKING:
    from lavsim.dataset.info import Summary
    from lavsim.dataset.reader import Dataset

dataset_app = typer.Typer(
    help="What is in datasets; check, merge, split, show, export and import them.",
    rich_markup_mode=None,
    no_args_is_help=True,
)
app.add_typer(dataset_app, name="dataset")

Data = Annotated[Path, typer.Argument(help="Folder of a dataset.")]
Out = Annotated[Path, typer.Option(help="Folder to make.")]
Copy = Annotated[bool, typer.Option("--copy", help="Copy files instead of linking them.")]


class Format(StrEnum):
    """What a dataset may be exported to."""

    LEROBOT = "lerobot"
    WEBDATASET = "webdataset"
    LAV = "lav"
    RERUN = "rerun"


@dataset_app.command()
def info(
    data: Annotated[list[Path], typer.Argument(help="Folders of datasets.")],
    no_statistics: Annotated[
        bool, typer.Option("--no-statistics", help="Totals alone, without reading tables.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(help="Also draw the statistics of the first dataset: *.png.")] = None,
    as_json: AsJson = False,
) -> None:
    """Print what datasets hold: frames, towns, weathers, hours, bytes, fields, and statistics of the driving."""
    from lavsim.dataset.info import summarise
    from lavsim.dataset.reader import Dataset

    if plot is not None and (plot.suffix != ".png" or no_statistics):
        raise typer.BadParameter(f"--plot: expected a file *.png and statistics, got {str(plot)!r}")
    summaries = []
    with Shares() as shares:
        for path in data:
            summaries.append(summarise(Dataset(path), not no_statistics, _watch(shares, str(path))))
    if plot is not None:
        from lavsim.dataset.charts import write_charts
        from lavsim.errors import DatasetError

        if summaries[0].statistics is None:
            raise DatasetError(f"{data[0]} has no tables to draw; make them with: lavsim render.")
        write_charts(summaries[0].statistics, data[0].name, plot)
    if as_json:
        typer.echo(json.dumps([{"dataset": str(p), **s.to_json()} for p, s in zip(data, summaries, strict=True)]))
        return
    for path, summary in zip(data, summaries, strict=True):
        _print_summary(path, summary)
    if plot is not None:
        typer.echo(str(plot))


@dataset_app.command()
def check(
    data: Annotated[list[Path], typer.Argument(help="Folders of datasets.")],
    all_blobs: Annotated[
        bool, typer.Option("--all-blobs", help="Decode every reading, not some of each episode.")
    ] = False,
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> None:
    """Look for damage, gaps and doubles; print each and exit with 2 if there is any."""
    from lavsim.dataset.check import check as run

    towns, code = towns_at(town_path), 0
    found: list[tuple[Path, list[Any]]] = []
    with Shares() as shares:
        for path in data:
            found.append((path, run(path, all_blobs, towns, _watch_count(shares, str(path)))))
    if as_json:
        entries = [{"dataset": str(p), "file": f.file, "finding": f.problem} for p, some in found for f in some]
        typer.echo(json.dumps(entries, ensure_ascii=False))
        raise typer.Exit(2 if entries else 0)
    for path, findings in found:
        code = max(code, print_findings(str(path), [f"{path}: {finding}" for finding in findings], False))
    raise typer.Exit(code)


@dataset_app.command()
def merge(
    data: Annotated[list[Path], typer.Argument(help="Folders of datasets, in order.")], out: Out, copy: Copy = False
) -> None:
    """Make one dataset of several with the same sensors; episodes are numbered anew, and linked where that can be."""
    from lavsim.dataset.merge import merge as run

    with Shares() as shares:
        made = run(data, out, copy, _watch(shares, "merging"))
    _print_made([made])


@dataset_app.command()
def split(
    data: Data,
    out: Out,
    towns: Annotated[
        str | None, typer.Option(help="By town: 'each', or 'train=eu_small_a+us_large_a,test=eu_small_b'.")
    ] = None,
    shares: Annotated[str | None, typer.Option(help="By share of the frames: 'train=0.9,val=0.1'.")] = None,
    episodes: Annotated[str | None, typer.Option(help="By number: 'train=0-79,val=80-99+120'.")] = None,
    seed: Annotated[int, typer.Option(help="Of the order in which --shares deals episodes.")] = 0,
    copy: Copy = False,
) -> None:
    """Make a dataset of each part, by whole episodes, below one folder."""
    from lavsim.dataset.reader import Dataset
    from lavsim.dataset.split import by_number, by_share, by_town
    from lavsim.dataset.split import split as run

    if sum(choice is not None for choice in (towns, shares, episodes)) != 1:
        raise typer.BadParameter("give one of --towns, --shares and --episodes")
    dataset = Dataset(data)
    if towns is not None:
        parts = by_town(dataset, towns)
    elif shares is not None:
        parts = by_share(dataset, shares, seed)
    else:
        parts = by_number(dataset, episodes or "")
    with Shares() as bars:
        made = run(data, out, parts, copy, _watch(bars, "splitting"))
    _print_made(made)


@dataset_app.command()
def show(
    data: Data,
    out: Annotated[Path | None, typer.Option(help="Picture to write, *.png; in runs/show by default.")] = None,
    frames: Annotated[int, typer.Option(min=1, help="Frames of the contact sheet.")] = 24,
    seed: Annotated[int, typer.Option(help="Which frames.")] = 0,
    frame: Annotated[str | None, typer.Option(help="One frame instead, larger: 'EPISODE/FRAME'.")] = None,
    bright: Annotated[bool, typer.Option("--bright", help="Lighten images of the night.")] = False,
    town_path: TownPath = None,
) -> None:
    """Draw frames as they are stored, with their labels on them: boxes, route, goal."""
    from lavsim.dataset.picture import show_frames

    picture = out or Path("runs/show") / f"{data.resolve().name}.png"
    if picture.suffix != ".png":
        raise typer.BadParameter(f"--out: expected a file *.png, got {str(picture)!r}")
    with Shares() as shares:
        show_frames(data, picture, frames, seed, _place(frame), bright, towns_at(town_path), _watch(shares, "drawing"))
    typer.echo(str(picture))


@dataset_app.command()
def export(
    data: Data,
    to: Annotated[Format, typer.Option("--format", help="What to make of it.")],
    out: Out,
    fields: Annotated[str | None, typer.Option(help="Of webdataset: some readings only, 'rgb_2,lidar,bev'.")] = None,
) -> None:
    """Write a dataset in the format of LeRobot v3.0, WebDataset, LAV's lmdb trajectories, or for Rerun's viewer."""
    if fields is not None and to is not Format.WEBDATASET:
        raise typer.BadParameter("--fields goes with --format webdataset only")
    with Shares() as shares:
        watch = _watch(shares, "exporting")
        if to is Format.LEROBOT:
            from lavsim.dataset.export_lerobot import export_lerobot

            numbers = export_lerobot(data, out, watch)
        elif to is Format.WEBDATASET:
            from lavsim.dataset.export_webdataset import export_webdataset

            chosen = None if fields is None else [name.strip() for name in fields.split(",")]
            about = export_webdataset(data, out, chosen, watch)
            numbers = {"samples": about["samples"], "shards": about["shards"]}
        elif to is Format.RERUN:
            from lavsim.dataset.export_rerun import export_rerun

            numbers = export_rerun(data, out, watch)
        else:
            from lavsim.dataset.export_lav import export_lav

            numbers = export_lav(data, out, watch)
    typer.echo(f"{out}  " + ", ".join(f"{name} {_told(value)}" for name, value in numbers.items()))


@dataset_app.command("import")
def import_(
    source: Annotated[Path, typer.Argument(help="Folder of LAV's lmdb trajectories, or one of them.")], out: Out
) -> None:
    """Make a dataset of LAV's own data: tables and readings, and no log, since LAV kept none."""
    from lavsim.dataset.import_lav import import_lav

    with Shares() as shares:
        made = import_lav(source, out, _watch(shares, "importing"))
    _print_made([made])


def _watch(shares: Shares, name: str) -> Callable[[float], None]:
    return lambda share: shares.update(name, share)


def _watch_count(shares: Shares, name: str) -> Callable[[int, int], None]:
    return lambda done, total: shares.update(name, done / max(total, 1))


def _place(text: str | None) -> tuple[int, int] | None:
    """Episode and frame of '3/57'."""
    if text is None:
        return None
    episode, slash, frame = text.partition("/")
    if not slash or not episode.isdecimal() or not frame.isdecimal():
        raise typer.BadParameter(f"--frame: expected EPISODE/FRAME, as '3/57', got {text!r}")
    return int(episode), int(frame)


def _print_made(made: list[Dataset]) -> None:
    for dataset in made:
        typer.echo(f"{dataset.root}  {len(dataset)} frames in {len(dataset.episodes)} episodes")


def _print_summary(path: Path, summary: Summary) -> None:
    found = summary.to_json()
    sizes = ", ".join(f"{kind} {size / 1e6:.1f} MB" for kind, size in found["bytes_by_kind"].items())
    typer.echo(
        f"{path}: {found['frames']} frames in {found['episodes']} episodes, {found['hours']:.2f} h, "
        f"{found['km']:.1f} km; {found['bytes'] / 1e6:.1f} MB ({sizes or 'nothing'}), {found['bytes_per_frame']} bytes "
        f"a frame; seed {found['seed']}"
    )
    if not found["has_logs"]:
        typer.echo("It has no logs: it can't be rendered again.")
    print_list([{"town": name, **town} for name, town in found["towns"].items()], False)
    print_list([{"weather": name, "frames": count} for name, count in found["weathers"].items()], False)
    print_list([{"ending": name, "episodes": count} for name, count in found["endings"].items()], False)
    print_list([{**field, "shape": " x ".join(map(str, field["shape"])) or "1"} for field in found["fields"]], False)
    if found["statistics"] is not None:
        _print_statistics(found["statistics"])


def _print_statistics(statistics: dict[str, Any]) -> None:
    from lavsim.dataset.stats import QUANTITIES

    print_list(
        [
            {"quantity": name.replace("_", " "), "about": QUANTITIES[name].about, **_rounded(numbers)}
            for name, numbers in statistics["quantities"].items()
            if numbers.get("count")
        ],
        False,
    )
    for name, counts in statistics["shares"].items():
        # Kinds of frames may overlap, as rain and night do; those of actors can't.
        total = sum(counts.values()) if name == "actor_class" else statistics["frames"]
        label = name.replace("_", " ")
        print_list(
            [
                {label: kind, "count": count, "share": f"{100.0 * count / total:.1f} %"}
                for kind, count in counts.items()
            ],
            False,
        )
    print_list(
        [
            {
                "vehicles at": f"{ring['from_m']:.0f} to {ring['to_m']:.0f} m",
                "count": ring["vehicles"],
                "seen by a sensor": f"{100.0 * ring['seen'] / ring['vehicles']:.1f} %",
            }
            for ring in statistics["vehicles_seen"]
            if ring["vehicles"]
        ],
        False,
    )


def _rounded(numbers: dict[str, Any]) -> dict[str, Any]:
    return {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in numbers.items()}


def _told(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {count}" for name, count in value.items())
    return ", ".join(value) if isinstance(value, list) else str(value)
