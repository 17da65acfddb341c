"""Drive agents and judge them: score, rescore, merge, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lavsim.commands import complete
from lavsim.commands.base import AsJson, TownPath, app, print_rich, towns_at
from lavsim.commands.progress import ScoreBar
from lavsim.commands.scenarios import ScenarioPath


@app.command()
def score(
    agent: Annotated[
        str, typer.Option(help="'module:Class', 'file.py' or 'file.py:Class'.", autocompletion=complete.agents)
    ],
    routes: Annotated[
        str, typer.Option(help="Name of a bundled route file, or a path.", autocompletion=complete.routes)
    ] = "quick",
    out: Annotated[Path, typer.Option(help="Folder for the run.")] = Path("runs/score"),
    agent_config: Annotated[str | None, typer.Option(help="Handed to the agent's setup.")] = None,
    rules: Annotated[
        str, typer.Option(help="1.0, 2.0, 2.1, bench2drive or corrected.", autocompletion=complete.rules)
    ] = "1.0",
    seed: Annotated[int, typer.Option(help="Root of everything that is drawn.")] = 0,
    route_ids: Annotated[str | None, typer.Option(help="Some routes of the file: '0,3-5'.")] = None,
    scenarios_json: Annotated[
        Path | None, typer.Option("--scenarios-json", help="Hazards of 1.0, matched with the routes.")
    ] = None,
    scenario_path: ScenarioPath = None,
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
    strict_compat: Annotated[
        bool, typer.Option("--strict-compat", help="Keep the bookkeeping defects of the original results file.")
    ] = False,
) -> None:
    """Drive an agent over routes and score it by the leaderboard's rules."""
    from lavsim.scenarios.user_files import use_folders
    from leaderboard.evaluator import EvaluationConfig, evaluate
    from leaderboard.latency import latency_ticks

    use_folders(scenario_path or [])

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
        town_path=towns_at(town_path),
        workers=workers,
        cluster=cluster,
        resume=resume,
        overwrite=overwrite,
        drawings=drawings,
        strict_compat=strict_compat,
    )
    with ScoreBar() as bar:
        run = evaluate(config, bar.update)
    from leaderboard.table import run_table

    print_rich(run_table(run))
    typer.echo(f"{out / 'results.json'}  {out / 'report.html'}")


@app.command()
def rescore(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    rules: Annotated[str, typer.Option(help="1.0, 2.0, 2.1, bench2drive or corrected.", autocompletion=complete.rules)],
    out: Annotated[Path | None, typer.Option(help="Folder of the new run; below the old one by default.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run in the folder.")] = False,
    town_path: TownPath = None,
) -> None:
    """Judge recorded drives again by other rules, without driving."""
    from leaderboard.rescore import rescore as judge_again
    from leaderboard.table import run_table

    made = judge_again(run, rules, out, overwrite, towns_at(town_path))
    print_rich(run_table(made))
    typer.echo(f"{made.folder / 'results.json'}  {made.folder / 'report.html'}")


@app.command()
def merge(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or results files of the leaderboard.")],
    out: Annotated[Path, typer.Option(help="Folder of the joined run.")],
    rules: Annotated[str | None, typer.Option(help="What results files were written under.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a run in the folder.")] = False,
    strict_compat: Annotated[
        bool, typer.Option("--strict-compat", help="Keep the bookkeeping defects of the original results file.")
    ] = False,
) -> None:
    """Join runs that shared out the routes of one benchmark."""
    from leaderboard.merge import merge as join
    from leaderboard.run import Run
    from leaderboard.table import run_table

    join(runs, out, rules, overwrite, strict_compat)
    print_rich(run_table(Run.load(out)))
    typer.echo(str(out / "results.json"))


@app.command()
def report(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    out: Annotated[
        Path | None, typer.Option(help="Where the comparison of several runs goes; comparison.html of the first.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Print the tables of runs, write their reports and replays again, and compare several of them."""
    from leaderboard.report.comparison import check_comparable, write_comparison
    from leaderboard.report.page import write_report
    from leaderboard.run import Run
    from leaderboard.table import run_facts, run_table

    loaded = [Run.load(folder) for folder in runs]
    check_comparable(loaded)
    for run in loaded:
        if not as_json:
            if len(loaded) > 1:
                typer.echo(str(run.folder))
            print_rich(run_table(run))
        write_report(run)
    comparison = write_comparison(loaded, out) if len(loaded) > 1 else None
    if as_json:
        typer.echo(json.dumps([run_facts(run) for run in loaded], ensure_ascii=False))
    elif comparison is not None:
        typer.echo(str(comparison))
