"""Looks for damage in a dataset, and for episodes that are missing, doubled, or not what their logs say."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.files import PARTIAL, read_sealed
from lavsim.dataset.folder import PLAN
from lavsim.dataset.frames import Keeper
from lavsim.dataset.handover import first_of
from lavsim.dataset.plan import PLAN_KEY, PLAN_SCHEMA, CollectPlan
from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.redrive import drives_alike
from lavsim.dataset.schema import FILES, INFO, TICKS_PER_FRAME, DatasetInfo, FieldSpec, file_of
from lavsim.dataset.tables import Table
from lavsim.errors import DatasetError, LavsimError
from lavsim.log.reader import LogReader
from lavsim.world.snapshot import Snapshot

_SOME = 8  # frames of an episode whose blobs are decoded unless all are wanted


@dataclass(frozen=True)
class Finding:
    """Something wrong.

    Attributes:
        file: In which file of the dataset; empty if in none.
        problem: What, in one sentence.
    """

    file: str
    problem: str

    def __str__(self) -> str:
        return f"{self.file}: {self.problem}" if self.file else self.problem


Progress = Callable[[int, int], None]  # of (episodes checked, of how many)


def check(
    root: Path,
    all_blobs: bool = False,
    town_path: Sequence[Path] = (),
    progress: Progress | None = None,
    agents: bool = False,
) -> list[Finding]:
    """Everything that is wrong with a dataset, nothing if it is well.

    Every file's checksum; records against file names and plan; tables against logs, tick by tick; the blobs of some
    frames of each episode decoded, or of all; files that no record names.

    Args:
        root: The dataset's folder.
        all_blobs: Decodes all blobs.
        town_path: Folders with towns, for the plan.
        progress: Told after each episode.
        agents: Asks the agents that drove again, over their logs: their controls must be the recorded ones.
    """
    try:
        info = DatasetInfo.read(root)
    except DatasetError as error:
        return [Finding(INFO, str(error))]
    findings, records = _records(root)
    findings += _series(records)
    findings += _against_plan(root, records, town_path)
    findings += _strangers(root, records)
    refused = any(finding.file.startswith("episodes/") for finding in findings)
    data = None if refused else Dataset(root, town_path)
    for done, record in enumerate(records):
        found = _episode(root, info, record, data, all_blobs)
        log = root / file_of("log", record.episode)
        if agents and not found and log.exists():
            found += _agent(log, town_path)
        findings += found
        if progress is not None:
            progress(done + 1, len(records))
    return findings


def _records(root: Path) -> tuple[list[Finding], list[EpisodeRecord]]:
    findings, records = [], []
    for path in sorted((root / "episodes").glob("ep_*.json")):
        name = f"episodes/{path.name}"
        try:
            record = EpisodeRecord.read(path)
        except DatasetError as error:
            findings.append(Finding(name, str(error)))
            continue
        if file_of("record", record.episode) != name:
            findings.append(Finding(name, f"it is the record of episode {record.episode}."))
        records.append(record)
    return findings, records


def _series(records: Sequence[EpisodeRecord]) -> Iterator[Finding]:
    """Gaps between the first and the last episode, and drives that are there twice."""
    numbers = {record.episode for record in records}
    missing = sorted(set(range(max(numbers, default=-1) + 1)) - numbers)
    if missing:
        listed = ", ".join(map(str, missing[:10])) + (", …" if len(missing) > 10 else "")
        yield Finding("", f"episodes are missing: {listed}.")
    seen: dict[str, int] = {}
    for record in records:
        log = record.files.get(file_of("log", record.episode))
        if log is not None:
            first = seen.setdefault(log.sha256, record.episode)
            if first != record.episode:
                yield Finding(file_of("log", record.episode), f"it is the drive of episode {first} once more.")


def _against_plan(root: Path, records: Sequence[EpisodeRecord], town_path: Sequence[Path]) -> Iterator[Finding]:
    """Whether the episodes are the plan's, and no more than it takes."""
    if not (root / PLAN).exists():
        return
    try:
        plan = CollectPlan.from_json(read_sealed(root / PLAN, PLAN_KEY, PLAN_SCHEMA)["plan"])
        before, total = (sum(record.frames for record in part) for part in (records[:-1], records))
        if before >= plan.frames:
            yield Finding("", f"{before} frames are there before the last episode; the plan ends at {plan.frames}.")
        if total < plan.frames:
            yield Finding("", f"{total} of the plan's {plan.frames} frames are there: it is not finished.")
        for record in records:
            spec = plan.episode(record.episode, tuple(town_path)).spec
            if (record.town, record.route_id, record.seed) != (spec.town, spec.route_id, spec.seed):
                yield Finding(file_of("record", record.episode), "it is not the episode that the plan has there.")
    except LavsimError as error:
        yield Finding(PLAN, str(error))


def _strangers(root: Path, records: Sequence[EpisodeRecord]) -> Iterator[Finding]:
    """Files in the folders of episodes that no record names: left over from a kill, or put there by somebody."""
    known = {name for record in records for name in record.files}
    recorded = {path.stem for path in (root / "episodes").glob("ep_*.json")}  # damaged records too
    for folder in sorted({Path(pattern).parts[0] for pattern in FILES.values()} - {"episodes"}):
        for path in sorted((root / folder).glob("ep_*")):
            name = f"{folder}/{path.name}"
            if name not in known and (path.suffix == PARTIAL or path.stem not in recorded):
                yield Finding(name, "no record names it: left over from an episode that was not finished.")
    for path in sorted((root / "episodes").glob("*.partial")):
        yield Finding(f"episodes/{path.name}", "left over from an episode that was not finished.")


def _episode(
    root: Path, info: DatasetInfo, record: EpisodeRecord, data: Dataset | None, all_blobs: bool
) -> list[Finding]:
    findings = []
    for name, facts in record.files.items():
        problem = facts.problem(root / name)
        if problem is not None:
            findings.append(Finding(name, problem))
    if findings or data is None or not record.files:
        return findings
    try:
        if file_of("log", record.episode) in record.files:  # what was imported has none
            findings += _against_log(root, info, record, data)
        elif info.record.tables and len(data.table(record.episode)) != record.frames:
            findings.append(Finding(file_of("table", record.episode), f"it has not {record.frames} frames."))
        if info.record.blobs:
            findings += _blobs(info, record, data, all_blobs)
    except LavsimError as error:
        findings.append(Finding("", f"episode {record.episode}: {error}"))
    return findings


def _against_log(root: Path, info: DatasetInfo, record: EpisodeRecord, data: Dataset) -> Iterator[Finding]:
    """Whether record and table tell what the log does."""
    name = file_of("log", record.episode)
    log = LogReader(root / name)
    told = (log.header["town"], log.header["route_id"], log.header["seed"], len(log))
    if told != (record.town, record.route_id, record.seed, record.ticks):
        yield Finding(name, f"the log tells of {told}, the record of another drive or another number of ticks.")
        return
    if log.status is None:
        yield Finding(name, "the log is cut before its end.")
    table = data.table(record.episode) if info.record.tables else None
    keeper, kept = Keeper(info.record.stand_ticks, first_of(log.header)), []
    for snapshot in log:
        if not keeper.keeps(snapshot):
            continue
        kept.append(snapshot.tick)
        if table is not None and len(kept) <= len(table):
            wrong = _difference(table, len(kept) - 1, snapshot, info.record.radius)
            if wrong is not None:
                where = file_of("table", record.episode)
                yield Finding(where, f"frame {len(kept) - 1}, tick {snapshot.tick}: {wrong} is not that of the log.")
                return
    if len(kept) != record.frames or (table is not None and table["tick"].tolist() != kept):
        yield Finding(name, f"the log has {len(kept)} frames; record or table has others.")
    gaps = tuple(int(k) + 1 for k in np.flatnonzero(np.diff(kept) != TICKS_PER_FRAME))
    if gaps != record.breaks:
        yield Finding(file_of("record", record.episode), "its jumps in time are not those of the log.")


def _difference(table: Table, frame: int, snapshot: Snapshot, radius: float) -> str | None:
    """Which column differs from the log; None if none does."""
    offset = snapshot.xy - snapshot.xy[0]
    near = np.sum(offset * offset, axis=1) <= radius * radius
    expected = {
        "tick": snapshot.tick,
        "position": snapshot.xyz[0],
        "yaw": snapshot.yaw[0],
        "velocity": snapshot.velocities[0],
        "control": snapshot.control,
        "lights": snapshot.lights,
        "weather": snapshot.weather_values,
        "actor_id": snapshot.ids[near],
        "actor_position": snapshot.xyz[near],
        "actor_yaw": snapshot.yaw[near],
    }
    row = table.row(frame, expected)
    return next((name for name, value in expected.items() if not np.array_equal(row[name], value)), None)


def _agent(log: Path, town_path: Sequence[Path]) -> Iterator[Finding]:
    """Whether the agent that a log names drives as it did."""
    try:
        wrong = drives_alike(log, tuple(town_path))
    except LavsimError as error:
        wrong = str(error)
    if wrong is not None:
        yield Finding(f"logs/{log.name}", wrong)


def _blobs(info: DatasetInfo, record: EpisodeRecord, data: Dataset, all_blobs: bool) -> Iterator[Finding]:
    frames = np.arange(record.frames)
    if not all_blobs and record.frames > _SOME:
        frames = np.unique(np.linspace(0, record.frames - 1, _SOME).astype(np.int64))
    for frame in frames.tolist():
        values = data.read(record.episode, frame, [item.name for item in info.blobs])
        for item in info.blobs:
            wrong = mismatch(values[item.name], item)
            if wrong is not None:
                yield Finding(file_of("shard", record.episode), f"{frame:06d}.{item.member}: {wrong}.")
                return


def mismatch(value: NDArray[Any], item: FieldSpec) -> str | None:
    """Why an array is not of a field's kind; None if it is."""
    if item.dtype not in ("string", "record") and value.dtype != np.dtype(item.dtype):
        return f"its type is {value.dtype}, not {item.dtype}"
    fits = value.ndim == len(item.shape) and all(
        isinstance(want, str) or want == got for want, got in zip(item.shape, value.shape, strict=True)
    )
    return None if fits else f"its shape is {value.shape}, not {item.shape}"
