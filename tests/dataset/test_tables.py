"""Tables come back from Parquet as they were."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lavsim.dataset.schema import TABLE, FieldSpec
from lavsim.dataset.tables import Table, read_table, write_table
from lavsim.errors import DatasetError


def field(name: str, dtype: str, *shape: int | str) -> FieldSpec:
    return FieldSpec(name, dtype, shape, "", "", "parquet", TABLE, "", "")


FIELDS = (
    field("flag", "bool"), field("count", "uint8"), field("cause", "string"), field("place", "float64", 3),
    field("grid", "float32", 2, 2), field("ids", "int32", "actors"), field("names", "string", "actors"),
    field("boxes", "float32", "actors", 3),
)  # fmt: skip


def row(number: int, actors: int) -> dict[str, Any]:
    return {
        "flag": number % 2 == 0,
        "count": number % 256,
        "cause": ["none", "light", "größer"][number % 3],
        "place": np.array([number, 0.1 * number, np.nan if number % 4 == 3 else -number]),
        "grid": np.full((2, 2), number, np.float32),
        "ids": np.arange(number, number + actors),
        "names": [f"actor {k}" for k in range(actors)],
        "boxes": np.arange(3.0 * actors).reshape(actors, 3),
    }


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(0, 4), max_size=6))
def test_rows_come_back(tmp_path: Path, actors: list[int]) -> None:
    rows = [row(number, count) for number, count in enumerate(actors)]
    write_table(tmp_path / "t.parquet", Table.of_rows(rows, FIELDS), FIELDS, {"town": "t"})
    table = read_table((tmp_path / "t.parquet").read_bytes(), "t.parquet", FIELDS)
    assert len(table) == len(rows)
    for number, wanted in enumerate(rows):
        found = table.row(number)
        for item in FIELDS:
            expected = np.asarray(wanted[item.name], object if item.dtype == "string" else item.dtype)
            if item.dtype == "string":
                assert np.asarray(found[item.name], object).tolist() == expected.tolist()
            else:
                assert np.array_equal(found[item.name], expected, equal_nan=expected.dtype.kind == "f")
                assert np.asarray(found[item.name]).dtype == item.dtype


def test_a_column_of_varying_size_has_no_single_array(tmp_path: Path) -> None:
    table = Table.of_rows([row(0, 2), row(1, 1)], FIELDS)
    assert table["count"].tolist() == [0, 1]
    assert table.row(1, ["ids"])["ids"].tolist() == [1]
    with pytest.raises(KeyError, match="ids has another number of rows in each frame"):
        table["ids"]


def test_what_lacks_a_column_or_is_no_parquet_is_refused(tmp_path: Path) -> None:
    write_table(tmp_path / "t.parquet", Table.of_rows([row(0, 2)], FIELDS[1:]), FIELDS[1:], {})
    data = (tmp_path / "t.parquet").read_bytes()
    with pytest.raises(DatasetError, match=r"t\.parquet lacks the column 'flag'"):
        read_table(data, "t.parquet", FIELDS)
    with pytest.raises(DatasetError, match=r"t\.parquet can't be read as Parquet"):
        read_table(data[: len(data) // 2], "t.parquet", FIELDS)
    assert [path.name for path in tmp_path.iterdir()] == ["t.parquet"]
