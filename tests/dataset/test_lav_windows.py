"""LAV's training samples from a recorded dataset, as arrays and as tensors."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.lav.config import GridConfig, find_preset
from agents.lav.data.arrays import front_images, grid_layers, motion_arrays, some_points
from lavsim.dataset.reader import Dataset
from lavsim.dataset.samples import SampleFilter
from lavsim.dataset.windows import Sampler, SamplerState, Windows
from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.sensors.bev import BevConfig

BEV = BevConfig("sensor.lavsim.bev", "BEV")
WIDE = SampleFilter(vehicle_radius=40.0, walker_radius=40.0, most=6)


def test_a_stored_picture_is_cut_and_pooled_about_the_ego() -> None:
    layers = np.zeros((2, 320, 320), np.uint8)
    layers[0, 280, 160] = 255  # the ego's origin is the upper left corner of this pixel
    layers[1, 0, 0] = 255  # 70 m ahead, 40 m to the left
    assert np.array_equal(grid_layers(layers, BEV, GridConfig()), layers // 255)
    tiny = grid_layers(layers, BEV, find_preset("tiny").grid)
    assert tiny.shape == (2, 128, 128)
    assert np.argwhere(tiny).tolist() == [[0, 112, 64]]  # 56 m ahead and 32 m to the left, in cells of half a metre


@pytest.mark.parametrize("grid", [GridConfig(ahead=72.0), GridConfig(cell=0.3125), GridConfig(aside=44.0)])
def test_a_grid_that_does_not_fit_is_refused(grid: GridConfig) -> None:
    with pytest.raises(ConfigError):
        grid_layers(np.zeros((1, 320, 320), np.uint8), BEV, grid)


def test_motions_are_padded_and_turned_into_the_planner_frame(recorded: Path) -> None:
    table = Dataset(recorded).table(1)
    arrays = motion_arrays(table, 3, 4, WIDE)
    count = int(arrays["is_real"].sum())
    assert 1 < count < 6
    assert arrays["is_real"].tolist() == [True] * count + [False] * (6 - count)
    assert arrays["futures"].shape == (6, 4, 2)
    assert not arrays["futures"][count:].any()
    assert arrays["poses"][0].tolist() == [0.0, 0.0, 0.0]
    moved = np.linalg.norm(table["position"][7, :2] - table["position"][3, :2])
    assert arrays["futures"][0, 3] == pytest.approx([0.0, -moved], abs=0.05)  # straight ahead is -y
    assert arrays["command"] == 3
    assert (arrays["goals"][:, 1] < -20.0).all()


def test_points_left_out_are_drawn_by_frame() -> None:
    points = np.arange(40, dtype=np.float32).reshape(10, 4)
    draws = Draws.of_seed(0)
    some, count = some_points(points, 6, draws, 1)
    assert count == 6
    assert len({row[0] for row in some.tolist()}) == 6
    assert np.array_equal(some, some_points(points, 6, draws, 1)[0])
    assert not np.array_equal(some, some_points(points, 6, draws, 2)[0])
    padded, count = some_points(points, 12, draws, 1)
    assert count == 10
    assert np.array_equal(padded[:10], points)
    assert not padded[10:].any()


def test_images_are_scaled_and_the_telephoto_loses_its_lowest_third() -> None:
    frame: dict[str, Any] = {
        name: np.full((288, 256, 3), k, np.uint8) for k, name in enumerate(("rgb_1", "rgb_2", "rgb_3"))
    }
    telephoto = np.zeros((288, 480, 3), np.uint8)
    telephoto[192:] = 255
    for preset in ("paper", "tiny"):
        cameras = find_preset(preset).cameras
        images = front_images({**frame, "tel_rgb": telephoto}, cameras)
        assert images["images"].shape == (3, 3, cameras.height, cameras.width)
        assert images["images"][:, 0, 0, 0].tolist() == [0, 1, 2]
        assert images["telephoto"].shape == (3, cameras.telephoto_height, cameras.telephoto_width)
        assert not images["telephoto"].any()


def test_workers_give_what_one_process_gives(recorded: Path) -> None:
    torch = pytest.importorskip("torch", reason="the training samples need PyTorch (the extra `lav`)")
    from agents.lav.data.windows import EpochSampler, LavSample, WindowDataset

    data = Dataset(recorded)
    config = find_preset("micro")
    windows = Windows(list(data.episodes.values()), config.motion.waypoints)
    made = WindowDataset(data, windows, LavSample(config, ("bev", "lidar", "images"), WIDE))
    order = EpochSampler(Sampler(len(made), seed=5, state=SamplerState(2, 6)))
    assert len(order) == len(made) - 6
    alone = list(torch.utils.data.DataLoader(made, batch_size=4, sampler=order))
    beside = list(torch.utils.data.DataLoader(made, batch_size=4, sampler=order, num_workers=1))
    assert len(alone) == len(beside) == -(-len(order) // 4)
    for one, other in zip(alone, beside, strict=True):
        assert one.keys() == other.keys()
        assert all(torch.equal(one[name], other[name]) for name in one)
    grid, crop = config.grid, config.pillars.points
    assert alone[0]["bev"].shape == (4, 5, grid.rows, grid.cols)
    assert alone[0]["points"].shape == (4, crop, 4)
    assert order.state_after(3) == SamplerState(2, 9)
    assert order.state_after(len(order)) == SamplerState(3, 0)
    assert len(pickle.loads(pickle.dumps(data))) == len(data)
