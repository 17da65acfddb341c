"""Labels drawn on what was recorded: boxes must sit on cars."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lavsim.dataset.boxes import Boxes, box_corners_3d, camera_pose
from lavsim.dataset.picture import FramePainter, draw_sheet, random_frames
from lavsim.dataset.reader import Dataset
from lavsim.errors import DatasetError
from lavsim.render.camera_view import CameraView
from lavsim.sensors.base import make_sensor
from lavsim.sensors.camera import TagCamera
from lavsim.types import Tag
from tests.dataset.made import info_of, write_dataset

_MANY = 150  # pixels of an actor that is surely seen


def tag_views(dataset: Dataset) -> list[tuple[str, CameraView]]:
    sensors = [make_sensor(values) for values in dataset.info.record.suite]
    return [(s.config.id.lower(), s.view) for s in sensors if isinstance(s, TagCamera)]


def hull(view: CameraView, corners: np.ndarray) -> np.ndarray | None:
    """(H, W) bool where the box is in the image; None if part of it is behind the lens."""
    if (corners[:, 0] < 0.1).any():
        return None
    columns = view.width / 2.0 + view.lens.focal * corners[:, 1] / corners[:, 0]
    rows = view.height / 2.0 - view.lens.focal * corners[:, 2] / corners[:, 0]
    points = np.clip(np.stack([columns, rows], axis=1), -4000, 4000).astype(np.float32)
    mask = np.zeros((view.height, view.width), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(points).round().astype(np.int32), 1)
    return mask.astype(bool)


def test_boxes_sit_on_cars(recorded: Path) -> None:
    """In the tags of every camera, a vehicle that has many pixels fills much of its box, and has none far outside."""
    dataset = Dataset(recorded)
    checked = 0
    for index in range(0, len(dataset), 4):
        row = dataset.read(*dataset.locate(index))
        boxes = Boxes.of(row)
        for number, (name, view) in enumerate(tag_views(dataset)):
            pose, tags = camera_pose(view, row), row[name]
            for k, actor in enumerate(boxes.row):
                pixels = int(row["actor_pixels"][actor, number])
                inside = hull(view, pose.to_sensor(boxes.corners[k]))
                if pixels < _MANY or inside is None or row["actor_class"][actor] > 3:
                    continue
                share = (tags[inside] == Tag.VEHICLE).sum() / pixels
                assert share > 0.9, (index, name, actor, share)
                checked += 1
    assert checked > 5


def test_points_that_hit_an_actor_lie_in_its_box(recorded: Path) -> None:
    dataset = Dataset(recorded)
    checked = 0
    for index in range(0, len(dataset), 5):
        row = dataset.read(*dataset.locate(index))
        now = row["lidar"][: row["lidar_now"], :3].astype(np.float64)
        turn = np.array([[np.cos(row["yaw"]), np.sin(row["yaw"])], [-np.sin(row["yaw"]), np.cos(row["yaw"])]])
        world = now[:, :2] @ turn + row["position"][:2]
        for actor in np.flatnonzero(row["actor_lidar_hits"] > 40):
            offset = world - row["actor_position"][actor, :2]
            yaw, size = row["actor_yaw"][actor], row["actor_size"][actor]
            ahead = offset @ np.array([np.cos(yaw), np.sin(yaw)])
            aside = offset @ np.array([-np.sin(yaw), np.cos(yaw)])
            high = now[:, 2] + 2.4 + row["position"][2] - row["actor_position"][actor, 2]
            inside = (np.abs(ahead) < size[0] / 2 + 0.1) & (np.abs(aside) < size[1] / 2 + 0.1) & (high > 0.15)
            assert inside.sum() > 0.25 * row["actor_lidar_hits"][actor]  # one of two half sweeps sees it, or both
            checked += 1
    assert checked > 0


def test_corners_of_a_box() -> None:
    corners = box_corners_3d(
        np.array([[10.0, 5.0, 1.0]]), np.array([[4.0, 2.0, 1.5]]), np.array([np.pi / 2.0]), np.zeros(1)
    )
    np.testing.assert_allclose(corners[0, 0], [11.0, 7.0, 1.0], atol=1e-9)  # front left, heading south
    np.testing.assert_allclose(corners[0, 6], [9.0, 3.0, 2.5], atol=1e-9)  # rear right, above


def test_a_frame_shows_all_its_sensors(recorded: Path) -> None:
    painter = FramePainter(Dataset(recorded))
    small, large = painter.draw(1, 3), painter.draw(1, 3, scale=2)
    assert small.shape[1] * 2 - 12 == large.shape[1]
    np.testing.assert_array_equal(painter.draw(1, 3), small)
    near_green = np.abs(large.astype(int) - np.array([80, 220, 60])).max(axis=2) < 60
    assert near_green.sum() > 20  # outlines of what was seen


def test_a_sheet_has_the_frames_that_its_seed_draws(recorded: Path) -> None:
    dataset = Dataset(recorded)
    frames = random_frames(dataset, 4, seed=1)
    assert len(set(frames)) == 4
    assert frames == sorted(frames)
    assert frames != random_frames(dataset, 4, seed=2)
    assert len(random_frames(dataset, 1000, seed=1)) == len(dataset)
    painter = FramePainter(dataset)
    cell = painter.draw(*frames[0])
    sheet = draw_sheet(painter, frames, columns=2)
    np.testing.assert_array_equal(sheet[: cell.shape[0], : cell.shape[1]], cell)


def test_images_of_the_night_may_be_lightened(tmp_path: Path) -> None:
    write_dataset(tmp_path, (2,))  # its images are one level: 0 in frame 0, 40 in frame 1
    dataset = Dataset(tmp_path)
    plain, bright = (FramePainter(dataset, bright).draw(0, 1).astype(int) for bright in (False, True))
    assert (bright >= plain).all()
    assert (bright != plain).any()


def test_what_can_not_be_drawn_is_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    write_dataset(tmp_path / "none", ())
    with pytest.raises(DatasetError, match="has no frame"):
        random_frames(Dataset(tmp_path / "none"), 3, 0)
    info = info_of()
    replace(info, fields=info.blobs, record=replace(info.record, tables=False)).write(tmp_path / "logs")
    with pytest.raises(DatasetError, match="holds logs alone"):
        FramePainter(Dataset(tmp_path / "logs"))
