"""One drive of one route by one agent, judged and recorded; an agent's failure ends this drive and no other."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lavsim.agent import AgentFailure, AgentHandle, AgentShell, AgentSpec, AgentStatus, Readings, Track, plan_of
from lavsim.episode import EpisodeResult, Observer, run_episode
from lavsim.errors import LavsimError
from lavsim.isolation import ChildAgent
from lavsim.log.drawings import SUFFIX, DrawingsWriter
from lavsim.log.writer import LogWriter
from lavsim.map.town_files import TOWN_PATH
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import find_suite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control
from lavsim.world.snapshot import Snapshot
from leaderboard.latency import PacedAgent
from leaderboard.metrics import DriveMetrics, MetricsObserver
from leaderboard.observer import CriteriaObserver, Verdict, judge
from leaderboard.outcomes import DriveOutcome
from leaderboard.picture import draw_drive
from leaderboard.routes import RouteEntry
from leaderboard.rules import Rules
from leaderboard.run import LOGS, PICTURES
from leaderboard.score import SIMULATION_CRASHED
from leaderboard.sensor_check import check_sensors

log = logging.getLogger(__name__)

TICKS_PER_REPORT = 20  # ticks between progress reports


@dataclass(frozen=True)
class DriveTask:
    """All that decides one drive.

    Attributes:
        index: Place in the run.
        name: Names its files.
        route_id: As the results file has it.
        entry: The route.
        repetition: Which drive of this route.
        seed: Of this drive.
        traffic: Its profile.
        rules: What it is judged by.
        agent: Who drives.
        track: Track the agent must be on, or None.
        sensors: Suite rendered beside the agent's own, or None.
        town_path: Folders with towns.
        latency: Ticks by which controls act late.
        out: Folder of the run.
        pictures: Whether a contact sheet is drawn.
    """

    index: int
    name: str
    route_id: str
    entry: RouteEntry
    repetition: int
    seed: int
    traffic: str
    rules: Rules
    agent: AgentSpec
    track: str | None
    sensors: str | None
    town_path: tuple[Path, ...]
    latency: int
    out: Path
    pictures: bool

    @property
    def log(self) -> Path:
        """The recorded drive."""
        return self.out / LOGS / f"{self.name}.lavlog"

    @property
    def output(self) -> Path:
        """What the agent printed."""
        return self.out / LOGS / f"{self.name}.agent.txt"

    @property
    def picture(self) -> Path:
        """The contact sheet."""
        return self.out / PICTURES / f"{self.name}.png"

    def spec(self) -> DriveSpec:
        """What the simulation is told."""
        return DriveSpec(
            town=self.entry.town,
            route_id=self.entry.id,
            keypoints=self.entry.keypoints,
            weather=self.entry.weather,
            scenarios=self.entry.scenarios,
            seed=self.seed,
            traffic=self.traffic,
            rules=self.rules.version,
            generation=self.rules.generation,
            town_path=self.town_path,
        )


OnTick = Callable[[Verdict], None]


@dataclass(frozen=True)
class Tick:
    """How a drive under way stands: its number, percent of its route, simulated time [s], infractions so far."""

    index: int
    completion: float
    time: float
    infractions: int


def drive_task(task: DriveTask, report: Callable[[Tick], None]) -> DriveOutcome:
    """Drives `task`, leaves its log and picture in the run's folder, and reports every second of simulated time."""

    def on_tick(verdict: Verdict) -> None:
        report(Tick(task.index, verdict.completion, verdict.duration, len(verdict.infractions)))

    outcome = run_drive(task, on_tick)
    drawn = task.pictures and draw_drive(task.log, task.picture, outcome.details["infractions"], task.town_path)
    files = {
        "log": task.log.relative_to(task.out).as_posix() if task.log.exists() else None,
        "picture": task.picture.relative_to(task.out).as_posix() if drawn else None,
    }
    return replace(outcome, details={**outcome.details, **files})


def lost_drive(task: DriveTask, reason: str) -> DriveOutcome:
    """The outcome of a drive whose own process was lost."""
    record = judge(Verdict(failure=SIMULATION_CRASHED), task.rules, task.index, task.route_id, 0.0)
    return DriveOutcome(record, (), None, {**_identity(task), **_NOTHING, "ending": reason})


_NOTHING: Mapping[str, Any] = {
    "town_digest": None, "agent_status": 0, "agent_message": None, "ticks": 0, "dense_length": 0.0,
    "keypoint_length": 0.0, "completion": 0.0, "infractions": [], "metrics": DriveMetrics().to_json(), "step_ms": None,
    "setup_seconds": 0.0, "drive_seconds": 0.0, "real_time_factor": 0.0, "log": None, "picture": None,
}  # fmt: skip


def _identity(task: DriveTask) -> dict[str, Any]:
    """Which drive it is."""
    return {
        "index": task.index,
        "name": task.name,
        "route": task.entry.id,
        "repetition": task.repetition,
        "town": task.entry.town,
        "seed": task.seed,
        "traffic": task.traffic,
        "scenarios": [scenario.type for scenario in task.entry.scenarios],
    }


def run_drive(task: DriveTask, on_tick: OnTick | None = None) -> DriveOutcome:
    """Drives `task` to its end, whatever the agent does."""
    criteria, metrics = CriteriaObserver(task.rules), MetricsObserver()
    begun = time.perf_counter()
    simulation = Simulation(task.spec())
    criteria.watch(simulation.town, simulation.route)
    metrics.watch(simulation.town, simulation.route)
    child = ChildAgent(task.agent, task.output, _environment(task.town_path))
    agent = PacedAgent(child, task.latency)
    sensors: list[dict[str, Any]] = []
    track: Track | None = None
    failure: AgentFailure | None = None
    ending, crash = "", None
    started = time.perf_counter()
    try:
        agent.start(plan_of(simulation.route, simulation.town), task.rules.plan_spacing)
        track, sensors = agent.track, agent.sensors()
        check_sensors(sensors, track, task.track, task.rules)
        suite, handle = _suite(simulation, sensors, task.sensors, agent)
        observers: list[Observer] = [criteria, metrics, LogWriter(task.log, {"suite": sensors})]
        if task.agent.drawings:
            observers.append(DrawingsWriter(task.log.with_suffix(SUFFIX), child.drawings))
        if on_tick is not None:
            observers.append(_Reporter(criteria, on_tick))
        started = time.perf_counter()
        result = run_episode(simulation, handle, observers, suite)
        ending, failure = result.ending, result.failure
    except AgentFailure as error:
        ending, failure = error.message, error
        criteria.close(error)
    except Exception as error:  # ours: the drive is lost, the run is not
        log.exception("%s: the simulation crashed", task.name)
        ending = crash = f"{type(error).__name__}: {error}"
    finally:
        ended = time.perf_counter()
        agent.close()
    verdict = criteria.verdict()
    if crash is not None:
        verdict = replace(verdict, failure=SIMULATION_CRASHED)
    record = judge(verdict, task.rules, task.index, task.route_id, ended - started)
    details = {
        **_identity(task),
        "town_digest": simulation.town.digest,
        "ending": ending,
        "agent_status": int(failure.status) if failure else 0,
        "agent_message": failure.message if failure else None,
        "ticks": verdict.ticks,
        "dense_length": verdict.route_length,
        "keypoint_length": verdict.keypoint_length,
        "completion": verdict.completion,
        "infractions": [i.to_json() for i in sorted(verdict.infractions, key=lambda i: i.tick)],
        "metrics": metrics.metrics().to_json(),
        "step_ms": agent.step_ms(),
        "setup_seconds": started - begun,
        "drive_seconds": ended - started,
        "real_time_factor": verdict.duration / max(ended - started, 1e-9),
    }
    kinds = tuple(str(sensor.get("type", "")) for sensor in sensors)
    return DriveOutcome(record, kinds, track.value if track else None, details)


def _environment(town_path: tuple[Path, ...]) -> dict[str, str]:
    """What the agent's process needs to find the towns that this one finds."""
    if not town_path:
        return {}
    known = [os.environ[TOWN_PATH]] if os.environ.get(TOWN_PATH) else []
    return {TOWN_PATH: os.pathsep.join([*(str(folder.resolve()) for folder in town_path), *known])}


def _suite(
    simulation: Simulation, sensors: list[dict[str, Any]], extra: str | None, agent: AgentHandle
) -> tuple[SensorSuite, AgentHandle]:
    """The sensors to render, and who gets them: an agent sees what it asked for, a suite beside it is only rendered."""
    own = {str(sensor["id"]) for sensor in sensors}
    handle = agent
    wanted = list(sensors)
    if extra is not None:
        wanted += [{**sensor, "id": f"suite:{sensor['id']}"} for sensor in find_suite(extra)]
        handle = _OwnReadings(agent, own)
    try:
        return SensorSuite(get_scene(simulation.town), wanted, simulation.draws), handle
    except LavsimError as error:
        raise AgentFailure(AgentStatus.SENSORS_INVALID, str(error)) from None


class _OwnReadings(AgentShell):
    """An agent that gets its own sensors' readings out of more."""

    def __init__(self, agent: AgentHandle, ids: set[str]) -> None:
        super().__init__(agent)
        self._ids = ids

    def step(self, readings: Readings, time: float) -> Control:
        return self._agent.step({key: value for key, value in readings.items() if key in self._ids}, time)


class _Reporter:
    """Tells now and then how the drive stands."""

    def __init__(self, criteria: CriteriaObserver, on_tick: OnTick) -> None:
        self._criteria, self._on_tick = criteria, on_tick
        self._ticks = 0

    def start(self, simulation: Simulation) -> None:
        self._on_tick(self._criteria.verdict())

    def observe(self, snapshot: Snapshot) -> str | None:
        self._ticks += 1
        if self._ticks % TICKS_PER_REPORT == 0:
            self._on_tick(self._criteria.verdict())
        return None

    def finish(self, result: EpisodeResult) -> None:
        self._on_tick(self._criteria.verdict())
