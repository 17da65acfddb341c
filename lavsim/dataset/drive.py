"""Drives one episode of a plan and records it: what a collecting worker does."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from lavsim.agent import AgentFailure, AgentHandle, AgentSpec, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.dataset.ends import DriveEnds
from lavsim.dataset.folder import working
from lavsim.dataset.noise import ControlNoise, DisturbedAgent
from lavsim.dataset.plan import CollectPlan, EpisodePlan
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.dataset.watched import Watched
from lavsim.dataset.writer import EpisodeWriter
from lavsim.episode import EpisodeResult, Observer, run_episode
from lavsim.errors import AgentError, LavsimError
from lavsim.random import Draws
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import find_suite, with_look
from lavsim.simulation import Simulation
from lavsim.world.snapshot import Snapshot

log = logging.getLogger(__name__)

FRAMES_PER_REPORT = 20
CRASHED = "crashed: "  # begins the ending of an episode whose simulation raised


@dataclass(frozen=True)
class EpisodeTask:
    """An episode to collect.

    Attributes:
        plan: Of the dataset.
        number: Of the episode.
        root: Folder of the dataset.
        town_path: Folders with towns.
    """

    plan: CollectPlan
    number: int
    root: Path
    town_path: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Kept:
    """How an episode under way stands: its number, frames kept, bytes written so far."""

    number: int
    frames: int


def info_of(plan: CollectPlan) -> DatasetInfo:
    """What a dataset of `plan` says of itself."""
    return DatasetInfo.of(record_config_of(plan), plan.seed, plan.to_json())


def record_config_of(plan: CollectPlan) -> RecordConfig:
    """What is recorded of each drive."""
    suite = with_look(find_suite(plan.suite), plan.look)
    return RecordConfig(suite, tables=not plan.log_only, blobs=not plan.log_only)


def collect_episode(task: EpisodeTask, report: Callable[[Kept], None]) -> EpisodeRecord:
    """Drives and records an episode; it exists once this returns.

    An episode in which the simulation itself fails is recorded as an empty one, so that a long collection goes on.

    Raises:
        OSError: its files can't be written.
        LavsimError: the plan's town, agent or suite is not to be had.
    """
    with working(task.root):
        episode = task.plan.episode(task.number, task.town_path)
        try:
            return drive_episode(task.root, task.plan, episode, report)
        except (OSError, MemoryError, LavsimError):
            raise
        except Exception as error:  # ours: the episode is lost, the dataset is not
            log.exception("%s: the simulation crashed", episode.name)
            ending = f"{CRASHED}{type(error).__name__}: {error}"
            record = _empty(episode, " ".join(ending.split()))
            record.write(task.root)
            return record


def drive_episode(root: Path, plan: CollectPlan, episode: EpisodePlan, report: Callable[[Kept], None]) -> EpisodeRecord:
    """Drives an episode to its end and puts its files into the folder; nothing is left of one that is cut off.

    Raises:
        AgentError: the agent can't be set up.
    """
    simulation = Simulation(episode.spec)
    watched, handle = drivers(plan.agent_spec(), plan.noise, simulation.draws, lambda: simulation.snapshot.ego.speed)
    writer = EpisodeWriter(root, episode.number, _info(plan), watched, _log_extra(plan), _facts(episode))
    observers: list[Observer] = [writer, DriveEnds(), _Reporter(episode.number, writer, report)]
    try:
        drive(simulation, handle, observers, episode.max_ticks)
    finally:
        handle.close()
    assert writer.record is not None
    return writer.record


def drivers(
    spec: AgentSpec, noise: ControlNoise | None, draws: Draws, speed: Callable[[], float]
) -> tuple[Watched, AgentHandle]:
    """The agent that is watched, and who hands its control to the world: itself, or the noise around it.

    Args:
        spec: The agent.
        noise: How its control is disturbed.
        draws: Root of the drive's draws.
        speed: Reads the ego's speed [m/s].
    """
    watched = Watched(InProcessAgent(spec))
    return watched, watched if noise is None else DisturbedAgent(watched, noise, draws, speed)


def drive(
    simulation: Simulation, agent: AgentHandle, observers: Sequence[Observer], max_ticks: int | None
) -> EpisodeResult:
    """Starts the agent and drives to the end.

    Raises:
        AgentError: the agent can't be set up.
    """
    try:
        agent.start(plan_of(simulation.route, simulation.town))
    except AgentFailure as failure:
        raise AgentError(f"the agent can't drive: {failure.message}") from None
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    return run_episode(simulation, agent, observers, suite, max_ticks)


class _Reporter:
    """Tells now and then how many frames are kept."""

    def __init__(self, number: int, writer: EpisodeWriter, report: Callable[[Kept], None]) -> None:
        self._number, self._writer, self._report = number, writer, report
        self._told = 0

    def start(self, simulation: Simulation) -> None:
        pass

    def observe(self, snapshot: Snapshot) -> str | None:
        if self._writer.frames >= self._told + FRAMES_PER_REPORT:
            self._told = self._writer.frames
            self._report(Kept(self._number, self._told))
        return None

    def finish(self, result: EpisodeResult) -> None:
        pass


@lru_cache(maxsize=2)
def _info(plan: CollectPlan) -> DatasetInfo:
    return info_of(plan)


def _log_extra(plan: CollectPlan) -> dict[str, Any]:
    """What the log says beside the drive: who drove, and how it was disturbed."""
    noise = plan.noise.model_dump(mode="json") if plan.noise is not None else None
    return {"agent": {"target": plan.agent, "config": plan.agent_config}, "noise": noise}


def _facts(episode: EpisodePlan) -> dict[str, Any]:
    return {"weather": episode.weather, "hazards": [scenario.type for scenario in episode.spec.scenarios]}


def _empty(episode: EpisodePlan, ending: str) -> EpisodeRecord:
    spec = episode.spec
    return EpisodeRecord(
        episode=episode.number,
        town=spec.town,
        route_id=spec.route_id,
        seed=spec.seed,
        frames=0,
        ticks=0,
        distance=0.0,
        ending=ending,
        agent_status=0,
        files={},
        facts=_facts(episode),
    )
