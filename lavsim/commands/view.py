"""The live view in the browser, and scenes for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lavsim.commands import complete
from lavsim.commands.base import TownPath, app, towns_at
from lavsim.errors import ConfigError, LogError, OutputError, UnknownName

if TYPE_CHECKING:
    from lavsim.live.drivers import Driver
    from leaderboard.routes import RouteEntry


@app.command()
def view(
    routes: Annotated[
        str, typer.Argument(help="Name of a bundled route file, or a path.", autocompletion=complete.routes)
    ] = "quick",
    route_id: Annotated[str | None, typer.Option(help="Which route of the file; its first by default.")] = None,
    agent: Annotated[
        str | None, typer.Option(help="Watch this agent: 'module:Class', 'file.py'.", autocompletion=complete.agents)
    ] = None,
    agent_config: Annotated[str | None, typer.Option(help="Handed to the agent's setup.")] = None,
    keyboard: Annotated[bool, typer.Option("--keyboard", help="Drive by keys; so it is without --agent.")] = False,
    town: Annotated[
        str | None,
        typer.Option(help="Drive a route drawn in this town instead of a file's.", autocompletion=complete.towns),
    ] = None,
    seed: Annotated[int, typer.Option(help="Root of everything that is drawn.")] = 0,
    traffic: Annotated[str | None, typer.Option(help="leaderboard, lav or empty, where the file names none.")] = None,
    rules: Annotated[str, typer.Option(help="By which saved logs are judged: 1.0, 2.0, 2.1 …")] = "1.0",
    out: Annotated[Path, typer.Option(help="Folder for saved logs.")] = Path("runs/view"),
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the local server; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page at once.")] = True,
    town_path: TownPath = None,
) -> None:
    """Drive by keyboard, or watch an agent, in a local web page; ends with Ctrl-C."""
    import webbrowser

    from lavsim.agent import AgentFailure
    from lavsim.live.server import LiveServer
    from lavsim.live.session import Session
    from lavsim.live.stream import scene_message
    from lavsim.simulation import DriveSpec
    from leaderboard.rules import get_rules

    if agent is not None and keyboard:
        raise typer.BadParameter("--agent and --keyboard: one of them drives")
    search, judge = towns_at(town_path), get_rules(rules)
    entry = _entry(routes, route_id, town, seed, search)
    spec = DriveSpec(
        town=entry.town, route_id=entry.id, keypoints=entry.keypoints, weather=entry.weather,
        scenarios=entry.scenarios, seed=seed, traffic=entry.traffic or traffic or "leaderboard", rules=judge.version,
        generation=judge.generation, town_path=search,
    )  # fmt: skip
    driver = _driver(agent, agent_config, judge.generation, out, search)
    try:
        session = Session(spec, driver, _writable(out))
    except AgentFailure as failure:
        driver.close()
        raise ConfigError(f"the agent can't be set up: {failure.message}") from None
    simulation = session.simulation
    subtitle = f"{simulation.town.name}, {'keyboard' if agent is None else agent}"
    scene = scene_message(simulation.town, simulation.route, f"Route {entry.id}", subtitle, agent is None)
    try:
        server = LiveServer(session, scene, port)
        session.start()
        typer.echo(server.address)
        if browser:
            webbrowser.open(server.address)
        try:
            server.wait()
        finally:
            server.close()
    finally:
        session.close()


def _entry(routes: str, route_id: str | None, town: str | None, seed: int, search: tuple[Path, ...]) -> RouteEntry:
    """The route to drive: one of a file, or one drawn in a town."""
    if town is None:
        from leaderboard.routes import read_routes, select_routes

        return select_routes(read_routes(routes), route_id)[0]
    from lavsim.map.town_files import load_town
    from leaderboard.route_maker import RouteWish, make_routes

    return make_routes(load_town(town, search), RouteWish(1, seed=seed))[0]


def _driver(agent: str | None, config: str | None, generation: str, out: Path, search: tuple[Path, ...]) -> Driver:
    import os

    from lavsim.agent import AgentSpec
    from lavsim.agent_source import find_agent
    from lavsim.live.drivers import AgentDriver, KeyboardDriver
    from lavsim.map.town_files import TOWN_PATH

    if agent is None:
        return KeyboardDriver()
    find_agent(agent)
    spec = AgentSpec(agent, config, generation, drawings=True)
    towns = os.pathsep.join([*(str(folder.resolve()) for folder in search), *filter(None, [os.environ.get(TOWN_PATH)])])
    return AgentDriver(spec, out / "agent.txt", {TOWN_PATH: towns} if towns else {})


def _writable(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"can't write {folder}: {error.strerror}") from None
    return folder


@app.command("export-scene")
def export_scene(
    what: Annotated[str, typer.Argument(help="A town, or a moment of a recorded drive: 'R.lavlog@TICK'.")],
    out: Annotated[Path, typer.Argument(help="The file, *.glb.")],
    town_path: TownPath = None,
) -> None:
    """Write a town, or a moment of a drive, as GLB: roads, paint, scenery and actors as the sensors see them."""
    from lavsim.export_scene import scene_meshes, write_glb
    from lavsim.log.reader import LogReader
    from lavsim.log.replay import town_of
    from lavsim.map.town_files import load_town, town_names

    if out.suffix != ".glb":
        raise OutputError(f"a scene is written as *.glb, got {str(out)!r}.")
    search = towns_at(town_path)
    log, at, tick = what.rpartition("@")
    if not at:
        if what not in town_names(search):
            raise UnknownName("town or 'LOG@TICK'", what, town_names(search))
        write_glb(scene_meshes(load_town(what, search)), out)
    else:
        if not tick.isdecimal():
            raise LogError(f"{what!r}: a tick's number must follow the '@'.")
        reader = LogReader(Path(log))
        try:
            snapshot = reader.at_tick(int(tick))
        except IndexError as error:
            raise LogError(f"{error}.") from None
        write_glb(scene_meshes(town_of(reader, search), snapshot), out)
    typer.echo(str(out))
