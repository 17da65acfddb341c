"""Any frame of any episode, from blobs or rendered from the log."""

import multiprocessing
import pickle
from pathlib import Path

import numpy as np
import pytest

from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import BLOB
from lavsim.errors import DatasetError, UnknownName
from lavsim.log.reader import LogReader
from tests.dataset.recorded import make_dataset


def test_frames_are_numbered_through_all_episodes(recorded: Path) -> None:
    data = Dataset(recorded)
    assert [data.locate(k) for k in (0, 11, 12, 23)] == [(0, 0), (0, 11), (1, 0), (1, 11)]
    with pytest.raises(IndexError, match="24 frames"):
        data.locate(24)
    with pytest.raises(IndexError, match="12 frames"):
        data.read(0, 12)


def test_only_what_is_asked_for_is_read(recorded: Path) -> None:
    data = Dataset(recorded)
    assert list(data.read(0, 3, ["lidar", "speed"])) == ["speed", "lidar"]
    (recorded / "blobs" / "ep_000000.tar").stat()
    assert list(data.read(0, 3, [])) == []


def test_mistakes_are_named(recorded: Path) -> None:
    data = Dataset(recorded)
    with pytest.raises(UnknownName, match=r"no field 'lidars'\. Did you mean 'lidar'"):
        data.read(0, 0, ["lidars"])
    with pytest.raises(DatasetError, match=r"has no finished episode 7\.$"):
        data.read(7, 0)


def test_readings_rendered_from_logs_are_the_decoded_blobs(recorded: Path, tmp_path: Path) -> None:
    make_dataset(tmp_path, episodes=1, blobs=False)
    alone, whole = Dataset(tmp_path), Dataset(recorded)
    assert not alone.has_blobs
    names = [item.name for item in whole.info.fields if item.place == BLOB]
    for frame in (11, 0, 5):
        rendered, stored = alone.read(0, frame, names), whole.read(0, frame, names)
        for name in names:
            assert np.array_equal(rendered[name], stored[name]), name
    assert alone.encoded(0, 3, "rgb_1") == whole.encoded(0, 3, "rgb_1")


def test_a_table_without_sensors_lacks_only_what_they_saw(recorded: Path, tmp_path: Path) -> None:
    make_dataset(tmp_path, episodes=1, blobs=False)
    alone, whole = Dataset(tmp_path).table(0), Dataset(recorded).table(0)
    assert set(whole.columns) - set(alone.columns) == {"lidar_now", "actor_lidar_hits", "actor_pixels"}
    for name, column in alone.columns.items():
        assert np.array_equal(column.values, whole.columns[name].values, equal_nan=column.values.dtype.kind == "f"), (
            name
        )


def test_what_sensors_saw_fits_what_they_read(recorded: Path) -> None:
    data = Dataset(recorded)
    seen = 0
    for frame in range(0, 12, 4):
        row = data.read(1, frame)
        pixels = row["actor_pixels"]
        assert pixels.shape == (len(row["actor_id"]), 6)
        vehicles_and_walkers = np.isin(row["sem_2"], (4, 10)).sum()
        assert pixels[:, 2].sum() <= vehicles_and_walkers + np.isin(row["sem_2"], (19, 20)).sum()
        assert 0 < row["lidar_now"] < len(row["lidar"])
        assert row["actor_lidar_hits"].sum() < len(row["lidar"])
        assert row["actor_lidar_hits"][0] == 0  # the ego's own body lies below its beams
        seen += int((row["actor_lidar_hits"] > 0).sum())
    assert seen > 0


def test_points_on_an_actor_lie_within_its_box(recorded: Path) -> None:
    data = Dataset(recorded)
    row = data.read(1, 6)
    x, y = row["actor_position"][0, :2]
    yaw = float(row["actor_yaw"][0])
    now = row["lidar"][:, :2].astype(np.float64)  # in a twentieth of a second nobody gets far
    world = np.column_stack([x + now[:, 0] * np.cos(yaw) - now[:, 1] * np.sin(yaw),
                             y + now[:, 0] * np.sin(yaw) + now[:, 1] * np.cos(yaw)])  # fmt: skip
    for k in np.flatnonzero(row["actor_lidar_hits"] >= 8).tolist():
        offset = world - row["actor_position"][k, :2]
        reach = np.hypot(*row["actor_size"][k, :2]) / 2.0 + 0.7
        # All that hit it and some of the ground.
        assert np.count_nonzero(np.hypot(*offset.T) < reach) >= row["actor_lidar_hits"][k]


def test_ticks_between_frames_are_the_logs(recorded: Path) -> None:
    table, log = Dataset(recorded).table(0), LogReader(recorded / "logs/ep_000000.lavlog")
    poses, controls = table.columns["tick_pose"], table.columns["tick_control"]
    for frame in (0, 7):
        tick = int(table["tick"][frame])
        for k, at in enumerate(range(tick - 4, tick + 1)):
            snapshot = log.at_tick(at)
            assert poses.row(frame)[k].tolist() == [*snapshot.xyz[0, :2].tolist(), float(snapshot.yaw[0])]
            assert np.array_equal(controls.row(frame)[k], snapshot.control)
        gnss = table.columns["tick_gnss"].row(frame)
        assert gnss.shape == (5, 3)
        assert np.all(np.abs(gnss[:, :2]) < 0.01)


def test_wishes_are_what_is_applied_a_tick_later(recorded: Path) -> None:
    table, log = Dataset(recorded).table(0), LogReader(recorded / "logs/ep_000000.lavlog")
    for frame in (2, 9):
        after = log.at_tick(int(table["tick"][frame]) + 1).control
        assert table["wish"][frame] == pytest.approx(after, abs=0.01)


def _read_in_child(pickled: bytes, results: "multiprocessing.Queue[bytes]") -> None:
    results.put(pickle.loads(pickled).read(1, 4, ["lidar"])["lidar"].tobytes())


def test_a_dataset_may_be_handed_to_another_process(recorded: Path) -> None:
    data = Dataset(recorded)
    here = data.read(1, 4, ["lidar"])["lidar"].tobytes()
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    child = context.Process(target=_read_in_child, args=(pickle.dumps(data), results))
    child.start()
    assert results.get(timeout=60) == here
    child.join()
