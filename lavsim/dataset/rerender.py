"""Tables and blobs for recorded drives, any sensors, without driving again: what `lavsim render` calls.

A dataset shipped as its logs alone becomes, in its own folder or another one, the dataset that would have been
collected with blobs, to the same bytes. Logs of scored drives become one too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lavsim.dataset import folder
from lavsim.dataset.card import write_card
from lavsim.dataset.collect import Collected, run_tasks, write_plan
from lavsim.dataset.files import read_sealed
from lavsim.dataset.plan import PLAN_KEY, PLAN_SCHEMA, CollectPlan
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.redrive import RenderTask, render_episode
from lavsim.dataset.schema import FILES, INFO, TICKS_PER_FRAME, DatasetInfo, RecordConfig, file_of
from lavsim.dataset.tally import OnProgress, Tally, disk_trouble_told
from lavsim.errors import DatasetError, OutputError
from lavsim.executor import make_executor
from lavsim.log.reader import LogReader
from lavsim.sensors.suites import find_suite, with_look

DEFAULT_SUITE, DEFAULT_LOOK = "lav_data", "fast"


@dataclass(frozen=True)
class _Source:
    """What is rendered.

    Attributes:
        root: Folder of the dataset; None for logs that belong to none.
        logs: By number of the episode.
        facts: Of their records.
        empty: Records of episodes that have no files.
        frames: About how many frames the logs have.
        info: What the dataset says of itself.
        plan: How it was collected, if it was: plan and digests of the towns.
    """

    root: Path | None
    logs: Mapping[int, Path]
    facts: Mapping[int, Mapping[str, Any]]
    frames: int
    empty: tuple[EpisodeRecord, ...] = ()
    info: DatasetInfo | None = None
    plan: tuple[CollectPlan, Mapping[str, str]] | None = None


def render(
    source: Path,
    out: Path | None = None,
    *,
    suite: str | None = None,
    look: str | None = None,
    labels: bool = True,
    workers: int = 1,
    cluster: str | None = None,
    resume: bool = False,
    overwrite: bool = False,
    town_path: tuple[Path, ...] = (),
    on_progress: OnProgress | None = None,
) -> Collected:
    """Makes tables and blobs for recorded drives.

    Args:
        source: A dataset, a log, or a folder of logs.
        out: Folder of the dataset that is made; None puts them into the source, a dataset of logs alone.
        suite: Name of the sensor suite; None for the dataset's own, of logs `DEFAULT_SUITE`.
        look: Of the cameras; None likewise.
        labels: Whether the agents that drove are asked again what they thought.
        workers: Processes that render side by side.
        cluster: Address of a Ray cluster that renders instead.
        resume: Goes on with what is in `out`.
        overwrite: Replaces the dataset in `out`.
        town_path: Folders with towns.
        on_progress: Told how it stands.

    Raises:
        LavsimError: a mistake in what was asked for, a log that can't be read, a full disk: what is finished stays.
    """
    found = _source(source)
    root = _target(found, source, out)
    info, plan = _described(found, suite, look)
    executor = make_executor(workers, cluster)
    tally: Tally | None = None
    with disk_trouble_told(root, lambda: tally):
        folder.claim(root, resume or root == found.root, overwrite)
        with folder.writing(root):
            _begin(root, info, plan)
            records = folder.swept_episodes(root)
            done = {number: record for number, record in records.items() if _is_rendered(record)}
            for record in found.empty:
                record.write(root)
                done[record.episode] = record
            tally = Tally(root, found.frames, done, on_progress)
            tasks = [
                RenderTask(log.resolve(), number, root.resolve(), dict(found.facts[number]), labels, town_path)
                for number, log in found.logs.items()
                if number not in done
            ]
            try:
                run_tasks(executor, render_episode, tasks, tally, until=lambda: done.keys() >= found.logs.keys())
            finally:
                folder.tidy(root, {**records, **done})
            write_card(root)
    return Collected(root, tuple(done[number] for number in sorted(done)))


def _source(path: Path) -> _Source:
    """What lies at `path`.

    Raises:
        DatasetError: nothing that can be rendered.
    """
    if (path / INFO).exists():
        return _dataset(path)
    logs = sorted(path.rglob("*.lavlog")) if path.is_dir() else [path]
    if not logs:
        raise DatasetError(f"{path} is no dataset and holds no logs (*.lavlog).")
    if not path.exists():
        raise DatasetError(f"there is no {path} to render.")
    numbered = dict(enumerate(logs))
    frames = sum(len(LogReader(log)) // TICKS_PER_FRAME for log in logs)
    return _Source(None, numbered, {number: {"log": log.stem} for number, log in numbered.items()}, frames)


def _dataset(root: Path) -> _Source:
    episodes = folder.whole_episodes(root)
    records = {number: record for number, record in episodes.items() if record.files}
    plan = None
    if (root / folder.PLAN).exists():
        content = read_sealed(root / folder.PLAN, PLAN_KEY, PLAN_SCHEMA)
        plan = CollectPlan.from_json(content["plan"]), content["town_digests"]
    return _Source(
        root=root,
        logs={number: root / file_of("log", number) for number in records},
        facts={number: record.facts for number, record in records.items()},
        frames=sum(record.frames for record in records.values()),
        empty=tuple(record for record in episodes.values() if not record.files),
        info=DatasetInfo.read(root),
        plan=plan,
    )


def _target(found: _Source, source: Path, out: Path | None) -> Path:
    """The folder that is rendered into.

    Raises:
        OutputError: it must be given and is not.
    """
    if out is not None and (found.root is None or out.resolve() != found.root.resolve()):
        return out
    if found.root is None:
        raise OutputError(f"{source} is no dataset: give --out, the folder of the one that is made.")
    return found.root


def _described(
    found: _Source, suite: str | None, look: str | None
) -> tuple[DatasetInfo, tuple[CollectPlan, Mapping[str, str]] | None]:
    """What the rendered dataset says of itself, and its plan."""
    before = found.info
    if before is None or suite is not None or look is not None:
        own = found.plan[0] if found.plan is not None else None
        suite = suite or (own.suite if own is not None else DEFAULT_SUITE)
        look = look or (own.look if own is not None else DEFAULT_LOOK)
        sensors: tuple[Mapping[str, Any], ...] = with_look(find_suite(suite), look)
    else:
        sensors = before.record.suite
    record = RecordConfig(sensors) if before is None else replace(before.record, suite=sensors, tables=True, blobs=True)
    if found.plan is None:
        return DatasetInfo.of(record, before.seed if before else 0, before.config if before else None), None
    changes = {"log_only": False, "suite": suite, "look": look}
    plan = found.plan[0].model_copy(update={k: v for k, v in changes.items() if v is not None})
    return DatasetInfo.of(record, plan.seed, plan.to_json()), (plan, found.plan[1])


def _begin(root: Path, info: DatasetInfo, plan: tuple[CollectPlan, Mapping[str, str]] | None) -> None:
    """Describes the dataset before its first episode is rendered.

    Raises:
        OutputError: what is in the folder already has other sensors.
    """
    if (root / INFO).exists():
        before = DatasetInfo.read(root)
        if before.record.blobs and before.record != info.record:
            raise OutputError(f"the dataset in {root} has blobs of other sensors already; give --out, another folder.")
    if plan is not None:
        write_plan(root, *plan)
    info.write(root)


def _is_rendered(record: EpisodeRecord) -> bool:
    """Whether an episode has all its files, or had none to begin with."""
    kinds = {file_of(kind, record.episode) for kind in FILES if kind != "record"}
    return not record.files or kinds <= set(record.files)
