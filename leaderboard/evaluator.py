"""Drives an agent over routes and scores it: what `lavsim score` calls.

Everything a user can get wrong is found before the first drive. After that an agent's failure ends its own route, and
the results file is complete and readable after every route.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lavsim.agent import find_agent
from lavsim.errors import LavsimError, RouteError
from lavsim.sensors.suites import find_suite
from lavsim.simulation import Simulation
from leaderboard.benchmark import LOOK, benchmark_id, versions
from leaderboard.config import EvaluationConfig, traffic_of
from leaderboard.drive import DriveOutcome, DriveTask, run_drive
from leaderboard.observer import Verdict
from leaderboard.picture import draw_drive
from leaderboard.record import Results, sensor_icons, write_run
from leaderboard.report.page import write_report
from leaderboard.routes import RouteEntry, read_routes, select_routes
from leaderboard.run import LOGS, PICTURES, Run, claim_folder
from leaderboard.score import SHORTEST, plain_rates

RUN_SCHEMA = 1

__all__ = ["EvaluationConfig", "OnProgress", "Progress", "evaluate"]


@dataclass(frozen=True)
class Progress:
    """How a run stands.

    Attributes:
        drive: Number of the drive under way, from 0; `total` at the end.
        total: Planned drives.
        name: Of the drive.
        town: Where it is.
        completion: Percent of its route.
        game_time: Simulated seconds of it.
        infractions: So far in it.
        results: Of the drives done.
        failure: What the agent of the drive just done failed with, if it did.
    """

    drive: int
    total: int
    name: str
    town: str
    completion: float
    game_time: float
    infractions: int
    results: Results
    failure: str | None = None


OnProgress = Callable[[Progress], None]


def evaluate(config: EvaluationConfig, on_progress: OnProgress | None = None) -> Run:
    """Drives every route and repetition of `config` and leaves the run in its folder.

    Args:
        config: What to do.
        on_progress: Told about every second of simulated time, and after each drive.

    Returns:
        The run as it lies in `config.out`.

    Raises:
        LavsimError: a mistake in the configuration, the route file, the town or the agent's name; nothing was driven.
    """
    rules = config.rule_set
    entries = select_routes(read_routes(config.routes, config.scenarios_json), config.route_ids)
    find_agent(config.agent)
    if config.sensors is not None:
        find_suite(config.sensors)
    tasks = list(_tasks(entries, config))
    digests = {task.entry.town: _check(task) for task in tasks if task.repetition == 0}
    claim_folder(config.out, config.overwrite)
    results = Results(rules, len(tasks))
    run: dict[str, Any] = {
        "schema": RUN_SCHEMA,
        "benchmark_id": benchmark_id(
            entries, digests, [traffic_of(e.traffic, config) for e in entries], config.repetitions, rules
        ),
        "versions": versions(),
        "config": config.model_dump(mode="json"),
        "rules": rules.version,
        "look": LOOK,
        "seed": config.seed,
        "seeds": [config.seed_of(k) for k in range(config.repetitions)],
        "track": config.track,
        "drives": [],
    }
    results.write(config.out)
    for task in tasks:
        outcome = run_drive(task, _reporter(task, results, on_progress))
        results = _add(results, outcome)
        run["track"] = run["track"] or outcome.track
        run["drives"].append(_details(task, outcome, config))
        run["kilometres"] = sum(d["dense_length"] * d["completion"] / 1e5 for d in run["drives"])
        run["infractions_per_km"] = plain_rates(results.records, max(run["kilometres"], SHORTEST), rules)
        results.write(config.out)
        write_run(config.out, run)
        if on_progress is not None:
            done, message = len(results.records), run["drives"][-1]["agent_message"]
            on_progress(Progress(done, len(tasks), task.name, task.entry.town, 0.0, 0.0, 0, results, message))
    results = replace(results, finished=True)
    results.write(config.out)
    made = Run.load(config.out)
    write_report(made)
    return made


def _check(task: DriveTask) -> str:
    """The digest of the route's town, once it is known that the route and its hazards can be driven there."""
    entry = task.entry
    try:
        return Simulation(task.spec()).town.digest
    except LavsimError as error:
        where = entry.file if str(error).startswith("route ") else f"{entry.source}:"
        raise RouteError(f"{where} {error}") from None


def _tasks(entries: Sequence[RouteEntry], config: EvaluationConfig) -> Iterator[DriveTask]:
    for number, entry in enumerate(entries):
        for repetition in range(config.repetitions):
            index = number * config.repetitions + repetition
            name = _file_name(entry.id, repetition, index)
            rules = config.rule_set
            yield DriveTask(
                index=index,
                name=name,
                route_id=f"RouteScenario_{entry.id}" + (f"_rep{repetition}" if rules.repetition_in_id else ""),
                entry=entry,
                repetition=repetition,
                seed=config.seed_of(repetition),
                traffic=traffic_of(entry.traffic, config),
                rules=rules,
                agent=config.agent_spec(),
                track=config.track,
                sensors=config.sensors,
                town_path=config.town_path,
                log=config.out / LOGS / f"{name}.lavlog",
                output=config.out / LOGS / f"{name}.agent.txt",
            )


def _file_name(route_id: str, repetition: int, index: int) -> str:
    """`RouteScenario_3_rep0`; ids that would not do in a file name are replaced and kept apart by their number."""
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", route_id)[:60]
    return f"RouteScenario_{safe if safe == route_id else f'{safe}_{index}'}_rep{repetition}"


def _add(results: Results, outcome: DriveOutcome) -> Results:
    if not results.sensors and outcome.sensors:
        results = replace(results, sensors=tuple(sensor_icons(outcome.sensors)))
    return results.with_record(outcome.record)


def _details(task: DriveTask, outcome: DriveOutcome, config: EvaluationConfig) -> dict[str, Any]:
    """The run file's entry of a drive, with its files by their place in the run's folder."""
    picture = config.out / PICTURES / f"{task.name}.png"
    drawn = config.pictures and draw_drive(task.log, picture, outcome.details["infractions"], config.town_path)
    return {
        **outcome.details,
        "log": task.log.relative_to(config.out).as_posix() if task.log.exists() else None,
        "picture": picture.relative_to(config.out).as_posix() if drawn else None,
    }


def _reporter(task: DriveTask, results: Results, on_progress: OnProgress | None) -> Callable[[Verdict], None] | None:
    if on_progress is None:
        return None

    def report(verdict: Verdict) -> None:
        on_progress(
            Progress(
                drive=task.index,
                total=results.total,
                name=task.name,
                town=task.entry.town,
                completion=verdict.completion,
                game_time=verdict.duration,
                infractions=len(verdict.infractions),
                results=results,
            )
        )

    return report
