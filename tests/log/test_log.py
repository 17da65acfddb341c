"""Recorded drives on disk: exact, cut anywhere, and refused when damaged."""

from pathlib import Path

import numpy as np
import pytest

from lavsim.errors import LogError
from lavsim.log.codec import BLOCK_TICKS
from lavsim.log.reader import LogReader
from lavsim.log.writer import MAGIC
from tests.log.made import assert_same, write_log

TICKS = 2 * BLOCK_TICKS + 50


def test_a_log_reads_back_what_was_seen(tmp_path: Path) -> None:
    snapshots = write_log(tmp_path / "a.lavlog", TICKS)
    reader = LogReader(tmp_path / "a.lavlog")
    assert reader.header["town"] == "nowhere"
    assert reader.header["look"] == "fast"
    assert reader.status == {"ending": "completed"}
    assert len(reader) == TICKS
    for before, after in zip(snapshots, reader, strict=True):
        assert_same(before, after)
    assert np.array_equal(reader.controls(), [s.control for s in snapshots])


def test_any_tick_is_found_in_any_order(tmp_path: Path) -> None:
    snapshots = write_log(tmp_path / "a.lavlog", TICKS)
    reader = LogReader(tmp_path / "a.lavlog")
    border = BLOCK_TICKS
    for index in (137, 0, border, border - 1, 2 * border, TICKS - 1, -1, -TICKS):
        assert_same(reader[index], snapshots[index])
        assert_same(reader.at_tick(snapshots[index].tick), snapshots[index])
    for index in (TICKS, -TICKS - 1):
        with pytest.raises(IndexError, match=f"holds {TICKS} ticks"):
            reader[index]
    for tick in (snapshots[0].tick - 1, snapshots[-1].tick + 1):
        with pytest.raises(IndexError, match=f"a.lavlog holds no tick {tick}"):
            reader.at_tick(tick)


def test_two_writings_give_the_same_bytes(tmp_path: Path) -> None:
    write_log(tmp_path / "a.lavlog")
    write_log(tmp_path / "b.lavlog")
    assert (tmp_path / "a.lavlog").read_bytes() == (tmp_path / "b.lavlog").read_bytes()


def test_a_log_cut_at_any_byte_reads_up_to_its_last_whole_block(tmp_path: Path) -> None:
    whole, cut = tmp_path / "a.lavlog", tmp_path / "cut.lavlog"
    snapshots = write_log(whole, 5, block_ticks=2)
    data = whole.read_bytes()
    lengths: list[int] = []
    for end in range(len(data)):
        cut.write_bytes(data[:end])
        reader = open_or_none(cut)
        if reader is None:
            assert not lengths, "a longer piece can't be opened"
            continue
        assert reader.status is None
        if [len(reader)] != lengths[-1:]:
            for before, after in zip(snapshots, reader, strict=False):
                assert_same(before, after)
        lengths.append(len(reader))
    assert sorted(set(lengths)) == [0, 2, 4, 5]
    assert lengths == sorted(lengths)


def open_or_none(path: Path) -> LogReader | None:
    """The log, or None where it is cut before the end of its header and says so."""
    short = path.stat().st_size <= len(MAGIC)
    try:
        return LogReader(path)
    except LogError as error:
        problem = str(error)
    assert problem.startswith(
        "cut.lavlog is no recorded drive" if short else "cut.lavlog is cut before the end of its "
    )
    return None


@pytest.mark.slow
def test_a_longer_log_cut_at_random_bytes_reads_up_to_its_last_whole_block(tmp_path: Path) -> None:
    whole, cut = tmp_path / "a.lavlog", tmp_path / "cut.lavlog"
    snapshots = write_log(whole, 3000)
    data = whole.read_bytes()
    lengths = {}
    for end in np.random.default_rng(0).integers(1000, len(data), 200):
        cut.write_bytes(data[:end])
        reader = LogReader(cut)
        lengths[int(end)] = len(reader)
        for index in {0, len(reader) // 2, len(reader) - 1} if len(reader) else ():
            assert_same(reader[index], snapshots[index])
    assert all(length % BLOCK_TICKS == 0 for length in lengths.values())
    assert [lengths[end] for end in sorted(lengths)] == sorted(lengths.values())


def test_a_flipped_bit_is_found_wherever_it_is(tmp_path: Path) -> None:
    """Most are found when the log is opened; those in blocks of ticks when the block is read, others stay readable."""
    whole, bad = tmp_path / "a.lavlog", tmp_path / "bad.lavlog"
    snapshots = write_log(whole, 5, block_ticks=2)
    data = whole.read_bytes()
    for at in range(0, len(data), 3):
        flipped = bytearray(data)
        flipped[at] ^= 1 << at % 8
        bad.write_bytes(flipped)
        with pytest.raises(LogError, match=r"^bad\.lavlog") as caught:
            list(LogReader(bad))
        if at > len(MAGIC):
            assert "damaged (checksum differs)" in str(caught.value)
        if "the block at tick 2 is" in str(caught.value):
            reader = LogReader(bad)
            assert_same(reader[1], snapshots[1])
            assert_same(reader[4], snapshots[4])


def test_a_log_of_a_later_format_is_refused_by_name(tmp_path: Path) -> None:
    write_log(tmp_path / "a.lavlog", 3)
    data = bytearray((tmp_path / "a.lavlog").read_bytes())
    data[len(MAGIC)] += 1
    (tmp_path / "a.lavlog").write_bytes(data)
    with pytest.raises(LogError, match=r"^a\.lavlog has log format 3; this version of lavsim reads 2\.$"):
        LogReader(tmp_path / "a.lavlog")


@pytest.mark.parametrize(("content", "message"), [(b"hello world", "is no recorded drive"), (b"", "is no recorded")])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.lavlog").write_bytes(content)
    with pytest.raises(LogError, match=message):
        LogReader(tmp_path / "x.lavlog")
    with pytest.raises(LogError, match="No such file"):
        LogReader(tmp_path / "missing.lavlog")
