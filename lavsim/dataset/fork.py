"""Drives that failed, taken over by an expert some seconds before: what `lavsim fork` calls.

Experts never are where a learner's mistakes lead, so their demonstrations don't show the way back. Here the recorded
controls of a drive are driven once more up to a while before its failure, and an expert drives from there. Out comes a
log like any other; `lavsim render` makes frames of what follows the handover.

Source: Ross et al. 2011, "A reduction of imitation learning and structured prediction to no-regret online learning"
(AISTATS): an expert's answers where the learner's own driving leads. Failures are the states that count most (Prakash
et al. 2020, "Exploring data aggregation in policy learning for vision-based urban autonomous driving", CVPR).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from lavsim.agent import AgentFailure, AgentSpec, plan_of
from lavsim.agent_source import find_agent
from lavsim.config import Config
from lavsim.dataset.drive import drivers
from lavsim.dataset.ends import DriveEnds
from lavsim.dataset.files import partial_of, publish
from lavsim.dataset.handover import HANDOVER, Handover
from lavsim.dataset.schema import TICKS_PER_FRAME
from lavsim.episode import run_episode
from lavsim.errors import AgentError, LogError, OutputError
from lavsim.executor import make_executor
from lavsim.log.reader import LogReader
from lavsim.log.replay import digest_of, town_of
from lavsim.log.writer import LogWriter
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import DT
from lavsim.world.snapshot import Snapshot


@dataclass(frozen=True)
class Failure:
    """A moment of a recorded drive that went wrong.

    Attributes:
        log: The drive.
        tick: When.
        what: Its kind, for who reads the header of the fork.
    """

    log: Path
    tick: int
    what: str


class ForkConfig(Config):
    """How drives are taken over."""

    agent: str = Field(default="agents.behavior:BehaviorAgent", description="Who takes over: module:Class.")
    agent_config: str | None = Field(default=None, description="Handed to its setup as it is.")
    before: float = Field(default=6.0, gt=0.0, description="So long before the failure [s].")
    after: float = Field(default=15.0, gt=0.0, description="It drives for so long [s].")


@dataclass(frozen=True)
class ForkTask:
    """A drive to take over.

    Attributes:
        failure: What is to be done better.
        config: By whom, how long before and for how long.
        out: The log that is written.
        town_path: Folders with towns.
    """

    failure: Failure
    config: ForkConfig
    out: Path
    town_path: tuple[Path, ...] = ()

    @property
    def tick(self) -> int:
        """The expert's first, one at which a frame is due."""
        frames = (self.failure.tick - round(self.config.before / DT)) // TICKS_PER_FRAME
        return max(frames, 1) * TICKS_PER_FRAME


def fork(
    failures: Sequence[Failure],
    out: Path,
    config: ForkConfig,
    *,
    workers: int = 1,
    resume: bool = False,
    town_path: tuple[Path, ...] = (),
    on_done: Callable[[ForkTask, str], None] | None = None,
) -> list[Path]:
    """Takes over before each failure and writes a log of it into a folder.

    Args:
        failures: What went wrong; those within `config.after` of one before in the same drive are left out.
        out: Folder of the logs.
        config: Who takes over, and when.
        workers: Processes that drive side by side.
        resume: Goes on with the folder: logs that are there stay.
        town_path: Folders with towns.
        on_done: Told of each fork and how it ended.

    Returns:
        The logs, in the order of the failures.

    Raises:
        LavsimError: there is no such agent, the folder holds logs already, or a drive can't be repeated here.
    """
    find_agent(config.agent)
    tasks = [
        ForkTask(failure, config, out / f"fork_{number:05d}.lavlog", town_path)
        for number, failure in enumerate(apart(failures, config.after))
    ]
    if not resume and out.is_dir() and any(out.glob("fork_*.lavlog")):
        raise OutputError(f"{out} holds forks already; give --resume, or another folder.")
    out.mkdir(parents=True, exist_ok=True)
    missing = [task for task in tasks if not task.out.exists()]
    for done in make_executor(workers).run(drive_fork, missing):
        if done.result is None:
            raise OutputError(f"{done.task.out.name} was lost: {done.lost}. The others are safe: go on with --resume.")
        if on_done is not None:
            on_done(done.task, done.result)
    return [task.out for task in tasks]


def apart(failures: Iterable[Failure], seconds: float) -> list[Failure]:
    """Failures without those of a drive that follow one kept within so many seconds."""
    kept: list[Failure] = []
    for failure in sorted(failures, key=lambda each: (str(each.log), each.tick)):
        if not kept or kept[-1].log != failure.log or failure.tick - kept[-1].tick > seconds / DT:
            kept.append(failure)
    return kept


def drive_fork(task: ForkTask, report: Callable[[Any], None]) -> str:
    """Drives a fork, writes its log, and says how it ended; the log exists once this returns.

    Raises:
        LogError: the drive can't be repeated here.
        AgentError: the agent can't drive.
    """
    reader, config = LogReader(task.failure.log), task.config
    town_of(reader, task.town_path)  # must be the one that was driven in
    simulation = Simulation(DriveSpec.from_header(reader.header, task.town_path))
    _, expert = drivers(AgentSpec(config.agent, config.agent_config), None, simulation.draws, lambda: 0.0)
    agent = Handover(expert, reader.controls(), reader[0].tick, task.tick)
    try:
        agent.start(plan_of(simulation.route, simulation.town))
        suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
        log = LogWriter(partial_of(task.out), _header(task))
        check = _Alike(reader, task.tick)
        result = run_episode(
            simulation, agent, [check, log, _EndsLater(task.tick)], suite, task.tick + round(config.after / DT)
        )
    except AgentFailure as failure:
        raise AgentError(f"the agent can't drive: {failure.message}") from None
    except BaseException:
        partial_of(task.out).unlink(missing_ok=True)
        raise
    finally:
        agent.close()
    publish(task.out)
    return result.ending


def _header(task: ForkTask) -> dict[str, Any]:
    """What the log says beside the drive: who drove from when on, and what it is a fork of."""
    failure = task.failure
    return {
        "agent": {"target": task.config.agent, "config": task.config.agent_config},
        "noise": None,
        HANDOVER: task.tick,
        "fork": {"log": failure.log.name, "tick": failure.tick, "what": failure.what},
    }


class _Alike:
    """Observer that holds a drive to the recorded one until the handover."""

    def __init__(self, reader: LogReader, tick: int) -> None:
        self._reader, self._tick = reader, tick

    def start(self, simulation: Simulation) -> None:
        """Nothing is to be prepared."""

    def observe(self, snapshot: Snapshot) -> str | None:
        if snapshot.tick == self._tick and digest_of(snapshot) != digest_of(self._reader.at_tick(self._tick)):
            name = self._reader.path.name
            raise LogError(f"{name}: driven again, tick {self._tick} differs from the recorded one.")
        return None

    def finish(self, result: Any) -> None:
        """Nothing is to be ended."""


class _EndsLater(DriveEnds):
    """Ends as collected drives do, once the expert drives: what the learner did before is not his."""

    def __init__(self, tick: int) -> None:
        self._tick = tick

    def observe(self, snapshot: Snapshot) -> str | None:
        ending = super().observe(snapshot)
        return ending if snapshot.tick >= self._tick else None
