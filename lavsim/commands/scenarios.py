"""The hazards a route file may name: list them, find places for them, begin one, search and certify them."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lavsim.commands.base import AsJson, TownPath, app, print_list, summary_of, towns_at
from lavsim.commands.progress import Shares
from lavsim.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from leaderboard.search.certificate import CertifyConfig
    from leaderboard.search.ground import Ground
    from leaderboard.search.search import SearchConfig

ScenarioPath = Annotated[
    list[Path] | None, typer.Option("--scenario-path", help="Folder with your own hazards (*.py); may be given again.")
]


@app.command()
def scenarios(
    suggest: Annotated[
        tuple[str, str], typer.Option("--suggest", metavar="TOWN TYPE", help="List places in a town for a hazard.")
    ] = ("", ""),
    new: Annotated[
        str, typer.Option("--new", metavar="NAME", help="Write the file of a new hazard (RollingBin).")
    ] = "",
    search: Annotated[
        str, typer.Option("--search", metavar="TYPE", help="Find values of a hazard that make --agent fail.")
    ] = "",
    certify: Annotated[
        str,
        typer.Option(
            "--certify", metavar="TYPE|FILE|all", help="Show that hazards can be passed and can't be ignored."
        ),
    ] = "",
    vary: Annotated[
        str, typer.Option("--vary", metavar="TYPE", help="Write a route file of a hazard with drawn values.")
    ] = "",
    count: Annotated[int, typer.Option(help="Places to list at most, or variations to draw.")] = 20,
    agent: Annotated[str, typer.Option(help="Who is searched, or tried last by --certify.")] = "",
    agent_config: Annotated[str | None, typer.Option(help="Handed to the agent's setup.")] = None,
    routes: Annotated[str, typer.Option(help="Route file with the hazard: a name or a path.")] = "hazards",
    route_id: Annotated[str | None, typer.Option(help="Of that file; for --certify also '0,3-5'.")] = None,
    town: Annotated[str, typer.Option(help="Search at the first place of a town instead.")] = "",
    ranges: Annotated[
        list[str] | None,
        typer.Option("--range", metavar="NAME=LOW:HIGH", help="What a parameter may be; may be given again."),
    ] = None,
    drives: Annotated[int | None, typer.Option(help="Budget: of a search (40), or of each certificate (60).")] = None,
    seed: Annotated[int, typer.Option(help="Of the candidates and the drives.")] = 0,
    seeds: Annotated[int, typer.Option(help="Seeds to certify each hazard under.")] = 1,
    one_each: Annotated[bool, typer.Option("--one-each", help="Certify one route of each type.")] = False,
    rules: Annotated[str | None, typer.Option(help="What is judged by; 1.0, or 2.1 for hazards of 2.x.")] = None,
    workers: Annotated[int, typer.Option(help="Processes that drive side by side; the results are the same.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the search, where one is gone on with; or file of the variations.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is in the folder.")] = False,
    scenario_path: ScenarioPath = None,
    town_path: TownPath = None,
    as_json: AsJson = False,
) -> None:
    """List the hazards a route file may name; find places for one; begin one; search and certify them."""
    from lavsim.scenarios.skeleton import write_skeleton
    from lavsim.scenarios.user_files import use_folders

    given = {"--suggest": suggest[0], "--new": new, "--search": search, "--certify": certify, "--vary": vary}
    asked = [name for name, value in given.items() if value]
    if len(asked) > 1:
        raise ConfigError(f"give one of {', '.join(asked)}.")
    if new:
        typer.echo(write_skeleton(new, (scenario_path or [Path()])[0]))
        return
    use_folders(scenario_path or [])
    towns = towns_at(town_path)
    if suggest[0]:
        print_list(_places(suggest[0], suggest[1], count, towns), as_json)
    elif search:
        from leaderboard.search.search import SearchConfig

        if not agent:
            raise ConfigError("--search needs --agent: whose failures are looked for?")
        _search(
            SearchConfig(
                kind=search, agent=agent, out=out or Path("runs/search"), routes=routes, route_id=route_id, town=town,
                ranges=tuple(ranges or ()), drives=40 if drives is None else drives, seed=seed, rules=rules,
                agent_config=agent_config, workers=workers, overwrite=overwrite, town_path=towns,
            ),
            as_json,
        )  # fmt: skip
    elif vary:
        from leaderboard.search.ground import find_ground

        target = out or Path("variations.xml")
        if target.exists() and not overwrite:
            raise OutputError(f"{target} is there already; --overwrite replaces it.")
        ground = find_ground(vary, routes, route_id, town, towns)
        print_list(_vary(ground, tuple(ranges or ()), count, seed, target), as_json)
    elif certify:
        from leaderboard.search.certificate import CertifyConfig

        _certify(
            CertifyConfig(
                what=certify, out=out or Path("runs/certify"), routes=routes, route_ids=route_id, seeds=seeds,
                one_each=one_each, budget=60 if drives is None else drives, agent=agent,
                rules=rules, workers=workers, overwrite=overwrite,
                town_path=towns,
            ),
            as_json,
        )  # fmt: skip
    else:
        print_list(_types(), as_json)


def _vary(ground: Ground, texts: tuple[str, ...], count: int, seed: int, target: Path) -> list[dict[str, Any]]:
    """Writes variations of a hazard and returns a row for each."""
    from leaderboard.record import write_text
    from leaderboard.route_writer import write_routes
    from leaderboard.search.ranges import ranges_of
    from leaderboard.search.variations import variations

    hazard = ground.hazard
    drawn = list(
        variations(ground, ranges_of(hazard.generation, hazard.type, texts, dict(hazard.parameters)), count, seed)
    )
    write_text(target, write_routes([each.entry for each in drawn], ground.entry.traffic).decode())
    return [{"route": each.number, **each.values} for each in drawn]


def _search(config: SearchConfig, as_json: bool) -> None:
    """Searches, and prints the failures and how to drive them again."""
    from leaderboard.search.search import FOUND, Progress, Search, failures_table

    search = Search(config)
    with Shares() as bars:

        def on_progress(progress: Progress) -> None:
            note = f"{progress.done}/{progress.total} drives, {progress.failures} failures"
            bars.update(config.kind, progress.share, f"{note}, least margin {progress.least:.2f}")

        trials = search.run(on_progress)
    if as_json:
        print_list([{"number": trial.number, **trial.to_json()} for trial in trials], as_json)
        return
    failures = failures_table(search)
    where = f"{search.ground.entry.source} ({search.ground.entry.town})"
    typer.echo(f"{config.kind} on {where}: {len(failures)} of {len(trials)} drives failed")
    if failures:
        print_list(failures, as_json)
        typer.echo(f"{config.out / FOUND}\n{search.command}")
    else:
        nearest = min(trials, key=lambda trial: trial.margin)
        values = ", ".join(f"{name}={value}" for name, value in nearest.values.items())
        typer.echo(f"nearest to failing: {values} with margin {nearest.margin:.2f}")


def _certify(config: CertifyConfig, as_json: bool) -> None:
    """Certifies, and prints a line for each hazard and seed."""
    from leaderboard.search.certificate import Certificate, certify

    with Shares() as bars:

        def on_done(done: int, total: int, certificate: Certificate) -> None:
            bars.update(config.what, done / total, f"{done}/{total}, {certificate.kind}: {certificate.verdict}")

        found = certify(config, on_done)
    print_list([certificate.row() for certificate in found], as_json)


def _types() -> list[dict[str, Any]]:
    from lavsim.scenarios.base import SCENARIOS

    entries = []
    for key in SCENARIOS:
        assert isinstance(key, tuple)
        scenario = SCENARIOS[key]
        entries.append(
            {
                "type": key[1],
                "generation": key[0],
                "acts": scenario.acts,
                "summary": summary_of(scenario),
                "parameters": {f.name: f.default for f in fields(scenario.Config) if f.default is not MISSING},
            }
        )
    return entries


def _places(town_name: str, kind: str, count: int, town_path: tuple[Path, ...]) -> list[dict[str, Any]]:
    from lavsim.map.town_files import load_town
    from leaderboard.hazard_maker import find_type, stands

    town = load_town(town_name, town_path)
    generation, name = find_type(kind)
    return [
        {
            "x": round(stand.spec.trigger[0], 1),
            "y": round(stand.spec.trigger[1], 1),
            "z": round(stand.spec.trigger[2], 1),
            "yaw": round(math.degrees(stand.spec.trigger[3]) % 360.0, 1),
            "road": int(town.lanes.road_id[stand.route.lane[stand.index]]),
            "lane": int(town.lanes.lane_id[stand.route.lane[stand.index]]),
            "parameters": dict(stand.spec.parameters),
        }
        for stand in islice(stands(town, name, generation), count)
    ]
