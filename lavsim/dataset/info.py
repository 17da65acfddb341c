"""What a dataset holds, in numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lavsim.dataset.reader import Dataset
from lavsim.dataset.record import EpisodeRecord
from lavsim.dataset.schema import FILES, SCHEMA_VERSION
from lavsim.dataset.stats import Statistics, add_up, statistics_of
from lavsim.types import DT

KINDS = {Path(name).parts[0]: kind for kind, name in FILES.items() if kind != "index"}  # by folder


@dataclass(frozen=True)
class Summary:
    """Totals of a dataset.

    Attributes:
        dataset: What they are of.
        statistics: Of its tables; None if it has none or they were not asked for.
    """

    dataset: Dataset
    statistics: Statistics | None

    @property
    def records(self) -> list[EpisodeRecord]:
        return list(self.dataset.episodes.values())

    @property
    def hours(self) -> float:
        """Driven, frames that were left out included."""
        return sum(record.ticks for record in self.records) * DT / 3600.0

    @property
    def kilometres(self) -> float:
        return sum(record.distance for record in self.records) / 1000.0

    @property
    def bytes(self) -> dict[str, int]:
        """On disk, by kind of file: log, table, shard (with its index)."""
        found: dict[str, int] = {}
        for record in self.records:
            for name, facts in record.files.items():
                kind = KINDS.get(Path(name).parts[0], "other")
                found[kind] = found.get(kind, 0) + facts.bytes
        return found

    @property
    def towns(self) -> dict[str, dict[str, float]]:
        """Episodes, frames and kilometres of each town."""
        found: dict[str, dict[str, float]] = {}
        for record in self.records:
            town = found.setdefault(record.town, {"episodes": 0, "frames": 0, "km": 0.0})
            town["episodes"] += 1
            town["frames"] += record.frames
            town["km"] += record.distance / 1000.0
        return {name: {**town, "km": round(town["km"], 3)} for name, town in sorted(found.items())}

    @property
    def has_logs(self) -> bool:
        """Whether drives can be rendered again."""
        return any(Path(name).parts[0] == "logs" for record in self.records for name in record.files)

    def to_json(self) -> dict[str, Any]:
        """All of it in JSON types."""
        info, sizes, frames = self.dataset.info, self.bytes, len(self.dataset)
        total = sum(sizes.values())
        return {
            "schema_version": SCHEMA_VERSION,
            "episodes": len(self.records),
            "frames": frames,
            "hours": round(self.hours, 4),
            "km": round(self.kilometres, 3),
            "bytes": total,
            "bytes_by_kind": sizes,
            "bytes_per_frame": round(total / frames) if frames else 0,
            "has_logs": self.has_logs,
            "has_tables": bool(info.columns),
            "has_blobs": self.dataset.has_blobs,
            "towns": self.towns,
            "weathers": _frames_by(self.records, lambda record: str(record.facts.get("weather", "unknown"))),
            "endings": _counted(record.ending for record in self.records),
            "seed": info.seed,
            "versions": dict(info.versions),
            "fields": [
                {"name": f.name, "dtype": f.dtype, "shape": list(f.shape), "unit": f.unit, "codec": f.codec}
                for f in info.fields
            ],
            "statistics": self.statistics.to_json() if self.statistics is not None else None,
        }


def summarise(dataset: Dataset, with_statistics: bool = True, watch: Callable[[float], None] | None = None) -> Summary:
    """Totals of a dataset; statistics read all its tables.

    Args:
        dataset: To look at.
        with_statistics: Whether to read tables.
        watch: Is told the share that is done.

    Raises:
        DatasetError: a table is missing or damaged.
    """
    if not (with_statistics and dataset.info.columns):
        return Summary(dataset, None)
    parts = []
    for done, record in enumerate(dataset.episodes.values()):
        if record.frames:
            parts.append(statistics_of(dataset.table(record.episode)))
        if watch is not None:
            watch((done + 1) / len(dataset.episodes))
    return Summary(dataset, add_up(parts))


def _frames_by(records: Iterable[EpisodeRecord], name: Callable[[EpisodeRecord], str]) -> dict[str, int]:
    found: dict[str, int] = {}
    for record in records:
        found[name(record)] = found.get(name(record), 0) + record.frames
    return dict(sorted(found.items()))


def _counted(names: Iterable[str]) -> dict[str, int]:
    found: dict[str, int] = {}
    for name in names:
        found[name] = found.get(name, 0) + 1
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))
