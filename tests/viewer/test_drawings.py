"""What agents may show, and the side file it goes to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.drawings import boxes, checked, checked_all, points, polylines, raster, scalar
from lavsim.errors import ConfigError, LogError
from lavsim.log.drawings import DrawingsWriter, read_drawings
from lavsim.viewer.inner import InnerView, in_world
from lavsim.viewer.pack import Pack, unpack
from tests.viewer import drives


def some() -> dict[str, Any]:
    return {
        "plan": polylines([[(0.0, 0.0), (5.0, 0.0), (10.0, 0.01)], [(1.0, 1.0)]], likelihood=[1.0, 0.5]),
        "seen": boxes([(10.0, 2.0, 0.1, 4.5, 2.0)], labels=["car"], frame="ego"),
        "dots": points([(1.0, 2.0)], frame="ego"),
        "heat": raster(np.eye(4), pose=(8.0, 0.0, 0.0), resolution=0.5),
        "speed": scalar(3.5, "m/s"),
    }


def write(path: Path, ticks: int = 100) -> None:
    current: dict[str, Any] = {}
    writer = DrawingsWriter(path, lambda: current)
    writer.start(None)  # type: ignore[arg-type]
    for index, snapshot in enumerate(drives.snapshots()[:ticks]):
        current = {} if index == 3 else {**some(), "speed": scalar(index)}
        assert writer.observe(snapshot) is None
    writer.finish(None)  # type: ignore[arg-type]


def same(a: Any, b: Any) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(np.asarray(a[k]), np.asarray(b[k])) for k in a)


def test_side_file_gives_back_what_was_shown(tmp_path: Path) -> None:
    write(tmp_path / "a.lavdraw")
    found = dict(read_drawings(tmp_path / "a.lavdraw"))
    assert sorted(found) == [drives.FIRST + k for k in range(100) if k != 3]
    expected = {**some(), "speed": scalar(99)}
    for name, drawing in found[drives.FIRST + 99].items():
        assert same(drawing, expected[name]), name


def test_side_file_is_the_same_bytes_again_and_readable_when_cut(tmp_path: Path) -> None:
    write(tmp_path / "a.lavdraw")
    write(tmp_path / "b.lavdraw")
    content = (tmp_path / "a.lavdraw").read_bytes()
    assert content == (tmp_path / "b.lavdraw").read_bytes()
    (tmp_path / "cut.lavdraw").write_bytes(content[: len(content) * 2 // 3])
    assert 0 < len(list(read_drawings(tmp_path / "cut.lavdraw"))) < 99
    (tmp_path / "bad.lavdraw").write_bytes(content[:40] + b"\x00\x01" + content[42:])
    with pytest.raises(LogError, match="damaged"):
        list(read_drawings(tmp_path / "bad.lavdraw"))
    (tmp_path / "other.lavdraw").write_bytes(b"LAVLOG")
    with pytest.raises(LogError, match="holds no drawings"):
        list(read_drawings(tmp_path / "other.lavdraw"))


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (["plan"], "dict of drawings by name"),
        ({"plan": 3}, "'plan': a drawing's kind"),
        ({"plan": {"kind": "cloud"}}, "one of points, boxes"),
        ({"plan": {"kind": "points"}}, "no 'xy'"),
        ({"plan": {"kind": "points", "xy": [[0.0, np.nan]]}}, "not finite"),
        ({"plan": {"kind": "points", "xy": [["a", "b"]]}}, "must hold numbers"),
        ({"plan": {"kind": "points", "xy": [[0.0, 1.0, 2.0]]}}, r"\(N, 2\)"),
        ({"plan": {"kind": "points", "xy": np.zeros((30_000, 2))}}, "at most 20000"),
        ({"plan": {"kind": "points", "xy": [[0.0, 1.0]], "frame": "mars"}}, "'world' or 'ego'"),
        ({"plan": {"kind": "points", "xy": [[0.0, 1.0]], "likelihood": [1.0, 1.0]}}, "1 shapes have 2"),
        ({"plan": {"kind": "polylines", "xy": [[0.0, 1.0]], "count": [2]}}, "add up to 1"),
        ({"plan": {"kind": "boxes", "poses": np.zeros((1, 5)), "labels": ["a", "b"]}}, "2 labels"),
        ({"plan": {"kind": "raster", "values": np.zeros((600, 600)), "pose": (0, 0, 0), "resolution": 1}}, "cells"),
        ({"plan": {"kind": "raster", "values": np.zeros((2, 2)), "pose": (0, 0, 0), "resolution": 0}}, "positive"),
        ({"plan": {"kind": "scalar", "value": "fast"}}, "must hold numbers"),
        ({str(k): {"kind": "scalar", "value": 0} for k in range(40)}, "at most 32"),
    ],
)
def test_what_is_no_drawing_is_refused_in_words(value: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        checked_all(value)


def test_checking_twice_changes_nothing() -> None:
    for drawing in some().values():
        assert same(checked(drawing), drawing)


def test_ego_frame_is_placed_by_the_ego_s_pose() -> None:
    tracks = drives.tracks()
    moved = in_world(some()["seen"], tracks, 50)
    ego = drives.snapshots()[50].ego
    ahead, right = np.array([np.cos(ego.yaw), np.sin(ego.yaw)]), np.array([-np.sin(ego.yaw), np.cos(ego.yaw)])
    assert moved["poses"][0, :2] == pytest.approx(ego.xy + 10.0 * ahead + 2.0 * right)
    assert moved["poses"][0, 2] == pytest.approx(ego.yaw + 0.1)


def test_page_gets_a_few_drawings_a_second(tmp_path: Path) -> None:
    write(tmp_path / "a.lavdraw")
    inner = InnerView.read(tmp_path / "a.lavdraw")
    assert inner is not None
    pack = Pack()
    entries = inner.add(pack, drives.tracks())
    meta, found = unpack(pack.encode({"drawings": entries}))
    assert [e["name"] for e in meta["drawings"]] == ["plan", "seen", "dots", "heat", "speed"]
    assert len(found["inner.0.at"]) == 25
    assert found["inner.0.count"][:2].tolist() == [2, 1]  # the middle point lies on the line
    assert found["inner.3.data"][:4] == bytes([255, 0, 0, 0])
    assert InnerView.read(tmp_path / "none.lavdraw") is None
