"""Records a drive as an episode of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lavsim.dataset.codecs import find_codec
from lavsim.dataset.files import FileFacts, partial_of, publish
from lavsim.dataset.frames import FrameMaker
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import TICKS_PER_FRAME, DatasetInfo, FieldSpec, file_of
from lavsim.dataset.shard import ShardWriter
from lavsim.dataset.tables import Table, write_table
from lavsim.dataset.watched import Driver
from lavsim.log.writer import LogWriter
from lavsim.render.scene import get_scene
from lavsim.world.snapshot import Snapshot

if TYPE_CHECKING:
    from lavsim.episode import EpisodeResult
    from lavsim.simulation import Simulation


class EpisodeWriter:
    """Observer that records a drive: log, table, shard, and last the record that makes them an episode.

    A drive that is interrupted leaves nothing. All files lie under other names until they are whole.

    Args:
        root: The dataset's folder.
        episode: Number of the episode.
        info: What the dataset holds.
        driver: Whose wishes and labels are kept; None if nobody says.
        log_extra: More entries for the log's header, in JSON types.
        facts: More entries for the record, in JSON types.
        first: Tick of the first frame, at the earliest.

    Attributes:
        frames: Kept so far.
        record: The episode's, once it is finished.
    """

    def __init__(
        self,
        root: Path,
        episode: int,
        info: DatasetInfo,
        driver: Driver | None = None,
        log_extra: Mapping[str, Any] | None = None,
        facts: Mapping[str, Any] | None = None,
        first: int = 0,
    ) -> None:
        self._root, self._episode, self._info, self._first = root, episode, info, first
        self._driver, self._facts = driver, dict(facts or {})
        self._log_extra = dict(log_extra or {})
        self._rows: list[dict[str, Any]] = []
        self._log: LogWriter | None = None
        self._shard: ShardWriter | None = None
        self._distance = 0.0
        self._kept: int | None = None  # tick of the newest frame
        self._breaks: list[int] = []
        self._before: Snapshot | None = None
        self.frames = 0
        self.record: EpisodeRecord | None = None

    def start(self, simulation: Simulation) -> None:
        """Opens the files.

        Raises:
            OSError: they can't be written; what was begun is removed.
        """
        with self._writing():
            self._open(simulation)

    def observe(self, snapshot: Snapshot) -> str | None:
        """Keeps a tick; never ends the drive.

        Raises:
            OSError: it can't be written; what was begun is removed.
        """
        with self._writing():
            self._see(snapshot)
        return None

    def finish(self, result: EpisodeResult) -> None:
        """Makes the episode exist, unless the drive was interrupted.

        Raises:
            OSError: it can't be written; what was begun is removed.
        """
        if result.ending == "interrupted":
            self.abandon()
        else:
            with self._writing():
                self._close(result)

    def abandon(self) -> None:
        """Removes the files that were begun; those that have their names already stay, they may have been there."""
        if self._log is not None:
            with suppress(OSError):  # what it still held did not fit on the disk
                self._log.close()
        partial_of(self._path("log")).unlink(missing_ok=True)
        if self._shard is not None:
            self._shard.abandon()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.abandon()
            raise

    def _open(self, simulation: Simulation) -> None:
        info = self._info
        self._spec = simulation.spec
        scene = get_scene(simulation.town)
        self._maker = FrameMaker(info.record, simulation.route, scene, simulation.draws, self._first)
        log = self._path("log")
        self._log = LogWriter(partial_of(log), self._log_extra)
        self._log.start(simulation)
        if info.record.blobs:
            members = [item.member for item in info.blobs]
            self._shard = ShardWriter(self._path("shard"), self._path("index"), members)

    def _see(self, snapshot: Snapshot) -> None:
        assert self._log is not None
        self._log.observe(snapshot)
        if self._before is not None:
            step = snapshot.xy[0] - self._before.xy[0]
            self._distance += float((step @ step) ** 0.5)
        self._before = snapshot
        if self._maker.see(snapshot):
            self._keep(snapshot)

    def _close(self, result: EpisodeResult) -> None:
        assert self._log is not None
        self._log.finish(result)
        spec, status = self._spec, int(result.summary()["agent_status"])
        self.record = EpisodeRecord(
            self._episode, spec.town, spec.route_id, spec.seed, self.frames, result.ticks, round(self._distance, 3),
            result.ending, status, self._publish(), self._facts, tuple(self._breaks),
        )  # fmt: skip
        self.record.write(self._root)

    def _keep(self, snapshot: Snapshot) -> None:
        record, driver = self._info.record, self._driver
        seen = self._maker.read() if record.blobs else None
        if record.tables:
            labels = driver.labels() if driver is not None else {}
            self._rows.append(self._maker.row(labels, driver.wish if driver is not None else None, seen))
        if seen is not None and self._shard is not None:
            self._shard.add([find_codec(item.codec).encode(seen.blobs[item.name]) for item in self._info.blobs])
        if self._kept is not None and snapshot.tick != self._kept + TICKS_PER_FRAME:
            self._breaks.append(self.frames)
        self._kept = snapshot.tick
        self.frames += 1

    def _publish(self) -> dict[str, FileFacts]:
        """Puts all files under their names."""
        files = {}
        publish(self._path("log"))
        files[file_of("log", self._episode)] = FileFacts.of(self._path("log"))
        if self._info.record.tables:
            columns: tuple[FieldSpec, ...] = self._info.columns
            spec = self._spec
            facts = {"episode": str(self._episode), "town": spec.town, "route": spec.route_id, "seed": str(spec.seed)}
            table = Table.of_rows(self._rows, columns)
            files[file_of("table", self._episode)] = write_table(self._path("table"), table, columns, facts)
        if self._shard is not None:
            shard, index = self._shard.finish()
            files |= {file_of("shard", self._episode): shard, file_of("index", self._episode): index}
        return files

    def _path(self, kind: str) -> Path:
        return self._root / file_of(kind, self._episode)
