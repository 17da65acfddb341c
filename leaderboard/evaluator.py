"""Drives an agent over routes and scores it: what `lavsim score` calls.

Everything a user can get wrong is found before the first drive. After that an agent's failure ends its own route, the
results file is complete and readable after every route, and a run that was killed goes on with `resume`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from lavsim.agent_source import find_agent
from lavsim.errors import LavsimError, OutputError, RouteError
from lavsim.executor import Executor, Report, make_executor
from lavsim.sensors.suites import find_suite
from lavsim.simulation import Simulation
from leaderboard.benchmark import LOOK, benchmark_id, versions
from leaderboard.checkpoint import load_outcome, save_outcome
from leaderboard.config import EvaluationConfig, traffic_of
from leaderboard.drive import DriveTask, Tick, drive_task, lost_drive
from leaderboard.outcomes import RUN_SCHEMA, DriveOutcome, write_outcomes
from leaderboard.record import RUN, Results
from leaderboard.report.page import write_report
from leaderboard.routes import RouteEntry, read_routes, select_routes
from leaderboard.run import Run, claim_folder
from leaderboard.scenario_files import read_scenarios, with_scenarios
from leaderboard.warm import warm_up

__all__ = ["EvaluationConfig", "OnProgress", "Progress", "evaluate"]


@dataclass(frozen=True)
class Progress:
    """How a run stands.

    Attributes:
        done: Drives done.
        total: Planned drives.
        share: Of the whole run, drives under way counted by their completion; 0 to 1.
        name: Of the drive this tells of.
        town: Where it is; empty once it is done.
        completion: Percent of its route.
        game_time: Simulated seconds of it.
        infractions: So far in it.
        results: Of the drives done.
        failure: What the agent of the drive just done failed with, if it did.
    """

    done: int
    total: int
    share: float
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
        on_progress: Told about every second of simulated time of each drive, and after each drive.

    Returns:
        The run as it lies in `config.out`.

    Raises:
        LavsimError: a mistake in the configuration, the route file, the town or the agent's name, or a run to resume
            that is another one; nothing was driven.
    """
    entries = select_routes(read_routes(config.routes), config.route_ids)
    if config.scenarios_json is not None:
        entries = with_scenarios(entries, read_scenarios(config.scenarios_json), config.town_path)
    find_agent(config.agent)
    if config.sensors is not None:
        find_suite(config.sensors)
    tasks = list(_tasks(entries, config))
    if tasks:
        warm_up(tasks[0])
    parallel = config.workers > 1 or config.cluster is not None
    with make_executor(config.workers, config.cluster) as executor:
        header = _header(config, entries, _checked(tasks, executor))
        if config.resume:
            _check_same(config, header)
        claim_folder(config.out, config.overwrite, config.resume)
        book = _Book(config, header, tasks, on_progress)
        for done in executor.run(drive_task, longest_first(book.waiting) if parallel else book.waiting, book.report):
            book.enter(done.task, done.result or lost_drive(done.task, done.lost or ""), keep=done.lost is None)
        book.write(finished=True)
        made = Run.load(config.out)
        write_report(made, executor=executor)
    return made


def _header(config: EvaluationConfig, entries: Sequence[RouteEntry], digests: dict[str, str]) -> dict[str, Any]:
    """What a run file says besides the drives; `digests` by town."""
    rules = config.rule_set
    profiles = [traffic_of(entry.traffic, config) for entry in entries]
    return {
        "schema": RUN_SCHEMA,
        "benchmark_id": benchmark_id(entries, digests, profiles, config.repetitions, rules, config.latency),
        "versions": versions(),
        "config": config.decisive(),
        "rules": rules.version,
        "look": LOOK,
        "seed": config.seed,
        "seeds": [config.seed_of(k) for k in range(config.repetitions)],
        "track": config.track,
    }


class _Book:
    """The run's files, made again from the drives done after each of them.

    Args:
        config: Of the run.
        header: What its run file says besides the drives.
        tasks: All drives, in order.
        on_progress: Told how the run stands.
    """

    def __init__(
        self,
        config: EvaluationConfig,
        header: dict[str, Any],
        tasks: Sequence[DriveTask],
        on_progress: OnProgress | None,
    ) -> None:
        self._config, self._header, self._tasks = config, header, tasks
        self._on_progress = on_progress
        self._under_way: dict[int, float] = {}  # percent by drive
        found = [(task.index, load_outcome(config.out, task.name)) for task in tasks]
        self._outcomes = {index: outcome for index, outcome in found if outcome is not None}
        self.write()

    @property
    def waiting(self) -> list[DriveTask]:
        """Drives not done."""
        return [task for task in self._tasks if task.index not in self._outcomes]

    def enter(self, task: DriveTask, outcome: DriveOutcome, keep: bool) -> None:
        """Adds a drive done; one that is not kept is driven again when the run is resumed."""
        self._outcomes[task.index] = outcome
        self._under_way.pop(task.index, None)
        if keep:
            save_outcome(self._config.out, task.name, outcome)
        self.write()
        self._tell(task.name, "", Tick(task.index, 0.0, 0.0, 0), outcome.details["agent_message"])

    def report(self, tick: Tick) -> None:
        """Passes on how a drive under way stands."""
        if tick.index not in self._outcomes:
            self._under_way[tick.index] = tick.completion
            task = self._tasks[tick.index]
            self._tell(task.name, task.entry.town, tick)

    def write(self, finished: bool = False) -> None:
        """Replaces results file and run file by what is known now."""
        outcomes = [self._outcomes[index] for index in sorted(self._outcomes)]
        self._results = write_outcomes(
            self._config.out,
            outcomes,
            len(self._tasks),
            self._config.rule_set,
            self._header,
            finished,
            self._config.strict_compat,
        )

    def _tell(self, name: str, town: str, tick: Tick, failure: str | None = None) -> None:
        if self._on_progress is None:
            return
        done, total = len(self._outcomes), len(self._tasks)
        self._on_progress(
            Progress(
                done=done,
                total=total,
                share=(done + sum(self._under_way.values()) / 100.0) / max(total, 1),
                name=name,
                town=town,
                completion=tick.completion,
                game_time=tick.time,
                infractions=tick.infractions,
                results=self._results,
                failure=failure,
            )
        )


def longest_first(tasks: Sequence[DriveTask]) -> list[DriveTask]:
    """Drives in the order in which several workers end soonest: what is left for the end is short."""
    return sorted(tasks, key=lambda task: (-task.entry.length, task.index))


def _check_same(config: EvaluationConfig, header: dict[str, Any]) -> None:
    """Refuses to go on with a run that was started otherwise; a folder without a run is begun in."""
    if not (config.out / RUN).exists():
        return
    begun = Run.load(config.out).run
    if begun.get("schema") != RUN_SCHEMA:
        raise OutputError(f"{config.out / RUN} has schema {begun.get('schema')}, this lavsim resumes {RUN_SCHEMA}")
    before, now = begun.get("config", {}), header["config"]
    for name in now:
        if before.get(name) != now[name] and name != "out":
            raise OutputError(
                f"the run in {config.out} was begun with {name} = {before.get(name)!r}, not {now[name]!r}; "
                "resume it as it was begun, or give another folder"
            )
    if begun.get("benchmark_id") != header["benchmark_id"]:
        raise OutputError(
            f"the run in {config.out} was begun under benchmark {begun.get('benchmark_id')}, now it is "
            f"{header['benchmark_id']}: towns, routes, traffic or rules have changed since"
        )


def _checked(tasks: Sequence[DriveTask], executor: Executor) -> dict[str, str]:
    """The digests of the routes' towns, once it is known that all routes and their hazards can be driven there.

    Raises:
        RouteError: one can't, the first in order.
    """
    towns: dict[str, list[DriveTask]] = {}
    for task in tasks:
        if task.repetition == 0:
            towns.setdefault(task.entry.town, []).append(task)
    found = list(executor.run(_check_town, towns.values()))
    for done in found:
        if done.lost:
            raise RouteError(f"{done.task[0].entry.source}: the town can't be read: {done.lost}")
    wrong = [done.result.problem for done in found if done.result is not None and done.result.problem is not None]
    if wrong:
        raise RouteError(min(wrong)[1])
    return {done.task[0].entry.town: done.result.digest for done in found if done.result is not None}


class _Checked(NamedTuple):
    """A town's digest, or the number of the first drive that can't be driven there and why."""

    digest: str
    problem: tuple[int, str] | None = None


def _check_town(tasks: Sequence[DriveTask], _: Report) -> _Checked:
    """Sets all drives in a town up."""
    digest = ""
    for task in tasks:
        entry = task.entry
        try:
            digest = Simulation(task.spec()).town.digest
        except LavsimError as error:
            where = entry.file if str(error).startswith("route ") else f"{entry.source}:"
            return _Checked("", (task.index, f"{where} {error}"))
    return _Checked(digest)


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
                latency=config.latency,
                out=config.out,
                pictures=config.pictures,
            )


def _file_name(route_id: str, repetition: int, index: int) -> str:
    """`RouteScenario_3_rep0`; ids that would not do in a file name are replaced and kept apart by their number."""
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", route_id)[:60]
    return f"RouteScenario_{safe if safe == route_id else f'{safe}_{index}'}_rep{repetition}"
