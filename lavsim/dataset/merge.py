"""Puts episodes of datasets into new ones: merging, and the part that splitting shares with it.

Files are linked where the disk can (they are never written again) and copied where it can't. A new dataset is made
under another name and renamed when it is whole, so a kill leaves at most a folder `*.partial`, which the next try
clears.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from lavsim.dataset.card import write_card
from lavsim.dataset.files import PARTIAL, FileFacts, size_problem, sync_folder
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import FILES, DatasetInfo, file_of
from lavsim.errors import DatasetError, OutputError

_NO_LINK = (errno.EXDEV, errno.EPERM, errno.EMLINK, errno.ENOTSUP, errno.EACCES)

Watch = Callable[[float], None]


@dataclass(frozen=True)
class Taken:
    """An episode that goes into a new dataset: whose it is, its record, and what the new record adds to its facts."""

    dataset: Dataset
    record: EpisodeRecord
    facts: Mapping[str, Any]


def merge(sources: Sequence[Path], out: Path, copy: bool = False, watch: Watch | None = None) -> Dataset:
    """One dataset with the episodes of all sources, in their order and numbered anew.

    Episodes without a frame are left out.

    Args:
        sources: Folders of datasets of one schema, suite and set of fields.
        out: Folder to make.
        copy: Copies files that could be linked.
        watch: Is told the share that is done.

    Raises:
        DatasetError: sources don't fit together, share an episode, or lack a file.
        OutputError: `out` exists or can't be written.
    """
    datasets = [Dataset(path) for path in sources]
    for path, dataset in zip(sources[1:], datasets[1:], strict=True):
        problem = _difference(datasets[0].info, dataset.info)
        if problem is not None:
            raise DatasetError(f"{path} can't be merged with {sources[0]}: {problem}.")
    episodes = [
        Taken(dataset, record, {"merged_from": {"source": number, "episode": record.episode}})
        for number, dataset in enumerate(datasets)
        for record in dataset.episodes.values()
        if record.frames or record.ticks
    ]
    _refuse_twins(episodes, sources, datasets)
    with new_folder(out) as root:
        put(root, _merged_info(datasets), episodes, copy, watch)
    return Dataset(out)


def put(root: Path, info: DatasetInfo, episodes: Sequence[Taken], copy: bool, watch: Watch | None = None) -> None:
    """Makes the dataset `root` of these episodes, numbered from 0, with a card."""
    for kind in FILES:
        (root / file_of(kind, 0)).parent.mkdir(parents=True, exist_ok=True)
    info.write(root)
    for number, taken in enumerate(episodes):
        record = taken.record
        files: dict[str, FileFacts] = {}
        for kind in FILES:
            name, facts = file_of(kind, record.episode), record.files.get(file_of(kind, record.episode))
            if facts is not None:
                problem = size_problem(taken.dataset.root / name, facts.bytes)
                if problem is not None:
                    raise DatasetError(f"{taken.dataset.root.name}: {problem}")
                files[file_of(kind, number)] = facts
                _bring(taken.dataset.root / name, root / file_of(kind, number), copy)
        replace(record, episode=number, files=files, facts={**record.facts, **taken.facts}).write(root)
        if watch is not None:
            watch((number + 1) / len(episodes))
    write_card(root)


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder under another name, which gets the name `out` once all is well, and goes when it is not.

    Raises:
        OutputError: `out` exists, or can't be written.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise OutputError(f"{out} exists already; give another folder.")
    partial = out.with_name(out.name + PARTIAL)
    shutil.rmtree(partial, ignore_errors=True)
    try:
        partial.mkdir(parents=True)
        yield partial
        partial.replace(out)  # also over an empty folder
        sync_folder(out.parent)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise OutputError(f"can't write {out}: {error.strerror or error}.") from None
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def _bring(source: Path, target: Path, copy: bool) -> None:
    if not copy:
        try:
            os.link(source, target)
            return
        except OSError as error:
            if error.errno not in _NO_LINK:
                raise
    shutil.copyfile(source, target)
    with target.open("rb") as file:
        os.fsync(file.fileno())


def _difference(one: DatasetInfo, other: DatasetInfo) -> str | None:
    """In what two datasets differ that must be one; None if in nothing."""
    for name, value in asdict(one.record).items():
        if value != (got := asdict(other.record)[name]):
            if name == "suite":
                return f"the sensor suite differs ({_first_difference(value, got)})"
            return f"{name} is {got!r} instead of {value!r}"
    fields, others = {f.name: f for f in one.fields}, {f.name: f for f in other.fields}
    for name in [*fields, *others]:
        if fields.get(name) != others.get(name):
            missing = name not in others or name not in fields
            return f"field {name!r} {'is in one of them only' if missing else 'differs'}"
    return None


def _first_difference(one: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]]) -> str:
    by_id, others = {v["id"]: v for v in one}, {v["id"]: v for v in other}
    for name in [*by_id, *others]:
        if name not in by_id or name not in others:
            return f"sensor {name!r} is in one of them only"
        if by_id[name] != others[name]:
            return f"sensor {name!r}"
    return "their order"


def _refuse_twins(episodes: Sequence[Taken], sources: Sequence[Path], datasets: Sequence[Dataset]) -> None:
    """Refuses the same drive twice: samples of it in two parts of a later split would tell nothing."""
    path_of = {id(dataset): path for dataset, path in zip(datasets, sources, strict=True)}
    seen: dict[str, str] = {}
    for taken in episodes:
        key, name = identity(taken.record), f"episode {taken.record.episode} of {path_of[id(taken.dataset)]}"
        if key in seen:
            raise DatasetError(f"{name} is the same drive as {seen[key]}.")
        seen[key] = name


def identity(record: EpisodeRecord) -> str:
    """What makes an episode the drive that it is: the digest of its log, or of its table where it has no log."""
    for kind in ("log", "table"):
        facts = record.files.get(file_of(kind, record.episode))
        if facts is not None:
            return facts.sha256
    return f"{record.town} {record.route_id} {record.seed}"


def _merged_info(datasets: Sequence[Dataset]) -> DatasetInfo:
    first, seeds = datasets[0].info, {dataset.info.seed for dataset in datasets}
    parts = [
        {
            "seed": dataset.info.seed,
            "episodes": len(dataset.episodes),
            "frames": len(dataset),
            "versions": dict(dataset.info.versions),
            "config": dict(dataset.info.config),
        }
        for dataset in datasets
    ]
    return replace(first, seed=seeds.pop() if len(seeds) == 1 else 0, config={"merged": parts})
