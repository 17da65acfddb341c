"""Writing is the inverse of reading."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lavsim.errors import MapError
from lavsim.map.opendrive import read_file, read_network
from lavsim.map.write import write_network
from tests import worlds
from tests.map.shared import SHARED

FILES = sorted((SHARED / "maps").glob("*/*.xodr"))


def rounded(value: object) -> object:
    """The same records with numbers to 9 digits: speeds pass through km/h."""
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, tuple):
        return tuple(rounded(v) for v in value)
    if hasattr(value, "__dataclass_fields__"):
        return replace(value, **{k: rounded(getattr(value, k)) for k in value.__dataclass_fields__})  # type: ignore[type-var]
    return value


@pytest.mark.skipif(not FILES, reason="needs the files in maps/ of LAVSIM_SHARED or ../shared")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_file_written_again_says_the_same(path: Path) -> None:
    try:
        first = read_file(path)
    except MapError:
        pytest.skip("the reader refuses it")
    again = read_network(write_network(first))
    assert [r.id for r in again.roads] == [r.id for r in first.roads]
    for before, after in zip(first.roads, again.roads, strict=True):
        flat = not any((p.a, p.b, p.c, p.d) != (0.0,) * 4 for p in (*after.elevation, *after.lane_offset))
        if flat:
            after = replace(after, elevation=before.elevation, lane_offset=before.lane_offset)
        elif not before.elevation or not before.lane_offset:
            after = replace(
                after,
                elevation=after.elevation if before.elevation else (),
                lane_offset=after.lane_offset if before.lane_offset else (),
            )
        assert rounded(after) == rounded(before)
    assert again.junctions == first.junctions
    assert again.controllers == first.controllers


def test_equal_records_give_equal_bytes() -> None:
    network = worlds.tee().network
    assert write_network(network) == write_network(replace(network))
