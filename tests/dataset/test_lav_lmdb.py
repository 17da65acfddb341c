"""LAV's own storage and its units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lavsim.dataset.lav_frames import (
    classes_from_lav,
    command_from_lav,
    command_to_lav,
    compass_of_yaw,
    encode_image,
    goal_from_lav,
    goal_of_position,
    goal_to_lav,
    layers_from_png,
    layers_to_png,
    sizes_from_lav,
    types_to_lav,
)
from lavsim.dataset.lav_lmdb import LavFrame, LavTrajectory, trajectories, write_trajectory
from lavsim.errors import DatasetError, OutputError
from lavsim.geometry import to_local
from lavsim.types import ActorClass, RoadOption

pytest.importorskip("lmdb")

angles = st.floats(-np.pi, np.pi)
metres = st.floats(-80.0, 80.0)


def lav_frame(seed: int, actors: int = 3) -> LavFrame:
    """A frame with something different everywhere."""
    draw = np.random.default_rng(seed)
    image = lambda *shape: draw.integers(0, 255, shape, np.uint8)  # noqa: E731
    maps = [255 * (image(320, 320) > 200).astype(np.uint8) for _ in range(11)]
    return LavFrame(
        rgb=tuple(encode_image(".jpg", image(288, 256, 3)) for _ in range(5)),
        sem=tuple(encode_image(".png", image(288, 256) % 23) for _ in range(5)),
        tel_rgb=encode_image(".jpg", image(288, 480, 3)),
        tel_sem=encode_image(".png", image(288, 480) % 23),
        maps=tuple(encode_image(".png", layer) for layer in maps),
        lidar=draw.normal(0.0, 20.0, (50, 4)).astype(np.float32),
        id=np.array([212, 17, 90, 91, 92][:actors], np.int32),  # the ego first, and not the lowest
        loc=draw.normal(0.0, 30.0, (actors, 2)).astype(np.float32),
        ori=draw.uniform(-180.0, 180.0, actors).astype(np.float32),
        bbox=np.array([[2.45, 1.06], [2.1, 0.95], [0.19, 0.19], [1.1, 0.4], [4.0, 1.3]][:actors], np.float32),
        type=np.array([1, 1, 0, 1, 1][:actors], np.uint8),
        spd=draw.uniform(0.0, 12.0, actors).astype(np.float32),
        cmd=seed % 6,
        nxp=np.array([-3.5, 42.0], np.float32),
        bra=seed % 2,
        gnss=draw.normal(0.0, 1.0, (5, 5)).astype(np.float32),
        lin_acc=draw.normal(0.0, 1.0, (5, 3)).astype(np.float32),
        ang_vel=draw.normal(0.0, 1.0, (5, 3)).astype(np.float32),
    )


def assert_equal(one: LavFrame, other: LavFrame) -> None:
    for name, value in vars(one).items():
        np.testing.assert_array_equal(np.asarray(value), np.asarray(getattr(other, name)), name)


def test_a_trajectory_reads_back_as_it_was_written(tmp_path: Path) -> None:
    frames = [lav_frame(k) for k in range(3)]
    assert write_trajectory(tmp_path / "abcdefghij", "Town01", frames) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["abcdefghij"]
    assert trajectories(tmp_path) == trajectories(tmp_path / "abcdefghij") == [tmp_path / "abcdefghij"]
    with LavTrajectory(tmp_path / "abcdefghij") as trajectory:
        assert (len(trajectory), trajectory.town) == (3, "Town01")
        for written, read in zip(frames, trajectory, strict=True):
            assert_equal(written, read)


def test_a_key_reads_as_the_released_code_reads_it(tmp_path: Path) -> None:
    """The released loader's own expressions (dtype, shape, order) on what we write."""
    import lmdb

    frame = lav_frame(4)
    write_trajectory(tmp_path / "t", "Town03", [frame])
    txn = lmdb.open(str(tmp_path / "t"), max_readers=1, readonly=True, lock=False).begin(write=False)

    def access(tag: str, dtype: type = np.float32) -> np.ndarray:
        return np.stack([np.frombuffer(txn.get(f"{tag}_{0:05d}".encode()), dtype)])

    assert int(txn.get(b"len")) == 1
    assert str(txn.get(b"town"))[2:-1] == "Town03"
    np.testing.assert_array_equal(access("id", np.int32).flatten(), frame.id)
    np.testing.assert_array_equal(access("loc").reshape(-1, 2), frame.loc)
    np.testing.assert_array_equal(access("type", np.uint8).flatten(), frame.type)
    np.testing.assert_array_equal(access("lidar").reshape(-1, 4), frame.lidar)
    assert access("cmd", np.uint8).item() == frame.cmd
    assert access("bra", np.uint8).item() == frame.bra
    np.testing.assert_array_equal(access("nxp").reshape(2), frame.nxp)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9])
def test_a_copy_cut_short_is_refused_by_name(tmp_path: Path, share: float) -> None:
    write_trajectory(tmp_path / "t", "Town01", [lav_frame(0)])
    path = tmp_path / "t" / "data.mdb"
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DatasetError, match=r"data\.mdb is cut short"):
        LavTrajectory(tmp_path / "t")


def test_what_is_no_trajectory_is_refused(tmp_path: Path) -> None:
    import lmdb

    with pytest.raises(DatasetError, match="holds no trajectory"):
        trajectories(tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "data.mdb").write_bytes(b"x" * 10_000)
    with pytest.raises(DatasetError, match="is no lmdb file"):
        LavTrajectory(tmp_path / "a")
    lmdb.open(str(tmp_path / "b"), lock=False).close()
    with pytest.raises(DatasetError, match="has no 'len'"):
        LavTrajectory(tmp_path / "b")
    with pytest.raises(OutputError, match="exists already"):
        write_trajectory(tmp_path / "b", "Town01", [])


def test_a_failing_writer_leaves_nothing(tmp_path: Path) -> None:
    def frames():  # type: ignore[no-untyped-def]
        yield lav_frame(0)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_trajectory(tmp_path / "t", "Town01", frames())
    assert list(tmp_path.iterdir()) == []


@given(x=metres, y=metres, ego_x=metres, ego_y=metres, yaw=angles)
def test_goals_are_left_and_forward_of_the_ego(x: float, y: float, ego_x: float, ego_y: float, yaw: float) -> None:
    """left = dx sin o - dy cos o, forward = dx cos o + dy sin o (reference `lav.md` 1.1); the planner's is -that."""
    ours = to_local([x, y], [ego_x, ego_y], yaw)
    dx, dy = x - ego_x, y - ego_y
    left, forward = dx * np.sin(yaw) - dy * np.cos(yaw), dx * np.cos(yaw) + dy * np.sin(yaw)
    np.testing.assert_allclose(goal_to_lav(ours), (left, forward), atol=1e-9)
    np.testing.assert_allclose(goal_of_position([dx, dy], yaw), (left, forward), atol=1e-9)
    np.testing.assert_allclose(goal_from_lav(goal_to_lav(ours)), ours)


@given(yaw=angles, north=metres, east=metres)
def test_the_recorders_rotation_by_the_compass_gives_the_same_goal(yaw: float, north: float, east: float) -> None:
    """The recorder rotates (north, east) by pi/2 - compass; ours goes by the yaw."""
    turn = np.pi / 2.0 - float(compass_of_yaw(yaw))
    rotated = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [north, east]
    np.testing.assert_allclose(goal_of_position([east, -north], yaw), rotated, atol=1e-9)


def test_commands_count_from_left() -> None:
    assert [command_to_lav(option) for option in RoadOption] == [3, 0, 1, 2, 3, 4, 5]
    assert [command_from_lav(k) for k in range(6)] == list(RoadOption)[1:]
    assert command_from_lav(255) == RoadOption.LANEFOLLOW


def test_boxes_are_half_in_lav_and_full_here() -> None:
    frame = lav_frame(0, actors=5)
    classes = classes_from_lav(frame.type, frame.bbox)
    assert classes.tolist() == [
        ActorClass.CAR, ActorClass.CAR, ActorClass.WALKER, ActorClass.MOTORCYCLE, ActorClass.TRUCK,
    ]  # fmt: skip
    sizes = sizes_from_lav(frame.bbox, classes)
    np.testing.assert_allclose(sizes[:, :2] / 2.0, frame.bbox)
    assert (sizes[:, 2] > 1.0).all()
    np.testing.assert_array_equal(types_to_lav(classes), frame.type)


def test_layers_come_back_from_lavs_files() -> None:
    layers = np.where(np.random.default_rng(0).random((5, 320, 320)) > 0.7, np.uint8(255), np.uint8(0))
    named = dict(zip(("road", "vehicle", "pedestrian", "solid", "broken"), layers, strict=True))
    files = layers_to_png(named)
    assert len(files) == 11
    np.testing.assert_array_equal(layers_from_png(files), layers)
