"""Certifies hazards: each can be passed by somebody who knows what will come, and hurts whoever drives on blindly.

The search is best-first over plans (`leaderboard.search.manoeuvres`): what failed farthest along the route is driven
again with one more step where it failed; every second drive goes back to the first plan, so that no dead end takes all.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from lavsim.agent_source import find_agent
from lavsim.errors import ConfigError, RouteError
from lavsim.executor import make_executor
from lavsim.scenarios.base import SCENARIOS, ScenarioSpec
from leaderboard.hazard_maker import find_type
from leaderboard.routes import RouteEntry, read_routes, route_files, select_routes
from leaderboard.rules import get_rules
from leaderboard.search.ground import RULES, Ground
from leaderboard.search.manoeuvres import Plan, Shift, children, plan_text
from leaderboard.search.privileged import BLIND, PlanDrive, drive_plan
from leaderboard.search.store import Store

SCHEMA = 1
BUDGET = 60  # drives for a hazard and a seed
_BACK_EVERY = 2
_LANE = 3.5  # [m]
_SIGNALS = ("red_light", "stop_infraction")  # nobody may go round them
_LATE = ("outside_route_lanes",)  # told at the end of the drive: where it was is not known
_MOST_STEPS = 4  # of a plan
_FARTHER = 2.0  # [m] that a plan must come farther to be worth changing
ALL = "all"


@dataclass(frozen=True)
class CertifyConfig:
    """What a user sets.

    Attributes:
        what: A type ("Accident", "1.0:Scenario3"), a route file, or "all" types.
        out: Folder of the certificates.
        routes: Route file in which types are looked up.
        route_ids: Some routes of the file: "0,3-5".
        seeds: Drives with seeds 0 to this less one.
        one_each: Whether only the first route of each type is taken.
        budget: Drives for a hazard and a seed.
        agent: Tried last, where no plan passes; empty: nobody.
        rules: What is judged by; None: 1.0, or 2.1 for hazards of 2.x.
        workers: Processes; they change nothing but the time.
        overwrite: Whether earlier certificates in the folder go.
        town_path: Folders with towns.
    """

    what: str
    out: Path
    routes: str = "hazards"
    route_ids: str | None = None
    seeds: int = 1
    one_each: bool = False
    budget: int = BUDGET
    agent: str = ""
    rules: str | None = None
    workers: int = 1
    overwrite: bool = False
    town_path: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        for name in ("seeds", "budget"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} must be at least 1, got {getattr(self, name)}.")


@dataclass(frozen=True)
class Task:
    """A hazard to certify under a seed."""

    index: int
    entry: RouteEntry
    spec: ScenarioSpec
    seed: int
    config: CertifyConfig


@dataclass(frozen=True)
class Certificate:
    """What was found of a hazard under a seed.

    Attributes:
        generation, kind, town, route, seed: Which.
        set_off: Whether the plain route sets it off.
        clean_without: Whether the blind route follower has no infraction with the hazard taken out.
        ignored: What it costs to drive on blindly; None: nothing.
        passed: The plan that passes without infraction, or the agent; None: none was found.
        drives: How many it took.
    """

    generation: str
    kind: str
    town: str
    route: str
    seed: int
    set_off: bool = False
    clean_without: bool = False
    ignored: str | None = None
    passed: str | None = None
    drives: int = 0

    @property
    def acts(self) -> bool:
        """Whether its type scripts anything."""
        return SCENARIOS[self.generation, self.kind].acts

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if not self.acts:
            return "support type"
        if not self.set_off:
            return "not set off"
        if self.passed is None:
            return "no way past found"
        if self.ignored is None:
            return "can be ignored"
        return "certified" if self.clean_without else "hurts without it too"

    def row(self) -> dict[str, Any]:
        """A line of the table."""
        nothing = "" if not self.acts or not self.set_off else "nothing"
        return {
            "type": self.kind,
            "generation": self.generation,
            "town": self.town,
            "route": self.route,
            "seed": self.seed,
            "verdict": self.verdict,
            "ignored": self.ignored or nothing,
            "passed by": self.passed or "",
            "drives": self.drives,
        }


OnDone = Callable[[int, int, Certificate], None]


def certify(config: CertifyConfig, on_done: OnDone | None = None) -> list[Certificate]:
    """Certifies all that `config` names.

    Args:
        config: What to do.
        on_done: Told (done, of, certificate) after each.

    Raises:
        LavsimError: a mistake in the configuration, or a folder that holds other certificates.
    """
    if config.agent:
        find_agent(config.agent)
    tasks = list(_tasks(config))
    executor = make_executor(config.workers)
    store = Store(config.out, _header(config, tasks), config.overwrite)
    for task in tasks:  # everything a user can get wrong is found before the first drive
        ground = Ground.of(task.entry, task.spec, config.town_path)
        reason = ground.refusal(ground.entry)
        if reason is not None:
            raise RouteError(f"{task.entry.source}: {task.spec.name} can't stand there: {reason}")
    waiting = [task for task in tasks if task.index not in store.rows]
    for done in executor.run(certify_one, waiting):
        if done.result is not None:  # one whose process was lost is tried again when the search is gone on with
            store.add(done.task.index, asdict(done.result))
            if on_done is not None:
                on_done(len(store.rows), len(tasks), done.result)
    return [Certificate(**store.rows[index]) for index in sorted(store.rows)]


def certify_one(task: Task, report: Callable[[Any], None]) -> Certificate:
    """Certifies one hazard under one seed."""
    spec, config = task.spec, task.config
    certificate = Certificate(spec.generation, spec.type, task.entry.town, task.entry.id, task.seed)
    if not certificate.acts:
        return certificate
    ground = Ground.of(task.entry, spec, config.town_path)
    rules = get_rules(config.rules or RULES[spec.generation])
    drive = partial(drive_plan, ground, task.seed, rules, town_path=config.town_path)
    free, blind = drive(with_hazard=False), drive(from_hazard=True)
    drives, passed = 2, None
    if blind.passed:
        passed = plan_text(())
    else:
        for tried in _search(blind, drive):
            drives += 1
            if tried.passed:
                passed = plan_text(tried.plan)
                break
            if drives >= config.budget:
                break
    if passed is None and config.agent:
        drives += 1
        if drive(agent=config.agent).passed:
            passed = config.agent
    return replace(
        certificate,
        set_off=blind.begun >= 0,
        clean_without=free.passed,
        ignored=blind.infraction,
        passed=passed,
        drives=drives,
    )


@dataclass
class _Node:
    """A plan that failed, and what of it is still to be tried."""

    drive: PlanDrive
    left: list[Plan]

    @staticmethod
    def of(drive: PlanDrive) -> _Node:
        signal = drive.infraction in _SIGNALS
        return _Node(drive, children(drive.plan, drive.place, _LANE, drive.stands, drive.begun_at, signal))


def _search(first: PlanDrive, drive: Callable[[Plan], PlanDrive]) -> Iterator[PlanDrive]:
    """Drives plan after plan until nobody asks for more, or none is left."""
    nodes = [_Node.of(first)]
    known, lost = {first.plan}, set[float]()  # plans driven; shifts that only leave the route's lanes
    for count in itertools.count():
        unused = [node for node in nodes if node.left]
        if not unused:
            return
        goes_back = count % _BACK_EVERY == _BACK_EVERY - 1
        node = unused[0] if goes_back else max(unused, key=lambda node: node.drive.place)  # of equal ones the earliest
        plan = node.left.pop(0)
        if plan in known or _shifts(plan) & lost:
            continue
        known.add(plan)
        tried = drive(plan)
        yield tried
        if tried.infraction in _LATE:
            lost |= _shifts(plan)
        elif tried.place > node.drive.place + _FARTHER and len(plan) < _MOST_STEPS:
            nodes.append(_Node.of(tried))


def _shifts(plan: Plan) -> set[float]:
    return {step.offset for step in plan if isinstance(step, Shift)}


def _tasks(config: CertifyConfig) -> Iterator[Task]:
    entries, kinds = _chosen(config)
    seen: set[tuple[str, str]] = set()
    index = 0
    for entry in select_routes(entries, config.route_ids):
        for spec in entry.scenarios:
            key = (spec.generation, spec.type)
            if (kinds is not None and key not in kinds) or (config.one_each and key in seen):
                continue
            seen.add(key)
            for seed in range(config.seeds):
                yield Task(index, entry, spec, seed, config)
                index += 1
    if index == 0:
        raise RouteError(f"{config.what}: no hazard of it in {entries[0].file}.")


def _chosen(config: CertifyConfig) -> tuple[list[RouteEntry], list[tuple[str, str]] | None]:
    """The routes, and the (generation, type) that count; None: all."""
    what = config.what
    if what == ALL:
        return read_routes(config.routes), None
    if what.endswith(".xml") or what in route_files():
        return read_routes(what), None
    return read_routes(config.routes), [find_type(what)]


def _header(config: CertifyConfig, tasks: Sequence[Task]) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "hazards": [[task.entry.to_json(), task.spec.name, task.seed] for task in tasks],
        "budget": config.budget,
        "agent": config.agent,
        "rules": config.rules,
        "follower": BLIND,
    }
