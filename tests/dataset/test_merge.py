"""Datasets put together and taken apart."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from lavsim.dataset import merge as merging
from lavsim.dataset.merge import identity, merge
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import file_of
from lavsim.dataset.split import by_number, by_share, by_town, split
from lavsim.errors import DatasetError, OutputError, UnknownName
from tests.dataset.made import SUITE, info_of, write_dataset, write_episode


def digests(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


@pytest.fixture
def two(tmp_path: Path) -> list[Path]:
    write_dataset(tmp_path / "a", (4, 3), first_seed=0)
    write_dataset(tmp_path / "b", (2, 5, 1), first_seed=10)
    return [tmp_path / "a", tmp_path / "b"]


@pytest.mark.parametrize("copy", [False, True])
def test_merged_episodes_are_numbered_anew_and_read_as_before(tmp_path: Path, two: list[Path], copy: bool) -> None:
    merged = merge(two, tmp_path / "m", copy)
    assert [record.frames for record in merged.episodes.values()] == [4, 3, 2, 5, 1]
    assert list(merged.episodes) == [0, 1, 2, 3, 4]
    for number, (source, episode) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1), (1, 2)]):
        before, now = Dataset(two[source]), merged.episodes[number]
        assert now.facts["merged_from"] == {"source": source, "episode": episode}
        assert identity(now) == identity(before.episodes[episode])
        for kind in ("log", "table", "shard", "index"):
            old, new = two[source] / file_of(kind, episode), tmp_path / "m" / file_of(kind, number)
            assert old.read_bytes() == new.read_bytes()
            assert os.path.samefile(old, new) is not copy
        for name, value in before.read(episode, now.frames - 1).items():
            np.testing.assert_array_equal(merged.read(number, now.frames - 1)[name], value, name)
    assert "15" in (tmp_path / "m" / "README.md").read_text()
    assert not (tmp_path / "m.partial").exists()


def test_the_same_merge_gives_the_same_bytes(tmp_path: Path, two: list[Path]) -> None:
    merge(two, tmp_path / "m")
    merge(two, tmp_path / "n", copy=True)
    assert digests(tmp_path / "m") == digests(tmp_path / "n")


def test_the_same_drive_twice_is_refused(tmp_path: Path, two: list[Path]) -> None:
    with pytest.raises(DatasetError, match=r"episode 0 of .*a is the same drive as episode 0 of .*a\."):
        merge([two[0], two[1], two[0]], tmp_path / "m")
    assert not (tmp_path / "m").exists()


def test_what_does_not_fit_is_refused_in_one_line(tmp_path: Path) -> None:
    write_dataset(tmp_path / "a")
    write_dataset(tmp_path / "b", first_seed=5, suite=SUITE[:3])
    write_dataset(tmp_path / "c", first_seed=5, suite=({**SUITE[0], "yaw": 10.0}, *SUITE[1:]))
    write_dataset(tmp_path / "d", first_seed=5, blobs=False)
    for other, why in (("b", "sensor 'BEV' is in one of them only"), ("c", "sensor 'RGB_0'"), ("d", "blobs is False")):
        with pytest.raises(DatasetError, match=why) as raised:
            merge([tmp_path / "a", tmp_path / other], tmp_path / "m")
        assert "\n" not in str(raised.value)
    with pytest.raises(DatasetError, match="is no dataset"):
        merge([tmp_path / "a", tmp_path / "none"], tmp_path / "m")


def test_a_missing_file_stops_a_merge_and_leaves_nothing(tmp_path: Path, two: list[Path]) -> None:
    (two[1] / file_of("shard", 2)).unlink()
    with pytest.raises(DatasetError, match=r"b: ep_000002\.tar is missing"):
        merge(two, tmp_path / "m")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_folder_that_is_there_is_left_alone(tmp_path: Path, two: list[Path]) -> None:
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "mine").touch()
    with pytest.raises(OutputError, match="exists already"):
        merge(two, tmp_path / "m")
    assert [path.name for path in (tmp_path / "m").iterdir()] == ["mine"]


def test_left_overs_of_a_killed_merge_are_cleared(tmp_path: Path, two: list[Path]) -> None:
    (tmp_path / "m.partial" / "episodes").mkdir(parents=True)
    (tmp_path / "m.partial" / "episodes" / "ep_000009.json").write_text("half")
    assert len(merge(two, tmp_path / "m").episodes) == 5


def test_files_are_copied_where_the_disk_has_no_links(
    tmp_path: Path, two: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(merging.errno.EXDEV, "another disk")

    monkeypatch.setattr(merging.os, "link", refuse)
    assert len(merge(two, tmp_path / "m")) == 15


def test_episodes_without_a_tick_are_left_out(tmp_path: Path) -> None:
    info = write_dataset(tmp_path / "a", (2,))
    write_episode(tmp_path / "a", info, 1, [])
    assert [r.frames for r in merge([tmp_path / "a"], tmp_path / "m").episodes.values()] == [2]


def test_a_split_by_town_has_all_episodes_once(tmp_path: Path) -> None:
    write_dataset(tmp_path / "a", (4, 3, 2, 5))
    parts = split(tmp_path / "a", tmp_path / "s", by_town(Dataset(tmp_path / "a"), "each"))
    assert [part.root.name for part in parts] == ["eu_small_a", "us_large_a"]
    assert [len(part) for part in parts] == [6, 8]
    assert all({r.town for r in part.episodes.values()} == {part.root.name} for part in parts)
    assert [r.facts["split_from"] for r in parts[1].episodes.values()] == [1, 3]
    chosen = split(tmp_path / "a", tmp_path / "t", by_town(Dataset(tmp_path / "a"), "test=us_large_a"))
    assert [(part.root.name, len(part)) for part in chosen] == [("test", 8)]


def test_a_split_by_share_deals_whole_episodes_by_seed(tmp_path: Path) -> None:
    write_dataset(tmp_path / "a", (3,) * 20)
    dataset = Dataset(tmp_path / "a")
    parts = by_share(dataset, "train=0.75,val=0.25", seed=1)
    assert {name: len(records) for name, records in parts.items()} == {"train": 15, "val": 5}
    numbers = [record.episode for records in parts.values() for record in records]
    assert sorted(numbers) == list(range(20))
    assert by_share(dataset, "train=0.75,val=0.25", seed=1) == parts
    assert by_share(dataset, "train=0.75,val=0.25", seed=2) != parts
    less = by_share(dataset, "train=0.5", seed=1)
    assert {r.episode for r in less["train"]} < {r.episode for r in parts["train"]}


def test_who_is_dealt_where_does_not_depend_on_numbers(tmp_path: Path) -> None:
    """The order goes by drive: a dataset and a merge of it with others deal its episodes in the same order."""
    write_dataset(tmp_path / "a", (3,) * 6)
    write_dataset(tmp_path / "b", (3,) * 6, first_seed=50)
    merge([tmp_path / "b", tmp_path / "a"], tmp_path / "m")
    merge([tmp_path / "a", tmp_path / "b"], tmp_path / "n")
    chosen = [
        sorted(identity(r) for r in by_share(Dataset(tmp_path / name), "x=0.5", seed=3)["x"]) for name in ("m", "n")
    ]
    assert chosen[0] == chosen[1]


def test_a_split_by_number(tmp_path: Path) -> None:
    write_dataset(tmp_path / "a", (1, 2, 3, 4))
    dataset = Dataset(tmp_path / "a")
    parts = split(tmp_path / "a", tmp_path / "s", by_number(dataset, "first=0-1,last=3"))
    assert [len(part) for part in parts] == [3, 4]
    with pytest.raises(DatasetError, match="has no episode 4"):
        by_number(dataset, "x=2-4")
    with pytest.raises(DatasetError, match="is in 'a' and in 'b'"):
        split(tmp_path / "a", tmp_path / "t", by_number(dataset, "a=0-2,b=2"))


def test_choices_that_can_not_be_read_are_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path / "a")
    dataset = Dataset(tmp_path / "a")
    with pytest.raises(UnknownName, match="Did you mean 'us_large_a'"):
        by_town(dataset, "x=us_large")
    for choice in ("", "train", "train=", "a=0.5,a=0.5", "../x=0.5"):
        with pytest.raises(DatasetError, match="expected parts as"):
            by_share(dataset, choice, 0)
    with pytest.raises(DatasetError, match="must be a number from 0 to 1, got 'half'"):
        by_share(dataset, "train=half", 0)
    with pytest.raises(DatasetError, match=r"add up to 1\.2"):
        by_share(dataset, "a=0.6,b=0.6", 0)
    with pytest.raises(DatasetError, match="would have no episode"):
        split(tmp_path / "a", tmp_path / "s", by_share(dataset, "a=0.999,b=0.001", 0))
    assert info_of().fields == dataset.info.fields
