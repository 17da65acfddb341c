"""Collects a dataset: what `lavsim collect` calls.

The dataset is the shortest run of the plan's episodes 0, 1, 2 … that keeps as many frames as were asked for. Episodes
are driven in any order by any number of workers; one that is finished stays, one that was cut off by a kill is driven
again, and what lies beyond the last one needed goes at the end. So the bytes depend on the plan alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.agent_source import find_agent
from lavsim.dataset import folder
from lavsim.dataset.card import write_card
from lavsim.dataset.drive import EpisodeTask, collect_episode, info_of
from lavsim.dataset.files import read_sealed, write_sealed
from lavsim.dataset.plan import PLAN_KEY, PLAN_SCHEMA, CollectPlan
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import INFO, DatasetInfo
from lavsim.dataset.tally import OnProgress, Tally, bytes_of, disk_trouble_told
from lavsim.errors import OutputError
from lavsim.executor import Executor, make_executor

_EMPTY_IN_A_ROW = 100  # episodes without a frame after which something must be wrong
_MAY_CHANGE = ("frames",)  # of a plan when its dataset is gone on with: more of the same


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
    tally: Tally | None = None
    with disk_trouble_told(root, lambda: tally):
        folder.claim(root, resume, overwrite)
        with folder.writing(root):
            _begin(root, plan, digests, info)
            records = folder.swept_episodes(root)
            tally = Tally(root, plan.frames, records, on_progress)
            missing = (number for number in itertools.count() if number not in records)
            tasks = (EpisodeTask(plan, number, root.resolve(), town_path) for number in missing)
            try:
                run_tasks(executor, collect_episode, tasks, tally, until=lambda: _length(plan, records) is not None)
                _cut(root, plan, records)
            finally:
                folder.tidy(root, records)
            write_card(root)
    return Collected(root, tuple(records[number] for number in sorted(records)))


def run_tasks(
    executor: Executor,
    work: Callable[[Any, Any], EpisodeRecord],
    tasks: Iterable[Any],
    tally: Tally,
    until: Callable[[], bool],
) -> None:
    """Makes episodes until there are enough of them; all workers have ended then.

    Args:
        executor: Where.
        work: Makes one.
        tasks: What to make, each with a `number`; may be without an end.
        tally: Takes them in.
        until: Whether there are enough.

    Raises:
        OutputError: an episode was lost, or none keeps a frame.
    """
    runs: Any = executor.run(work, tasks, tally.report)
    with closing(runs):
        while not until():
            done = next(runs)
            if done.result is None:
                raise OutputError(
                    f"episode {done.task.number} was lost: {done.lost}. {tally} are safe: go on with --resume."
                )
            tally.enter(done.result)
            _check_that_frames_are_kept(tally)


def _check_that_frames_are_kept(tally: Tally) -> None:
    last = [tally.records[number] for number in sorted(tally.records)[-_EMPTY_IN_A_ROW:]]
    if len(last) == _EMPTY_IN_A_ROW and not any(record.frames for record in last):
        raise OutputError(f"{_EMPTY_IN_A_ROW} episodes in a row kept no frame; the last: {last[-1].ending}.")


def _length(plan: CollectPlan, records: Mapping[int, EpisodeRecord]) -> int | None:
    """How many episodes from the first on have the frames wanted; None if not all of them are there."""
    frames = 0
    for number in itertools.count():
        if number not in records:
            return None
        frames += records[number].frames
        if frames >= plan.frames:
            return number + 1
    return None


def _cut(root: Path, plan: CollectPlan, records: dict[int, EpisodeRecord]) -> None:
    """Removes the episodes beyond the last one needed."""
    length = _length(plan, records)
    for number in [number for number in records if length is not None and number >= length]:
        folder.remove(root, number)
        del records[number]


def _begin(root: Path, plan: CollectPlan, digests: Mapping[str, str], info: DatasetInfo) -> None:
    """Writes plan and description, or finds that those there are of the same dataset.

    Raises:
        OutputError: they are of another one; the message names the first field that differs.
        DatasetError: they are damaged, or of another version.
    """
    if (root / folder.PLAN).exists():
        begun = read_sealed(root / folder.PLAN, PLAN_KEY, PLAN_SCHEMA)
        _check_same(root, begun["plan"], plan.to_json(), "")
        _check_same(root, begun["town_digests"], dict(digests), "town ")
    elif (root / INFO).exists():
        raise OutputError(
            f"the dataset in {root} was not collected (it has no {folder.PLAN}): it can't be gone on with."
        )
    if (root / INFO).exists():
        versions = DatasetInfo.read(root).versions
        _check_same(root, {"lavsim": versions.get("lavsim")}, {"lavsim": info.versions["lavsim"]}, "")
    write_plan(root, plan, digests)
    info.write(root)


def write_plan(root: Path, plan: CollectPlan, digests: Mapping[str, str]) -> None:
    """Writes `meta/plan.json`: the plan, and digests of the towns by name."""
    content = {PLAN_KEY: PLAN_SCHEMA, "plan": plan.to_json(), "town_digests": dict(digests)}
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
