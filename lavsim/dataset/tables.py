"""Tables of frames: columns of arrays, on disk as Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lavsim.dataset.files import FileFacts, write_file
from lavsim.dataset.schema import FieldSpec
from lavsim.errors import DatasetError

_TEXT = "string"


@dataclass(frozen=True)
class Column:
    """A field of all frames.

    Attributes:
        values: (F, …) a row a frame; of a field with a varying size (V, …) the rows of all frames.
        ends: (F + 1,) frame i has rows ends[i] … ends[i+1]-1 of `values`; None if the size does not vary.
    """

    values: NDArray[Any]
    ends: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.values) if self.ends is None else len(self.ends) - 1

    def row(self, frame: int) -> Any:
        """The field in one frame; a view."""
        if self.ends is None:
            return self.values[frame]
        return self.values[self.ends[frame] : self.ends[frame + 1]]


class Table:
    """The table of an episode.

    Args:
        columns: By name of the field.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        self.columns = dict(columns)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def __getitem__(self, name: str) -> NDArray[Any]:
        """All frames of a field whose size does not vary."""
        column = self.columns[name]
        if column.ends is not None:
            raise KeyError(f"{name} has another number of rows in each frame; use .columns[{name!r}]")
        return column.values

    def row(self, frame: int, names: Iterable[str] | None = None) -> dict[str, Any]:
        """The fields of one frame."""
        return {name: self.columns[name].row(frame) for name in (self.columns if names is None else names)}

    @staticmethod
    def of_rows(rows: Sequence[Mapping[str, Any]], fields: Sequence[FieldSpec]) -> Table:
        """The table of frames given one by one."""
        return Table({field.name: _column([row[field.name] for row in rows], field) for field in fields})


def write_table(path: Path, table: Table, fields: Sequence[FieldSpec], facts: Mapping[str, str]) -> FileFacts:
    """Writes a table as Parquet; `facts` are kept as key-value metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [_to_arrow(table.columns[field.name], field) for field in fields]
    schema = pa.schema([pa.field(f.name, a.type, nullable=False) for f, a in zip(fields, arrays, strict=True)])
    file = io.BytesIO()
    pq.write_table(
        pa.Table.from_arrays(arrays, schema=schema.with_metadata(dict(facts))), file, compression="zstd",
        compression_level=3, write_page_checksum=True, store_schema=True,
    )  # fmt: skip
    return write_file(path, file.getvalue())


def read_table(data: bytes, name: str, fields: Sequence[FieldSpec]) -> Table:
    """The table in the bytes of a Parquet file called `name`.

    Raises:
        DatasetError: it is no Parquet file, damaged, or lacks a field.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.read_table(io.BytesIO(data), page_checksum_verification=True, use_threads=False).combine_chunks()
    except (pa.ArrowException, OSError) as error:
        raise DatasetError(f"{name} can't be read as Parquet: {' '.join(str(error).split())}") from None
    missing = [field.name for field in fields if field.name not in found.column_names]
    if missing:
        raise DatasetError(f"{name} lacks the column {missing[0]!r}.")
    return Table({field.name: _from_arrow(_whole(found[field.name], pa), field) for field in fields})


def _column(rows: Sequence[Any], field: FieldSpec) -> Column:
    kind: Any = object if field.dtype == _TEXT else np.dtype(field.dtype)
    inner = field.inner_shape
    if not field.is_ragged:
        values = np.empty(len(rows), object) if kind is object else np.zeros((len(rows), *inner), kind)
        for number, row in enumerate(rows):
            values[number] = row
        return Column(values)
    ends = np.zeros(len(rows) + 1, np.int64)
    np.cumsum([len(row) for row in rows], out=ends[1:])
    values = np.empty((int(ends[-1]), *inner), kind)
    for number, row in enumerate(rows):
        values[ends[number] : ends[number + 1]] = row
    return Column(values, ends)


def _to_arrow(column: Column, field: FieldSpec) -> Any:
    import pyarrow as pa

    values: Any
    if field.dtype == _TEXT:
        values = pa.array(column.values.tolist(), pa.string())
    else:
        values = pa.array(np.ascontiguousarray(column.values).reshape(-1))
        for size in reversed(field.inner_shape):
            values = pa.FixedSizeListArray.from_arrays(values, size)
    if column.ends is not None:
        values = pa.ListArray.from_arrays(pa.array(column.ends, pa.int32()), values)
    return values


def _whole(chunked: Any, pa: Any) -> Any:
    return (
        chunked.chunk(0)
        if chunked.num_chunks == 1
        else pa.concat_arrays(chunked.chunks or [pa.array([], chunked.type)])
    )


def _from_arrow(array: Any, field: FieldSpec) -> Column:
    ends = None
    if field.is_ragged:
        ends = np.asarray(array.offsets, dtype=np.int64)
        array = array.values
    if field.dtype == _TEXT:
        return Column(np.array(array.to_pylist(), dtype=object), ends)
    for _ in field.inner_shape:
        array = array.values
    values = np.asarray(array).astype(field.dtype, copy=False).reshape(-1, *field.inner_shape)
    return Column(values, ends)
