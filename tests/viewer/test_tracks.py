"""A drive as columns, and columns as compressed text."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lavsim.viewer.pack import Pack, unpack
from lavsim.viewer.tracks import read_tracks
from tests.viewer import drives

NUMBERS = st.integers(-(2**28), 2**28)


def test_tracks_hold_every_pose_of_every_tick() -> None:
    tracks = drives.tracks()
    poses = {
        (int(tracks.table.ids[row]), int(tracks.start[s]) + k): tuple(tracks.pose[tracks.first[s] + k].tolist())
        for s, row in enumerate(tracks.row)
        for k in range(tracks.first[s + 1] - tracks.first[s])
    }
    snapshots = drives.snapshots()
    assert len(poses) == sum(len(s.rows) for s in snapshots)
    for index in (0, 29, 30, 79, 80, 199):
        snapshot = snapshots[index]
        for actor, pose in zip(snapshot.ids.tolist(), snapshot.pose[:, [0, 1, 3]].tolist(), strict=True):
            assert poses[actor, index] == tuple(pose)


def test_first_track_is_the_ego_s_and_covers_the_drive() -> None:
    tracks = drives.tracks()
    assert int(tracks.table.ids[tracks.row[0]]) == 1
    assert (tracks.start[0], tracks.first[1]) == (0, drives.TICKS)
    assert tracks.forward_speed == pytest.approx(6.0, abs=0.02)
    assert (tracks.tick_of[tracks.first[:-1]] == tracks.start).all()


def test_touching_counts_once_for_as_long_as_it_lasts() -> None:
    touches = drives.tracks().touches
    assert len(touches) == 1
    assert touches[0, :4].tolist() == [drives.CONTACT, 1, 1000, 900.0 + drives.CONTACT + 2]


def test_hazards_are_spans() -> None:
    assert drives.tracks().hazards.tolist() == [[0, *drives.HAZARD]]


def test_no_tick_makes_empty_tracks() -> None:
    tracks = read_tracks([])
    assert len(tracks) == 0
    assert len(tracks.touches) == 0
    assert tracks.first.tolist() == [0]


@given(
    pieces=st.lists(arrays(np.int64, st.integers(0, 12), elements=NUMBERS), max_size=6),
    order=st.integers(0, 2),
)
def test_packed_numbers_come_back(pieces: list[np.ndarray], order: int) -> None:
    values = np.concatenate([np.zeros(0, np.int64), *pieces])
    pack = Pack()
    pack.add("n", [len(piece) for piece in pieces])
    pack.add("values", values, order, "n")
    pack.add_bytes("raw", b"\x00\xff")
    meta, found = unpack(pack.encode({"title": "é<"}))
    assert meta == {"title": "é<"}
    assert np.array_equal(found["values"], values)
    assert found["raw"] == b"\x00\xff"


def test_numbers_beyond_32_bits_are_refused() -> None:
    with pytest.raises(ValueError, match="32 bits"):
        Pack().add("values", [2**33])
