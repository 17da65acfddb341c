"""An episode of a dataset out of a recorded drive, without driving again.

The agent that a log names is asked again, tick by tick, over what was recorded: so its labels come back, and its
controls must be the recorded ones. Frames are made by the code that makes them in a drive, hence to the same bytes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.agent import AgentFailure, AgentSpec, AgentStatus, plan_of
from lavsim.config import parse_config
from lavsim.dataset import folder
from lavsim.dataset.drive import FRAMES_PER_REPORT, Kept, drivers
from lavsim.dataset.frames import wish_values
from lavsim.dataset.handover import Handover, first_of
from lavsim.dataset.noise import ControlNoise
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import DatasetInfo
from lavsim.dataset.writer import EpisodeWriter
from lavsim.episode import EpisodeResult
from lavsim.errors import LogError
from lavsim.log.reader import LogReader
from lavsim.log.replay import draws_of, route_of, town_of
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import DriveSpec
from lavsim.world.controls import ControlFilter
from lavsim.world.snapshot import Snapshot

_HISTORY = 101  # snapshots kept for sensors that look back, as in a drive
CUT_SHORT = "the log is cut short"


class RecordedDrive:
    """A log in place of the simulation it was made of: the same town, route and draws, and each tick once more.

    Args:
        reader: The log.
        town_path: Folders with towns.

    Attributes:
        snapshot: The newest tick.
    """

    snapshot: Snapshot

    def __init__(self, reader: LogReader, town_path: Sequence[Path] = ()) -> None:
        self._reader = reader
        self.spec = DriveSpec.from_header(reader.header, tuple(town_path))
        self.town = town_of(reader, town_path)
        self.route = route_of(reader, self.town)
        self.draws = draws_of(reader)
        self._recent: deque[Snapshot] = deque(maxlen=_HISTORY)

    def header(self) -> dict[str, Any]:
        """The log's own."""
        return {name: value for name, value in self._reader.header.items() if name != "schema"}

    def recent(self, count: int) -> list[Snapshot]:
        """The last `count` snapshots, newest last; fewer at the start."""
        return list(islice(self._recent, max(0, len(self._recent) - count), None))

    def __iter__(self) -> Iterator[Snapshot]:
        for snapshot in self._reader:
            self.snapshot = snapshot
            self._recent.append(snapshot)
            yield snapshot

    def result(self) -> EpisodeResult:
        """How it ended."""
        status = self._reader.status
        if status is None:
            return EpisodeResult(len(self._reader), CUT_SHORT)
        code = AgentStatus(status["agent_status"])
        failure = AgentFailure(code, status["ending"]) if code is not AgentStatus.DRIVING else None
        return EpisodeResult(status["ticks"], status["ending"], failure)


@dataclass(frozen=True)
class RenderTask:
    """A log to make an episode of.

    Attributes:
        log: The log.
        number: Of the episode.
        root: Folder of the dataset it goes into, described already.
        facts: More entries for its record.
        labels: Whether the agent that the log names is asked again.
        town_path: Folders with towns.
    """

    log: Path
    number: int
    root: Path
    facts: dict[str, Any]
    labels: bool = True
    town_path: tuple[Path, ...] = ()


def render_episode(task: RenderTask, report: Callable[[Kept], None]) -> EpisodeRecord:
    """Makes an episode of a recorded drive; it exists once this returns.

    Raises:
        OSError: its files can't be written.
        LavsimError: the log or its town can't be read, or its agent drives differently here.
    """
    with folder.working(task.root):
        reader = LogReader(task.log)
        recorded = RecordedDrive(reader, task.town_path)
        driver = _Driver(reader, recorded) if task.labels and reader.header.get("agent") else None
        watched = driver.watched if driver is not None else None
        first = first_of(reader.header)
        writer = EpisodeWriter(task.root, task.number, DatasetInfo.read(task.root), watched, None, task.facts, first)
        try:
            writer.start(recorded)  # type: ignore[arg-type]  # it has what is asked of one
            told = 0
            for snapshot in recorded:
                if driver is not None:
                    driver.step(snapshot)
                writer.observe(snapshot)
                if writer.frames >= told + FRAMES_PER_REPORT:
                    told = writer.frames
                    report(Kept(task.number, told))
            writer.finish(recorded.result())
        except BaseException:
            writer.abandon()
            raise
        finally:
            if driver is not None:
                driver.close()
        assert writer.record is not None
        return writer.record


def drives_alike(log: Path, town_path: Sequence[Path] = ()) -> str | None:
    """Asks the agent that a log names again at each of its ticks.

    Returns:
        In what it differs from the one recorded; None if in nothing, or if the log names no agent.

    Raises:
        LavsimError: the log or its town can't be read.
    """
    reader = LogReader(log)
    if not reader.header.get("agent"):
        return None
    recorded = RecordedDrive(reader, town_path)
    try:
        driver = _Driver(reader, recorded)
    except LogError as error:
        return str(error)
    try:
        for snapshot in recorded:
            driver.step(snapshot)
    except LogError as error:
        return str(error)
    finally:
        driver.close()
    return None


class _Driver:
    """Steps the agent of a log again, and holds it to the controls recorded.

    Attributes:
        watched: The agent, for its labels.
    """

    def __init__(self, reader: LogReader, recorded: RecordedDrive) -> None:
        header = reader.header
        spec = AgentSpec(header["agent"]["target"], header["agent"]["config"])
        noise = parse_config(ControlNoise, header["noise"]) if header.get("noise") is not None else None
        self._name, self._recorded = reader.path.name, recorded
        self.watched, agent = drivers(spec, noise, recorded.draws, lambda: recorded.snapshot.ego.speed)
        self._agent = agent
        if first_of(header):
            self._agent = Handover(agent, reader.controls(), reader[0].tick, first_of(header))
        try:
            self._agent.start(plan_of(recorded.route, recorded.town))
        except AgentFailure as failure:
            raise LogError(f"{self._name}: the agent {spec.target} can't drive here: {failure.message}") from None
        self._suite = SensorSuite(get_scene(recorded.town), self._agent.sensors(), recorded.draws)
        self._filter = ControlFilter()
        self._asked: NDArray[np.float32] | None = None

    def step(self, snapshot: Snapshot) -> None:
        """Asks the agent at a tick.

        Raises:
            LogError: what it asked for at the tick before is not what was recorded.
        """
        if self._asked is not None and not np.array_equal(self._asked, snapshot.control):
            raise LogError(
                f"{self._name}: at tick {snapshot.tick - 1} the agent drives differently from the one recorded; "
                "give --no-labels to do without what it says of its driving."
            )
        try:
            control = self._agent.step(self._suite.read(self._recorded.recent(self._suite.history + 1)), snapshot.time)
        except AgentFailure as failure:
            raise LogError(f"{self._name}: at tick {snapshot.tick} the agent failed: {failure.message}") from None
        self._asked = wish_values(self._filter.clean(control))

    def close(self) -> None:
        self._agent.close()
