"""LAV's trajectories as our datasets, and our datasets as LAV's trajectories."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lavsim.dataset.check import check
from lavsim.dataset.export_lav import export_lav
from lavsim.dataset.import_lav import import_lav
from lavsim.dataset.info import summarise
from lavsim.dataset.lav_frames import compass_of_yaw, decode_image, goal_of_position
from lavsim.dataset.lav_lmdb import LavFrame, LavTrajectory, trajectories, write_trajectory
from lavsim.dataset.reader import Dataset
from lavsim.errors import DatasetError
from lavsim.types import ActorClass
from tests.dataset.made import write_dataset
from tests.dataset.test_lav_lmdb import lav_frame

pytest.importorskip("lmdb")


def short(frame: LavFrame, ticks: int = 5) -> LavFrame:
    """The frame with so many ticks since the one before, and angles in the half turn that we keep."""
    parts = {name: getattr(frame, name)[:1].repeat(ticks, 0) for name in ("gnss", "lin_acc", "ang_vel")}
    return LavFrame(**{**vars(frame), **parts})


@pytest.fixture
def written(tmp_path: Path) -> list[LavFrame]:
    frames = [short(lav_frame(0)), short(lav_frame(1)), short(lav_frame(2), 300), short(lav_frame(3))]
    write_trajectory(tmp_path / "lav" / "abcdefghij", "Town01", frames)
    write_trajectory(tmp_path / "lav" / "zzzzzzzzzz", "Town02", frames[:1])
    return frames


def test_lav_to_ours_and_back(tmp_path: Path, written: list[LavFrame]) -> None:
    dataset = import_lav(tmp_path / "lav", tmp_path / "ours")
    assert [(r.town, r.route_id, r.frames, r.breaks) for r in dataset.episodes.values()] == [
        ("Town01", "abcdefghij", 4, (2,)),
        ("Town02", "zzzzzzzzzz", 1, ()),
    ]
    found = summarise(dataset).to_json()
    assert (found["has_logs"], found["has_tables"], found["has_blobs"], found["frames"]) == (False, True, True, 5)
    export_lav(tmp_path / "ours", tmp_path / "back")
    names = [path.name for path in trajectories(tmp_path / "back")]
    assert names == ["ep_000000", "ep_000000_1", "ep_000001"]  # cut where time jumps
    back: list[LavFrame] = []
    for name in names[:2]:
        with LavTrajectory(tmp_path / "back" / name) as trajectory:
            assert trajectory.town == "Town01"
            back += list(trajectory)
    for one, other in zip(written, back, strict=True):
        _assert_same(one, other)


def _assert_same(one: LavFrame, other: LavFrame) -> None:
    for name in ("rgb", "tel_rgb", "cmd", "bra"):
        assert getattr(one, name) == getattr(other, name), name
    for name in ("id", "loc", "bbox", "type", "nxp", "lin_acc", "ang_vel"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    np.testing.assert_allclose(one.ori, other.ori, atol=1e-4)
    np.testing.assert_allclose(one.spd, other.spd, rtol=1e-6)
    np.testing.assert_allclose(one.gnss[:, :4], other.gnss[:, :4])  # steer is not kept
    np.testing.assert_allclose(one.lidar[:, :3], other.lidar[:, :3], atol=0.0051)
    for mine, theirs in zip((*one.sem, one.tel_sem), (*other.sem, other.tel_sem), strict=True):
        np.testing.assert_array_equal(
            decode_image(mine, cv2.IMREAD_GRAYSCALE), decode_image(theirs, cv2.IMREAD_GRAYSCALE)
        )
    for k, (mine, theirs) in enumerate(zip(one.maps, other.maps, strict=True)):
        layers = [decode_image(data, cv2.IMREAD_GRAYSCALE) > 0 for data in (mine, theirs)]
        np.testing.assert_array_equal(layers[1], layers[0] if k in (0, 1, 2, 9, 10) else np.zeros((320, 320), bool))


def test_what_is_imported_reads_like_any_dataset(tmp_path: Path, written: list[LavFrame]) -> None:
    dataset = import_lav(tmp_path / "lav", tmp_path / "ours")
    assert check(tmp_path / "ours") == []
    frame = dataset.read(0, 1)
    assert frame["rgb_0"].shape == (288, 256, 3)
    assert frame["actor_class"].tolist() == [ActorClass.CAR, ActorClass.CAR, ActorClass.WALKER]
    np.testing.assert_allclose(np.degrees(frame["actor_yaw"]), written[1].ori, atol=1e-4)
    np.testing.assert_allclose(frame["goal"], [42.0, 3.5])  # stored as (left, forward) = (-3.5, 42)
    assert frame["tick"] == 10


def test_ours_as_lav_means_the_same(tmp_path: Path, recorded: Path) -> None:
    """The released loader's formulas on what we export give the poses that our tables hold."""
    numbers = export_lav(recorded, tmp_path / "lav")
    dataset = Dataset(recorded)
    assert numbers["frames"] == len(dataset)
    with LavTrajectory(tmp_path / "lav" / "ep_000001") as trajectory:
        frames = list(trajectory)
    assert len(frames) == dataset.episodes[1].frames
    for number, lav in enumerate(frames):
        row = dataset.read(1, number)
        assert lav.id[0] == lav.id.min() == 1  # the ego comes first; the released code also takes the lowest id for it
        np.testing.assert_allclose(lav.loc[0], row["position"][:2], atol=1e-4)
        np.testing.assert_allclose(lav.bbox * 2.0, row["actor_size"][:, :2])
        np.testing.assert_allclose(lav.spd[0], abs(row["speed"]), atol=0.02)
        # (left, forward) of the goal by LAV's formula, from world places; ours is blurred by GNSS noise of 0.56 m.
        left_forward = goal_of_position(row["goal_position"] - row["position"][:2], float(row["yaw"]))
        np.testing.assert_allclose(lav.nxp, left_forward, atol=3.0)
        np.testing.assert_allclose(lav.gnss[-1, 2], compass_of_yaw(row["yaw"]), atol=1e-3)
        np.testing.assert_allclose(lav.lidar, row["lidar"])
        assert lav.cmd == row["command"] - 1
        assert decode_image(lav.rgb[2]).shape == (288, 256, 3)
        assert decode_image(lav.tel_sem, cv2.IMREAD_GRAYSCALE).shape == (288, 480)
    steer = np.concatenate([lav.gnss[:, 4] for lav in frames])
    applied = dataset.table(1).columns["tick_control"].values[:, 1]
    np.testing.assert_array_equal(steer[:-1], applied[1:])


def test_the_vehicle_layer_lies_under_vehicles_in_the_planners_frame(tmp_path: Path, recorded: Path) -> None:
    """Reference `lav.md` 1.1: x right, y backward = -(left, forward); column 160 + 4 x, row 280 + 4 y."""
    export_lav(recorded, tmp_path / "lav")
    checked = 0
    for folder in trajectories(tmp_path / "lav"):
        with LavTrajectory(folder) as trajectory:
            for frame in trajectory:
                layer = decode_image(frame.maps[1], cv2.IMREAD_GRAYSCALE)
                places = -goal_of_position(frame.loc - frame.loc[0], float(np.radians(frame.ori[0])))
                columns, rows = np.floor(160.0 + 4.0 * places[:, 0]), np.floor(280.0 + 4.0 * places[:, 1])
                near = np.linalg.norm(places, axis=1) < 38.0  # LAV draws vehicles within 40 m
                shown = (frame.type == 1) & near & (np.minimum(columns, rows) >= 0) & (np.maximum(columns, rows) < 320)
                assert (layer[rows[shown].astype(int), columns[shown].astype(int)] > 0).all()
                checked += int(shown.sum()) - 1  # but for the ego
    assert checked > 5


def test_a_dataset_without_lavs_sensors_is_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path / "small")
    with pytest.raises(DatasetError, match="has no field 'rgb_1', which LAV's format needs"):
        export_lav(tmp_path / "small", tmp_path / "lav")
    assert not (tmp_path / "lav").exists()


def test_a_damaged_trajectory_is_named(tmp_path: Path) -> None:
    good = lav_frame(0)
    bad = LavFrame(**{**vars(good), "tel_sem": b"no image"})
    write_trajectory(tmp_path / "lav" / "qwertyuiop", "Town01", [good, bad])
    with pytest.raises(DatasetError, match="qwertyuiop, frame 1: no image"):
        import_lav(tmp_path / "lav", tmp_path / "ours")
    assert [path.name for path in tmp_path.iterdir()] == ["lav"]
