"""Recorded drives: exact, cut anywhere, and refused when damaged."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lavsim.errors import LogError
from lavsim.log.codec import decode_block, encode_block
from lavsim.log.reader import LogReader
from lavsim.log.writer import LogWriter
from lavsim.types import ActorClass, Role
from lavsim.world.snapshot import CONTACT_DTYPE, HAZARD_DTYPE, ActorTable, Snapshot

ARRAYS = (
    "rows",
    "pose",
    "velocity",
    "state",
    "ego_motion",
    "control",
    "lights",
    "contacts",
    "weather_values",
    "hazards",
)


def table_of(count: int) -> ActorTable:
    return ActorTable.empty().extended(
        [
            {"id": 1 + 7 * k, "class": ActorClass.CAR, "role": Role.TRAFFIC if k else Role.EGO,
             "size": (4.5 + 0.1 * k, 1.9, 1.5), "colour": (k, 2, 3), "blueprint": f"vehicle.{k}"}
            for k in range(count)
        ]
    )  # fmt: skip


def snapshot_at(tick: int, actors: int, rng: np.random.Generator) -> Snapshot:
    rows = np.concatenate([[0], 1 + np.flatnonzero(rng.random(actors - 1) < 0.8)]).astype(np.int32)
    n = len(rows)
    contacts = np.zeros(int(rng.integers(0, 3)), CONTACT_DTYPE)
    contacts["impulse"] = rng.random(len(contacts))
    return Snapshot(
        tick=tick,
        table=table_of(actors),
        rows=rows,
        pose=rng.integers(-(2**31), 2**31 - 1, (n, 5)).astype(np.int32),
        velocity=rng.integers(-4000, 4000, (n, 3)).astype(np.int32),
        state=rng.integers(0, 2000, (n, 3)).astype(np.int32),
        ego_motion=rng.normal(size=6).astype(np.float32),
        control=rng.random(5).astype(np.float32),
        lights=rng.integers(0, 5, 9).astype(np.uint8),
        contacts=contacts,
        weather_values=rng.random(10).astype(np.float32),
        hazards=np.zeros(int(rng.integers(0, 2)), HAZARD_DTYPE),
        agent_status=int(rng.integers(0, 3)),
    )


def assert_same(first: Snapshot, second: Snapshot) -> None:
    assert (first.tick, first.agent_status) == (second.tick, second.agent_status)
    for name in ARRAYS:
        a, b = getattr(first, name), getattr(second, name)
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), name
    assert first.ids.tolist() == second.ids.tolist()


@given(seed=st.integers(0, 10_000), ticks=st.integers(1, 30), actors=st.integers(1, 12))
@settings(max_examples=40, deadline=None)
def test_a_block_gives_back_every_bit(seed: int, ticks: int, actors: int) -> None:
    rng = np.random.default_rng(seed)
    snapshots = [snapshot_at(100 + t, actors, rng) for t in range(ticks)]
    for before, after in zip(snapshots, decode_block(encode_block(snapshots), table_of(actors)), strict=True):
        assert_same(before, after)


@given(values=hnp.arrays(np.int32, (4, 11)))
@settings(max_examples=20, deadline=None)
def test_extreme_integers_survive(values: np.ndarray) -> None:
    base = snapshot_at(0, 1, np.random.default_rng(0))
    snapshots = [
        Snapshot(**{**vars_of(base), "tick": t, "pose": v[None, :5].copy(), "velocity": v[None, 5:8].copy(),
                    "state": v[None, 8:].copy()})
        for t, v in enumerate(values)
    ]  # fmt: skip
    for before, after in zip(snapshots, decode_block(encode_block(snapshots), table_of(1)), strict=True):
        assert_same(before, after)


def vars_of(snapshot: Snapshot) -> dict[str, Any]:
    return {name: getattr(snapshot, name) for name in (*ARRAYS, "tick", "table", "agent_status")}


@dataclass
class FakeSimulation:
    def header(self) -> dict[str, Any]:
        return {"town": "nowhere", "seed": 3}


class FakeResult:
    def summary(self) -> dict[str, Any]:
        return {"ending": "completed"}


def write_log(path: Path, ticks: int = 250) -> list[Snapshot]:
    rng = np.random.default_rng(1)
    snapshots = [snapshot_at(t, 5 if t < 120 else 8, rng) for t in range(ticks)]
    writer = LogWriter(path, {"look": "fast"})
    writer.start(FakeSimulation())  # type: ignore[arg-type]
    for snapshot in snapshots:
        assert writer.observe(snapshot) is None
    writer.finish(FakeResult())  # type: ignore[arg-type]
    return snapshots


def test_a_log_reads_back_what_was_seen(tmp_path: Path) -> None:
    snapshots = write_log(tmp_path / "a.lavlog")
    reader = LogReader(tmp_path / "a.lavlog")
    assert reader.header["town"] == "nowhere"
    assert reader.header["look"] == "fast"
    assert reader.status == {"ending": "completed"}
    assert len(reader) == 250
    for before, after in zip(snapshots, reader, strict=True):
        assert_same(before, after)
    assert_same(reader[137], snapshots[137])
    assert_same(reader[-1], snapshots[-1])
    with pytest.raises(IndexError, match="holds 250 ticks"):
        reader[250]


def test_two_writings_give_the_same_bytes(tmp_path: Path) -> None:
    write_log(tmp_path / "a.lavlog")
    write_log(tmp_path / "b.lavlog")
    assert (tmp_path / "a.lavlog").read_bytes() == (tmp_path / "b.lavlog").read_bytes()


def test_a_log_cut_anywhere_reads_up_to_its_last_whole_block(tmp_path: Path) -> None:
    snapshots = write_log(tmp_path / "a.lavlog")
    data = (tmp_path / "a.lavlog").read_bytes()
    lengths = set()
    for cut in range(400, len(data), 997):
        (tmp_path / "cut.lavlog").write_bytes(data[:cut])
        reader = LogReader(tmp_path / "cut.lavlog")
        assert reader.status is None
        lengths.add(len(reader))
        for before, after in zip(snapshots, reader, strict=False):
            assert_same(before, after)
    assert lengths <= {0, 100, 200, 250}
    assert 100 in lengths


def test_a_flipped_bit_is_found(tmp_path: Path) -> None:
    write_log(tmp_path / "a.lavlog")
    data = bytearray((tmp_path / "a.lavlog").read_bytes())
    data[len(data) // 2] ^= 4
    (tmp_path / "a.lavlog").write_bytes(data)
    with pytest.raises(LogError, match="damaged"):
        list(LogReader(tmp_path / "a.lavlog"))


@pytest.mark.parametrize(("content", "message"), [(b"hello world", "is no recorded drive"), (b"", "is no recorded")])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.lavlog").write_bytes(content)
    with pytest.raises(LogError, match=message):
        LogReader(tmp_path / "x.lavlog")
    with pytest.raises(LogError, match="No such file"):
        LogReader(tmp_path / "missing.lavlog")
