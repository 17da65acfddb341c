"""Pictures, films and replays."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lavsim.commands import complete
from lavsim.commands.base import TownPath, app, towns_at
from lavsim.commands.progress import Shares
from lavsim.errors import OutputError, UnknownName


@app.command()
def show(
    what: Annotated[
        str,
        typer.Argument(
            help="A town, a route file (or bundled name), the folder of a run or dataset, or a *.lavlog.",
            autocompletion=complete.towns_and_routes,
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; runs/show by default.")] = None,
    route_ids: Annotated[str | None, typer.Option(help="Some routes of a file: '0,3-5'.")] = None,
    html: Annotated[Path | None, typer.Option(help="Of a log: the replay, one page for the browser.")] = None,
    video: Annotated[Path | None, typer.Option(help="Of a log: a film, *.mp4, *.webm or *.gif.")] = None,
    strip: Annotated[Path | None, typer.Option(help="Of a log: a film strip of a moment, *.png.")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Of a log: a contact sheet of a moment, *.png.")] = None,
    rerun: Annotated[Path | None, typer.Option(help="Of a log: a recording for Rerun, *.rrd.")] = None,
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
    """Draw a town, routes, the drives of a run, frames of a dataset, or a recorded drive; prints the files' paths."""
    search, folder = towns_at(town_path), out or Path("runs/show")
    kind = _kind_of(what, search)
    if kind == "log":
        from lavsim.viewer.film import Cut
        from leaderboard.show import Wish, show_log

        if speed <= 0.0:
            raise typer.BadParameter(f"--speed: expected more than 0, got {speed:g}")
        stem = folder / Path(what).stem
        if rerun is not None:
            from lavsim.rerun_export import write_rerun

            write_rerun(Path(what), rerun, search)
            typer.echo(str(rerun))
        if not (html or video or strip or sheet or rerun):
            html, sheet = stem.with_suffix(".html"), stem.with_suffix(".png")
        wish = Wish(html, video, strip, sheet, at, panes, Cut(begin, end, speed=speed, panes=panes))
        with Shares() as shares:
            pictures = show_log(Path(what), wish, search, shares.update)
    elif kind == "town":
        from lavsim.map.town_files import load_town
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
    elif kind == "dataset":
        from lavsim.dataset.picture import show_frames

        pictures = [folder / f"{Path(what).resolve().name}.png"]
        with Shares() as shares:
            show_frames(Path(what), pictures[0], town_path=search, watch=lambda share: shares.update("drawing", share))
    else:
        from leaderboard.run import Run

        run = Run.load(Path(what))
        pictures = sorted((run.folder / "pictures").glob("*.png"))
        if not pictures:
            raise OutputError(f"{what} has no pictures")
    for picture in pictures:
        typer.echo(str(picture))


def _kind_of(what: str, search: tuple[Path, ...]) -> str:
    from lavsim.map.town_files import town_names
    from leaderboard.routes import route_files

    if (Path(what) / "meta" / "info.json").is_file():
        return "dataset"
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
