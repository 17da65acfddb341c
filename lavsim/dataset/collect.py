"""Collects a dataset: what `lavsim collect` calls.

The dataset is the shortest run of the plan's episodes 0, 1, 2 … that keeps as many frames as were asked for. Episodes
are driven in any order by any number of workers; one that is finished stays, one that was cut off by a kill is driven
again, and what lies beyond the last one needed goes at the end. So the bytes depend on the plan alone.
"""

from __future__ import annotations

import errno
import itertools
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.agent import find_agent
from lavsim.dataset import folder
from lavsim.dataset.drive import EpisodeTask, Kept, collect_episode, info_of
from lavsim.dataset.files import read_sealed, write_sealed
from lavsim.dataset.plan import PLAN_SCHEMA, CollectPlan
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import INFO, DatasetInfo
from lavsim.errors import LavsimError, OutputError
from lavsim.executor import Executor, make_executor

PLAN_KEY = "plan_schema"
_EMPTY_IN_A_ROW = 100  # episodes without a frame after which something must be wrong
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_MAY_CHANGE = ("frames",)  # of a plan when its dataset is gone on with: more of the same


@dataclass(frozen=True)
class CollectProgress:
    """How a collection stands.

    Attributes:
        frames: Kept so far, episodes under way included.
        fresh: Those of them that were not there when it began.
        wanted: Frames asked for.
        episodes: Finished.
        bytes: On disk.
        free: Bytes that the disk has left.
        last: Record of an episode just finished.
    """

    frames: int
    fresh: int
    wanted: int
    episodes: int
    bytes: int
    free: int
    last: EpisodeRecord | None = None


@dataclass(frozen=True)
class Collected:
    """A finished dataset.

    Attributes:
        root: Its folder.
        records: Of its episodes, in order.
    """

    root: Path
    records: tuple[EpisodeRecord, ...]

    @property
    def frames(self) -> int:
        """Kept frames."""
        return sum(record.frames for record in self.records)

    @property
    def bytes(self) -> int:
        """Of all files of its episodes."""
        return sum(bytes_of(record) for record in self.records)


OnProgress = Callable[[CollectProgress], None]


def collect(
    plan: CollectPlan,
    root: Path,
    *,
    workers: int = 1,
    cluster: str | None = None,
    resume: bool = False,
    overwrite: bool = False,
    town_path: tuple[Path, ...] = (),
    on_progress: OnProgress | None = None,
) -> Collected:
    """Collects the dataset of `plan` into a folder.

    Args:
        plan: What it shall be.
        root: The folder.
        workers: Processes that drive side by side.
        cluster: Address of a Ray cluster that drives instead.
        resume: Goes on with the dataset that is there; with more frames it grows.
        overwrite: Replaces the dataset that is there.
        town_path: Folders with towns.
        on_progress: Told how it stands.

    Raises:
        LavsimError: a mistake in the plan, a folder that holds another dataset, a full disk: what is finished stays.
    """
    if resume and overwrite:
        raise OutputError("--overwrite starts anew and --resume goes on: give one of them.")
    find_agent(plan.agent)
    digests = plan.check(town_path)
    info = info_of(plan)
    executor = make_executor(workers, cluster)
    with _disk_trouble_told(root):
        folder.claim(root, resume, overwrite)
        with folder.writing(root):
            _begin(root, plan, digests, info)
            with folder.quiet(root):
                book = _Book(plan, root, on_progress)
                folder.sweep(root, book.records)
            tasks = (EpisodeTask(plan, number, root.resolve(), town_path) for number in book.waiting())
            try:
                _run(executor, tasks, book)
            except OSError as error:
                raise _told(error, root, book) from None
            finally:
                _tidy(root, book)
    return Collected(root, tuple(book.records[number] for number in sorted(book.records)))


def _run(executor: Executor, tasks: Iterator[EpisodeTask], book: _Book) -> None:
    """Drives until there are episodes enough; the workers have ended then."""
    runs: Any = executor.run(collect_episode, tasks, book.report)
    with closing(runs):
        while not book.is_enough:
            done = next(runs)
            if done.result is None:
                raise OutputError(
                    f"episode {done.task.number} was lost: {done.lost}. {book.count_of_frames()} frames are safe: "
                    "go on with --resume."
                )
            book.enter(done.result)
    book.cut()


def _tidy(root: Path, book: _Book) -> None:
    """Removes what was not finished; what can't be removed now goes when the collection is resumed."""
    with suppress(OutputError), folder.quiet(root):
        folder.sweep(root, book.records)


def bytes_of(record: EpisodeRecord) -> int:
    """Bytes of an episode's files."""
    return sum(facts.bytes for facts in record.files.values())


class _Book:
    """The episodes that are finished, and which are still to be driven.

    Args:
        plan: Of the dataset.
        root: Its folder.
        on_progress: Told how it stands.

    Attributes:
        records: Of the episodes finished, by number.
    """

    def __init__(self, plan: CollectPlan, root: Path, on_progress: OnProgress | None) -> None:
        self._plan, self._root, self._on_progress = plan, root, on_progress
        self.records = folder.whole_episodes(root)
        self._before = sum(record.frames for record in self.records.values())
        self._under_way: dict[int, int] = {}
        self._size = sum(map(bytes_of, self.records.values()))
        self._tell()

    def waiting(self) -> Iterator[int]:
        """Numbers of the episodes to drive, without an end."""
        return (number for number in itertools.count() if number not in self.records)

    @property
    def is_enough(self) -> bool:
        return self._length() is not None

    def count_of_frames(self) -> str:
        """For messages: how many frames are finished of those wanted."""
        return f"{sum(record.frames for record in self.records.values())} of {self._plan.frames}"

    def report(self, kept: Kept) -> None:
        """Passes on how an episode under way stands."""
        if kept.number not in self.records:
            self._under_way[kept.number] = kept.frames
            self._tell()

    def enter(self, record: EpisodeRecord) -> None:
        """Adds an episode.

        Raises:
            OutputError: no episode keeps a frame.
        """
        self.records[record.episode] = record
        self._under_way.pop(record.episode, None)
        self._size += bytes_of(record)
        self._tell(record)
        last = [self.records[number] for number in sorted(self.records)[-_EMPTY_IN_A_ROW:]]
        if len(last) == _EMPTY_IN_A_ROW and not any(entry.frames for entry in last):
            raise OutputError(f"{_EMPTY_IN_A_ROW} episodes in a row kept no frame; the last: {record.ending}.")

    def cut(self) -> None:
        """Removes the episodes beyond the last one needed."""
        length = self._length()
        for number in [number for number in self.records if length is not None and number >= length]:
            folder.remove(self._root, number)
            del self.records[number]

    def _length(self) -> int | None:
        """How many episodes from the first on have the frames wanted; None if not all of them are there."""
        frames = 0
        for number in itertools.count():
            if number not in self.records:
                return None
            frames += self.records[number].frames
            if frames >= self._plan.frames:
                return number + 1
        return None

    def _tell(self, last: EpisodeRecord | None = None) -> None:
        if self._on_progress is None:
            return
        frames = sum(record.frames for record in self.records.values()) + sum(self._under_way.values())
        self._on_progress(
            CollectProgress(
                frames=frames,
                fresh=frames - self._before,
                wanted=self._plan.frames,
                episodes=len(self.records),
                bytes=self._size,
                free=shutil.disk_usage(self._root).free,
                last=last,
            )
        )


def _begin(root: Path, plan: CollectPlan, digests: Mapping[str, str], info: DatasetInfo) -> None:
    """Writes plan and description, or finds that those there are of the same dataset.

    Raises:
        OutputError: they are of another one; the message names the first field that differs.
        DatasetError: they are damaged, or of another version.
    """
    content = {PLAN_KEY: PLAN_SCHEMA, "plan": plan.to_json(), "town_digests": dict(digests)}
    if (root / folder.PLAN).exists():
        begun = read_sealed(root / folder.PLAN, PLAN_KEY, PLAN_SCHEMA)
        _check_same(root, begun["plan"], plan.to_json(), "")
        _check_same(root, begun["town_digests"], dict(digests), "town ")
    if (root / INFO).exists():
        versions = DatasetInfo.read(root).versions
        _check_same(root, {"lavsim": versions.get("lavsim")}, {"lavsim": info.versions["lavsim"]}, "")
    info.write(root)
    write_sealed(root / folder.PLAN, content)


def _check_same(root: Path, before: Mapping[str, Any], now: Mapping[str, Any], kind: str) -> None:
    for name in now:
        if name == "frames" and before[name] > now[name]:
            raise OutputError(f"the dataset in {root} was begun for {before[name]} frames; it can grow, not shrink.")
        if name not in _MAY_CHANGE and before.get(name) != now[name]:
            raise OutputError(
                f"the dataset in {root} was begun with {kind}{name} = {before.get(name)!r}, not {now[name]!r}; "
                "resume it as it was begun, or give another folder."
            )


@contextmanager
def _disk_trouble_told(root: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise _told(error, root, None) from None


def _told(error: OSError, root: Path, book: _Book | None) -> LavsimError:
    """What a user reads when the disk does not take what is written."""
    safe = f" {book.count_of_frames()} frames are safe: make room and go on with --resume." if book is not None else ""
    if error.errno in _FULL:
        return OutputError(f"no space is left for {root} ({error.strerror}).{safe}")
    what = f"{error.filename}: " if error.filename else ""
    return OutputError(f"can't write to {root}: {what}{error.strerror or error}.{safe}")
