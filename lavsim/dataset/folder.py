"""The folder of a dataset that is being made: who may write there, what is left over from a kill, what is whole."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from lavsim.dataset.files import PARTIAL
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import FILES
from lavsim.errors import DatasetError, OutputError

PLAN = "meta/plan.json"
CARD = "README.md"
EPISODES = "episodes"  # its lock: the one process that collects or renders into the folder
LOGS = "logs"  # its lock is shared by that process's workers, while one of them is at work
FOLDERS = ("meta", *dict.fromkeys(Path(file).parts[0] for file in FILES.values()))
_EPISODE = re.compile(r"ep_(\d{6,})\.[a-z]+(\.partial)?")
_PATIENCE = 10.0  # [s] that workers of a killed process may take to see that it is gone


def claim(root: Path, resume: bool, overwrite: bool) -> None:
    """Makes the folder ready to be written into.

    Args:
        root: The dataset's.
        resume: Whether what is there stays.
        overwrite: Whether a dataset that is there goes, and nothing else.

    Raises:
        OutputError: it holds a dataset already, or is no folder.
    """
    if root.exists() and not root.is_dir():
        raise OutputError(f"{root} is a file; a folder is expected.")
    held = [name for name in (*FOLDERS, CARD) if (root / name).exists()]
    if held and not (resume or overwrite):
        raise OutputError(f"{root} already holds a dataset ({held[0]}); give --resume, --overwrite or another folder.")
    root.mkdir(parents=True, exist_ok=True)
    if overwrite:
        with writing(root):
            for name in held:
                shutil.rmtree(root / name) if (root / name).is_dir() else (root / name).unlink()
    for name in FOLDERS:
        (root / name).mkdir(exist_ok=True)


@contextlib.contextmanager
def writing(root: Path) -> Iterator[None]:
    """Holds the folder for this process alone; no worker of another one is at work in it any more.

    Raises:
        OutputError: another process writes there.
    """
    (root / EPISODES).mkdir(exist_ok=True)
    with _locked(root / EPISODES, fcntl.LOCK_EX, 0.0) as got:
        if not got:
            raise OutputError(f"another process writes into {root}.")
        yield


@contextlib.contextmanager
def quiet(root: Path) -> Iterator[None]:
    """Within, no worker is at work: those of a process that was killed are waited for.

    Raises:
        OutputError: they don't end.
    """
    (root / LOGS).mkdir(exist_ok=True)
    with _locked(root / LOGS, fcntl.LOCK_EX, _PATIENCE) as got:
        if not got:
            raise OutputError(f"workers of another process still write into {root}.")
        yield


@contextlib.contextmanager
def working(root: Path) -> Iterator[None]:
    """Around a worker's work on an episode."""
    with _locked(root / LOGS, fcntl.LOCK_SH, _PATIENCE) as got:
        if not got:
            raise OutputError(f"another process tidies up in {root}.")
        yield


def sweep(root: Path, records: Mapping[int, EpisodeRecord]) -> None:
    """Removes files of episodes without a record, and all that was not finished."""
    for name in FOLDERS:
        if not (root / name).is_dir():
            continue
        for path in sorted((root / name).iterdir()):
            match = _EPISODE.fullmatch(path.name)
            is_left_over = match is not None and int(match[1]) not in records
            if is_left_over or path.name.endswith(PARTIAL):
                path.unlink(missing_ok=True)


def swept_episodes(root: Path) -> dict[int, EpisodeRecord]:
    """The episodes in the folder, once what a kill left beside them is gone.

    Raises:
        OutputError: workers of another process still write.
        DatasetError: an episode is damaged.
    """
    with quiet(root):
        records = whole_episodes(root)
        sweep(root, records)
    return records


def tidy(root: Path, records: Mapping[int, EpisodeRecord]) -> None:
    """Removes what was not finished; what can't be removed now goes when the work is resumed."""
    with contextlib.suppress(OutputError), quiet(root):
        sweep(root, records)


def remove(root: Path, number: int) -> None:
    """Removes an episode, its record first."""
    for kind in ("record", *(kind for kind in FILES if kind != "record")):
        (root / FILES[kind].format(number)).unlink(missing_ok=True)


def whole_episodes(root: Path) -> dict[int, EpisodeRecord]:
    """Records of the episodes in the folder, by number.

    Raises:
        DatasetError: one is damaged, or a file that it names is missing or of another size.
    """
    found = {}
    for path in sorted((root / EPISODES).glob("ep_*.json")):
        record = EpisodeRecord.read(path)
        for name, facts in record.files.items():
            size = _size(root / name)
            if size != facts.bytes:
                is_there = "is missing" if size is None else f"has {size} bytes instead of {facts.bytes}"
                raise DatasetError(f"{name} {is_there}; delete {path.name} to have the episode collected again.")
        found[record.episode] = record
    return found


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return None


@contextlib.contextmanager
def _locked(folder: Path, kind: int, patience: float) -> Iterator[bool]:
    """Holds a lock on a folder, which leaves nothing behind, not even when its holder is killed.

    Yields:
        Whether it was got within `patience` seconds. Some network file systems have no locks; there it always is.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        yield _lock(handle, kind, patience)
    finally:
        os.close(handle)


def _lock(handle: int, kind: int, patience: float) -> bool:
    last = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(handle, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > last:
                return False
            time.sleep(0.05)
        except OSError:
            return True
        else:
            return True
