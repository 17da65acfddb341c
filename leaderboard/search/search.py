"""Searches the values of a hazard's parameters with which an agent fails: what `lavsim scenarios --search` calls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.agent import AgentSpec
from lavsim.agent_source import find_agent
from lavsim.errors import ConfigError
from lavsim.executor import make_executor
from lavsim.random import Draws
from leaderboard.drive import DriveTask, Tick
from leaderboard.record import write_text
from leaderboard.route_writer import write_routes
from leaderboard.routes import RouteEntry
from leaderboard.rules import Rules, get_rules
from leaderboard.run import LOGS
from leaderboard.search.cross_entropy import POPULATION, Belief, belief_before
from leaderboard.search.ground import RULES, Ground, find_ground
from leaderboard.search.ranges import Range, ranges_of
from leaderboard.search.store import Store
from leaderboard.search.trial import Trial, TrialTask, lost_trial, run_trial
from leaderboard.search.variations import draw_variation

FOUND = "found.xml"
SCHEMA = 1


@dataclass(frozen=True)
class SearchConfig:
    """What a user sets.

    Attributes:
        kind: Type of the hazard, "Accident" or "1.0:Scenario3".
        agent: Who drives: "module", "module:Class" or "file.py:Class".
        out: Folder of the search.
        routes, route_id, town: Where (`find_ground`).
        ranges: "distance=10:40"; empty: the type's own.
        drives: Budget; a search may be gone on with by a larger one.
        seed: Of the candidates and of every drive.
        rules: What is judged by; None: 1.0, or 2.1 for hazards of 2.x.
        agent_config: Handed to the agent's set-up.
        workers: Processes; they change nothing but the time.
        overwrite: Whether an earlier search in the folder goes.
        town_path: Folders with towns.
    """

    kind: str
    agent: str
    out: Path
    routes: str = "hazards"
    route_id: str | None = None
    town: str = ""
    ranges: tuple[str, ...] = ()
    drives: int = 40
    seed: int = 0
    rules: str | None = None
    agent_config: str | None = None
    workers: int = 1
    overwrite: bool = False
    town_path: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        if self.drives < 1:
            raise ConfigError(f"drives must be at least 1, got {self.drives}.")
        if self.seed < 0:
            raise ConfigError(f"seed must not be negative, got {self.seed}.")


@dataclass(frozen=True)
class Progress:
    """How a search stands: drives done, of how many, share of all [0 to 1], failures so far, least margin."""

    done: int
    total: int
    share: float
    failures: int
    least: float


OnProgress = Callable[[Progress], None]


class Search:
    """A search in its folder.

    Args:
        config: What to do.

    Attributes:
        ground: The route and its hazard.
        ranges: What is drawn from.
        rules: What is judged by.

    Raises:
        LavsimError: a mistake in the configuration, or a folder that holds another search.
    """

    def __init__(self, config: SearchConfig) -> None:
        self.config = config
        find_agent(config.agent)
        self.ground: Ground = find_ground(config.kind, config.routes, config.route_id, config.town, config.town_path)
        hazard = self.ground.hazard
        self.ranges: tuple[Range, ...] = ranges_of(
            hazard.generation, hazard.type, config.ranges, dict(hazard.parameters)
        )
        self.rules: Rules = get_rules(config.rules or RULES[hazard.generation])
        self._executor = make_executor(config.workers)
        self._draws = Draws.of_seed(config.seed).stream("search")
        self._store = Store(config.out, self._header(), config.overwrite, owns=(LOGS, FOUND))
        (config.out / LOGS).mkdir(exist_ok=True)

    @property
    def trials(self) -> list[Trial]:
        """Drives done within the budget, by number."""
        rows = self._store.rows
        return [Trial.from_json(number, rows[number]) for number in sorted(rows) if number < self.config.drives]

    def run(self, on_progress: OnProgress | None = None) -> list[Trial]:
        """Drives what is not done yet, generation by generation.

        Returns:
            All drives by number.

        Raises:
            AgentError: the agent can't be set up.
            ScenarioError: no values of the ranges can stand on the route.
        """
        under_way: dict[int, float] = {}

        def report(tick: Tick) -> None:
            under_way[tick.index] = tick.completion
            if on_progress is not None:
                on_progress(self._progress(under_way))

        for first in range(0, self.config.drives, POPULATION):
            for done in self._executor.run(run_trial, list(self._tasks(first)), report):
                trial = done.result or lost_trial(done.task)
                self._store.add(trial.number, trial.to_json())
                under_way.pop(trial.number, None)
                report(Tick(trial.number, 0.0, 0.0, 0))
            self._write_found()
        return self.trials

    def entry_of(self, trial: Trial) -> RouteEntry:
        """The route of a drive."""
        return self.ground.with_values(trial.values, str(trial.number))

    @property
    def command(self) -> str:
        """What drives the failures again."""
        config = self.config
        extra = f" --agent-config '{config.agent_config}'" if config.agent_config else ""
        return (
            f"lavsim score --agent {config.agent}{extra} --routes {config.out / FOUND} "
            f"--rules {self.rules.version} --seed {config.seed} --out {config.out / 'again'}"
        )

    def _tasks(self, first: int) -> Iterator[TrialTask]:
        """The candidates of the generation that begins with number `first`; all before it are done."""
        known = [Trial.from_json(number, self._store.rows[number]) for number in range(first)]
        points = np.array([trial.point for trial in known], dtype=np.float64).reshape(-1, len(self.ranges))
        belief = belief_before(first // POPULATION, points, [trial.margin for trial in known])
        for number in range(first, min(first + POPULATION, self.config.drives)):
            if number not in self._store.rows:
                yield self._task(number, belief)

    def _task(self, number: int, belief: Belief) -> TrialTask:
        drawn = draw_variation(self.ground, self.ranges, belief, self._draws, number)
        return TrialTask(number, drawn.attempts, drawn.point, drawn.values, self._drive(number, drawn.entry))

    def _drive(self, number: int, entry: RouteEntry) -> DriveTask:
        config = self.config
        agent = AgentSpec(config.agent, config_path=config.agent_config, generation=self.rules.generation)
        return DriveTask(
            index=number,
            name=f"drive_{number}",
            route_id=entry.id,
            entry=entry,
            repetition=0,
            seed=config.seed,
            traffic=entry.traffic or "leaderboard",
            rules=self.rules,
            agent=agent,
            track=None,
            sensors=None,
            town_path=config.town_path,
            latency=0,
            out=config.out,
            pictures=False,
        )

    def _write_found(self) -> None:
        """The route file of the failures; none is left where there are none."""
        failures = [self.entry_of(trial) for trial in self.trials if trial.failed]
        path = self.config.out / FOUND
        if failures:
            write_text(path, write_routes(failures, self.ground.entry.traffic).decode())
        else:
            path.unlink(missing_ok=True)

    def _progress(self, under_way: Mapping[int, float]) -> Progress:
        trials, total = self.trials, self.config.drives
        share = (len(trials) + sum(under_way.values()) / 100.0) / total
        least = min((trial.margin for trial in trials), default=1.0)
        return Progress(len(trials), total, min(share, 1.0), sum(trial.failed for trial in trials), least)

    def _header(self) -> dict[str, Any]:
        """What decides the results, apart from the budget."""
        return {
            "schema": SCHEMA,
            "agent": self.config.agent,
            "agent_config": self.config.agent_config,
            "route": self.ground.entry.to_json(),
            "town_digest": self.ground.town.digest,
            "traffic": self.ground.entry.traffic,
            "ranges": list(map(str, self.ranges)),
            "rules": self.rules.version,
            "seed": self.config.seed,
            "population": POPULATION,
        }


def failures_table(search: Search) -> list[dict[str, Any]]:
    """A row for each failure: its number in the route file, the values, and what it failed by."""
    return [
        {"route": trial.number, **trial.values, "failed by": ", ".join(trial.failed_by)}
        for trial in search.trials
        if trial.failed
    ]
