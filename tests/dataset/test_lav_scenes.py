# ruff: noqa: E402 - torch comes first
"""Scans, boxes and maps as perception takes them: turned, stacked, painted where the cameras look."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import GridConfig, LavConfig, PillarConfig, find_preset
from agents.lav.data.arrays import grid_layers
from agents.lav.data.points import in_front_view, scan_points, turned
from agents.lav.data.scenes import actors_of, turned_map
from agents.lav.data.true_paint import TrueScores
from agents.lav.models.detection import NOBODY, VEHICLE
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws
from lavsim.sensors.bev import BevConfig

BEV = BevConfig("sensor.lavsim.bev", "BEV")
TINY = find_preset("tiny")
BARE = TINY.model_copy(update={"painted": False})
AROUND = BARE.model_copy(
    update={
        "grid": GridConfig(behind=52.0, ahead=52.0, aside=52.0, cell=0.5),
        "pillars": PillarConfig(points=40_000),
    }
)


def test_a_map_that_is_not_turned_is_the_recorded_one_on_the_grid() -> None:
    layers = (Draws(4).uniform(0, 5 * 320 * 320).reshape(5, 320, 320) < 0.1).astype(np.uint8) * 255
    for name in ("tiny", "micro", "paper"):
        grid = find_preset(name).grid
        found = turned_map(layers, BEV, grid, 0.0)
        assert np.array_equal(found[:3], grid_layers(layers, BEV, grid)[[0, 3, 4]])
        assert found[3].all()


@pytest.mark.parametrize(("angle", "right"), [(0.4, 0.0), (-0.5, 3.0), (math.pi / 2, -2.0)])
def test_the_map_moves_and_turns_with_points_and_boxes(angle: float, right: float) -> None:
    layers = np.zeros((5, 320, 320), np.uint8)
    layers[3, 280 - 81 : 280 - 79, 160 + 19 : 160 + 21] = 255  # about (20 ahead, 5 right)
    found = turned_map(layers, BEV, TINY.grid, angle, right)
    place = turned(np.array([20.0, 5.0 - right]), angle)
    row, col = np.argwhere(found[1]).mean(axis=0) + 0.5
    assert TINY.grid.ahead - row * TINY.grid.cell == pytest.approx(place[0], abs=0.4)
    assert col * TINY.grid.cell - TINY.grid.aside == pytest.approx(place[1], abs=0.4)
    assert found[3].all() == (angle == 0.0), "what lies beyond the picture is not known"


def test_boxes_turn_about_the_ego_which_keeps_its_heading(recorded: Path) -> None:
    table = Dataset(recorded).table(0)
    still, moved = actors_of(table, 5), actors_of(table, 5, 0.4)
    assert still.boxes[0, :3].tolist() == moved.boxes[0, :3].tolist() == [0.0, 0.0, 0.0]
    assert still.kinds[0] == VEHICLE
    real = still.kinds != NOBODY
    assert 1 < real.sum() < len(real)
    assert np.allclose(turned(still.boxes[real, :2], 0.4), moved.boxes[real, :2], atol=1e-4)
    change = moved.boxes[real, 2][1:] - still.boxes[real, 2][1:] - 0.4
    assert np.allclose(np.sin(change), 0.0, atol=1e-5)
    assert np.array_equal(still.hits, moved.hits)
    assert np.allclose(np.diff(np.hypot(*still.boxes[real, :2].T)) >= -1e-4, True), "the nearest come first"


def test_points_lie_in_the_boxes_however_the_world_is_turned(recorded: Path) -> None:
    data = Dataset(recorded)
    hits, episode, frame = max(
        (int(actors_of(data.table(episode), frame).hits[1:].max()), episode, frame)
        for episode in (0, 1)
        for frame in range(data.episodes[episode].frames)
    )
    assert hits > 10
    for angle, aside in ((0.0, 0.0), (0.5, 0.0), (0.5, -3.0)):
        points = scan_points(data, episode, frame, AROUND, None, angle, None, aside)
        actors = actors_of(data.table(episode), frame, angle, aside)
        assert actors.boxes[0, :3].tolist() == [0.0, 0.0, 0.0]
        x, y, heading, length, width = actors.boxes[1 + int(actors.hits[1:].argmax())].astype(float)
        right, backward = points[:, 1] - x, -points[:, 0] - y
        own_x = math.cos(heading) * right + math.sin(heading) * backward
        own_y = math.cos(heading) * backward - math.sin(heading) * right
        # Half of the scan is a tick old, and a car drives on meanwhile.
        inside = (np.abs(own_x) < width + 0.1) & (np.abs(own_y) < length + 0.8) & (points[:, 2] > -2.2)
        assert inside.sum() > 0.4 * hits


def test_only_what_the_front_cameras_see_is_painted(recorded: Path) -> None:
    ahead, behind, left, high = (20.0, 0.0, -1.0), (-5.0, 1.0, -2.0), (2.0, -9.0, -2.0), (3.0, 0.0, 5.0)
    points = np.array([ahead, behind, left, high], np.float32)
    assert in_front_view(points).tolist() == [True, False, True, False]
    data = Dataset(recorded)
    scores = TrueScores(data)
    painted = scan_points(data, 0, 5, TINY, scores, 0.0, None)
    assert painted.shape[1] == TINY.point_features
    assert not painted[~in_front_view(painted), 4:].any()
    road = painted[painted[:, 6] > 0.0]
    assert len(road) > 500
    assert np.abs(road[:, 2] + 2.4).max() < 0.3, "road lies on the ground"
    assert np.array_equal(painted[:, :4], scan_points(data, 0, 5, BARE, None, 0.0, None))


def test_a_past_scan_is_carried_to_where_the_ego_stands_now(recorded: Path) -> None:
    data = Dataset(recorded)
    stacked = LavConfig.model_validate(
        BARE.model_dump() | {"temporal": {"scans": 3}, "pillars": {"points": 40_000, "widths": [8]}}
    )
    points = scan_points(data, 0, 9, stacked, None, 0.0, None)
    assert points.shape[1] == stacked.point_features == 7
    tags = points[:, 4:]
    assert np.array_equal(tags.sum(axis=1), np.ones(len(points)))
    # Houses and posts stand: what is high in an old scan lies near what is high in the new one.
    new, old = (points[(tags[:, age] > 0) & (points[:, 2] > -1.0)][:, :3] for age in (0, 2))
    near = np.array([np.min(np.abs(new - point).sum(axis=1)) for point in old[:: max(1, len(old) // 60)]])
    assert np.median(near) < 0.6
    first = scan_points(data, 0, 0, stacked, None, 0.0, None)
    assert not first[:, 5:].any(), "before the first frame there is none"


def test_points_are_left_out_by_draws_and_without_them_evenly(recorded: Path) -> None:
    data = Dataset(recorded)
    few = BARE.model_copy(update={"pillars": BARE.pillars.model_copy(update={"points": 500})})
    drawn = scan_points(data, 0, 5, few, None, 0.0, Draws(1))
    assert len(drawn) == 500
    assert np.array_equal(drawn, scan_points(data, 0, 5, few, None, 0.0, Draws(1)))
    assert not np.array_equal(drawn, scan_points(data, 0, 5, few, None, 0.0, Draws(2)))
    even = scan_points(data, 0, 5, few, None, 0.0, None)
    assert np.array_equal(even, scan_points(data, 0, 5, few, None, 0.0, None))
    grid = TINY.grid
    for points in (drawn, even):
        assert (points[:, 0] <= grid.ahead).all()
        assert (np.abs(points[:, 1]) <= grid.aside).all()
