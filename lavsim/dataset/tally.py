"""How a dataset that is being made stands, and what a user reads when the disk does not take it."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from lavsim.dataset.drive import Kept
from lavsim.dataset.record import EpisodeRecord
from lavsim.errors import OutputError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True)
class Progress:
    """How it stands.

    Attributes:
        frames: Kept so far, episodes under way included.
        fresh: Those of them that were not there when it began.
        wanted: Frames asked for.
        episodes: Finished.
        bytes: Of the files of finished episodes.
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


OnProgress = Callable[[Progress], None]


class Tally:
    """The episodes of a folder that are finished, and the frames of those under way.

    Args:
        root: The folder.
        wanted: Frames asked for.
        records: Of the episodes finished, by number.
        on_progress: Told how it stands.

    Attributes:
        records: Of the episodes finished, by number.
    """

    def __init__(
        self, root: Path, wanted: int, records: dict[int, EpisodeRecord], on_progress: OnProgress | None = None
    ) -> None:
        self.records = records
        self._root, self._wanted, self._on_progress = root, wanted, on_progress
        self._under_way: dict[int, int] = {}
        self._done = sum(record.frames for record in records.values())
        self._size = sum(map(bytes_of, records.values()))
        self._before = self._done
        self._tell()

    def __str__(self) -> str:
        return f"{self._done} of {self._wanted} frames"

    def report(self, kept: Kept) -> None:
        """Passes on how an episode under way stands."""
        if kept.number not in self.records:
            self._under_way[kept.number] = kept.frames
            self._tell()

    def enter(self, record: EpisodeRecord) -> None:
        """Adds an episode."""
        self.records[record.episode] = record
        self._under_way.pop(record.episode, None)
        self._done += record.frames
        self._size += bytes_of(record)
        self._tell(record)

    def _tell(self, last: EpisodeRecord | None = None) -> None:
        if self._on_progress is None:
            return
        frames = self._done + sum(self._under_way.values())
        free = shutil.disk_usage(self._root).free
        self._on_progress(
            Progress(frames, frames - self._before, self._wanted, len(self.records), self._size, free, last)
        )


def bytes_of(record: EpisodeRecord) -> int:
    """Bytes of an episode's files."""
    return sum(facts.bytes for facts in record.files.values())


@contextmanager
def disk_trouble_told(root: Path, tally: Callable[[], Tally | None]) -> Iterator[None]:
    """Turns what the disk does not take into one line.

    Args:
        root: Folder of the dataset.
        tally: Gives how it stands; None before that is known.

    Raises:
        OutputError: the disk is full, or does not let itself be written.
    """
    try:
        yield
    except OSError as error:
        stands = tally()
        safe = f" {stands} are safe: go on with --resume." if stands is not None else ""
        if error.errno in _FULL:
            raise OutputError(f"no space is left for {root} ({error.strerror}).{safe}") from None
        what = f"{error.filename}: " if error.filename else ""
        raise OutputError(f"can't write to {root}: {what}{error.strerror or error}.{safe}") from None
