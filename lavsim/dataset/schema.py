"""What a dataset holds and where: the fields of a frame, the layout of the folder, and `meta/info.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from lavsim import __version__
from lavsim.dataset.files import read_sealed, write_sealed
from lavsim.errors import DatasetError

SCHEMA_VERSION = 1
TICKS_PER_FRAME = 5  # 4 Hz, as LAV's recorder (reference `lav.md` 3.2)
VERSION_KEY = "schema_version"
TABLE, BLOB = "table", "blob"


@dataclass(frozen=True)
class FieldSpec:
    """One field of a frame.

    Attributes:
        name: Column of the table, or middle part of a blob's name.
        dtype: As NumPy names it, or "string".
        shape: Sizes; a name ("actors", "ticks", "points", "lights") where a size varies, always the first.
        unit: Of the values.
        frame: Frame of reference: "world", "ego" (x ahead, y right, at the ego's origin on the ground), "lidar" …
        codec: "parquet" for columns, else a name of `lavsim.dataset.codecs.CODECS`.
        place: `TABLE` or `BLOB`.
        member: Of a blob: its name in the shard behind the frame's number, "lidar.bin"; empty for columns.
        about: What it is.
    """

    name: str
    dtype: str
    shape: tuple[int | str, ...]
    unit: str
    frame: str
    codec: str
    place: str
    member: str
    about: str

    @property
    def is_ragged(self) -> bool:
        """Whether its first size varies from frame to frame."""
        return bool(self.shape) and isinstance(self.shape[0], str)

    @property
    def inner_shape(self) -> tuple[int, ...]:
        """Sizes after the one that varies."""
        return tuple(int(size) for size in (self.shape[1:] if self.is_ragged else self.shape))


@dataclass(frozen=True)
class RecordConfig:
    """What is recorded of a drive.

    Attributes:
        suite: Sensors, as dicts.
        tables: Whether tables are written; without them a dataset is its logs.
        blobs: Whether sensors are read and kept.
        radius: Actors farther than this from the ego are left out [m].
        stand_ticks: Frames are skipped once the ego has stood that long [ticks].
        plan_spacing: Between nodes of the plan that command and goal are taken from [m].
    """

    suite: tuple[Mapping[str, Any], ...]
    tables: bool = True
    blobs: bool = True
    radius: float = 50.0
    stand_ticks: int = 500
    plan_spacing: float = 50.0


@dataclass(frozen=True)
class DatasetInfo:
    """`meta/info.json`.

    Attributes:
        record: What is recorded of each drive.
        fields: Of a frame, in order; columns first.
        seed: Root of the dataset's plan.
        config: The resolved configuration that made it, in JSON types.
        versions: Of the libraries that wrote it.
    """

    record: RecordConfig
    fields: tuple[FieldSpec, ...]
    seed: int = 0
    config: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of(record: RecordConfig, seed: int = 0, config: Mapping[str, Any] | None = None) -> DatasetInfo:
        """The description of a dataset that this version writes."""
        from lavsim.dataset.columns import table_fields
        from lavsim.dataset.rig import Rig

        rig = Rig(record.suite)
        seen = table_fields(rig.cameras, rig.has_scan) if record.blobs else table_fields()
        columns = seen if record.tables else ()
        return DatasetInfo(record, (*columns, *rig.fields), seed, dict(config or {}), _versions())

    @property
    def columns(self) -> tuple[FieldSpec, ...]:
        """Fields of the tables."""
        return tuple(item for item in self.fields if item.place == TABLE)

    @property
    def blobs(self) -> tuple[FieldSpec, ...]:
        """Fields in shards, whether they were written or not."""
        return tuple(item for item in self.fields if item.place == BLOB)

    def write(self, root: Path) -> None:
        """Writes it below the dataset's folder."""
        content = {
            VERSION_KEY: SCHEMA_VERSION,
            "ticks_per_frame": TICKS_PER_FRAME,
            "record": asdict(self.record),
            "fields": [{**asdict(item), "shape": list(item.shape), "file": _file_of(item)} for item in self.fields],
            "files": dict(FILES),
            "seed": self.seed,
            "config": dict(self.config),
            "versions": dict(self.versions),
        }
        write_sealed(root / INFO, content)

    @staticmethod
    def read(root: Path) -> DatasetInfo:
        """What a dataset says of itself.

        Raises:
            DatasetError: there is none, or it is damaged or of another version.
        """
        if not (root / INFO).exists():
            raise DatasetError(f"{root} is no dataset: it has no {INFO}.")
        content = read_sealed(root / INFO, VERSION_KEY, SCHEMA_VERSION)
        try:
            record = {item.name: content["record"][item.name] for item in fields(RecordConfig)}
            found = [{item.name: entry[item.name] for item in fields(FieldSpec)} for entry in content["fields"]]
            return DatasetInfo(
                RecordConfig(**{**record, "suite": tuple(record["suite"])}),
                tuple(FieldSpec(**{**entry, "shape": tuple(entry["shape"])}) for entry in found),
                content["seed"], content["config"], content["versions"],
            )  # fmt: skip
        except (KeyError, TypeError) as error:
            raise DatasetError(f"{Path(INFO).name} is incomplete: {error}.") from None


def _versions() -> dict[str, str]:
    from importlib.metadata import version

    libraries = ("numpy", "opencv-python-headless", "pyarrow", "zstandard", "numba")
    return {"lavsim": __version__, **{name: version(name) for name in libraries}}


INFO = "meta/info.json"
FILES: Mapping[str, str] = {
    "log": "logs/ep_{:06d}.lavlog",
    "table": "tables/ep_{:06d}.parquet",
    "shard": "blobs/ep_{:06d}.tar",
    "index": "blobs/ep_{:06d}.index",
    "record": "episodes/ep_{:06d}.json",
}


def file_of(kind: str, episode: int) -> str:
    """Path of an episode's file in the dataset's folder; kinds are those of `FILES`."""
    return FILES[kind].format(episode)


def _file_of(item: FieldSpec) -> str:
    return f"tables: column {item.name}" if item.place == TABLE else f"blobs: {{frame:06d}}.{item.member}"
