"""The training loop: resumed it equals itself, and what doesn't fit is refused; the teacher's stage on made samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from torch import nn

from agents.lav.batches import OTHERS, Batch, draw_batch, plain_batch, worth_learning
from agents.lav.config import LavConfig, find_preset
from agents.lav.data.arrays import grid_layers
from agents.lav.feed import Order
from agents.lav.labels import MotionSamples
from agents.lav.models.crop import to_planner
from agents.lav.models.teacher import Motions, make_teacher
from agents.lav.motion_measures import lateral, measures_of
from agents.lav.records import CURVE, MEASURES
from agents.lav.stages.base import Stage, StageInput, StepContext, TrainConfig
from agents.lav.stages.bev import teacher_loss
from agents.lav.training import rate_at, train_stage
from agents.lav.ways import PULL_AWAY, led_back, pulled_away, way_loss
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.sensors.bev import BevConfig

MICRO = find_preset("micro")
TRAIN = TrainConfig(batch=4, epochs=5.0, learning_rate=1e-2, save_every=3)


class Toy(Stage):
    """Learns a line through points, with dropout and normalisation, so that all state matters."""

    def __init__(self, given: StageInput | None = None) -> None:
        torch.manual_seed(0)
        self.network = nn.Sequential(nn.Linear(2, 8), nn.BatchNorm1d(8), nn.Dropout(0.2), nn.Linear(8, 1))
        self.points = torch.from_numpy(Draws(3).uniform(0, 20).reshape(10, 2)).float()

    def __len__(self) -> int:
        return len(self.points)

    def loss(self, samples: np.ndarray, context: StepContext) -> tuple[torch.Tensor, dict[str, float]]:
        x = self.points[torch.from_numpy(samples)] + float(context.draws.normal(0, 1)[0]) * 0.01
        return ((self.network(x)[:, 0] - x.sum(dim=1)) ** 2).mean(), {"progress": context.progress}

    def measure(self) -> dict[str, float]:
        return {"error": float((self.network(self.points)[:, 0] - self.points.sum(dim=1)).abs().mean())}


def test_a_training_that_was_killed_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    whole = train_stage("toy", Toy(), MICRO, TRAIN, tmp_path / "whole")
    assert whole is not None
    for stop in (4, 5, 9, None):
        done = train_stage("toy", Toy(), MICRO, TRAIN, tmp_path / "pieces", stop_at=stop)
    assert done is not None
    first, second = read_weights(whole), read_weights(done)
    assert all(torch.equal(first.tensors[name], second.tensors[name]) for name in first.tensors)
    assert (tmp_path / "whole" / CURVE).read_text() == (tmp_path / "pieces" / CURVE).read_text()
    assert (tmp_path / "whole" / MEASURES).read_bytes() == (tmp_path / "pieces" / MEASURES).read_bytes()
    assert first.lineage["steps"] == 13
    assert train_stage("toy", Toy(), MICRO, TRAIN, tmp_path / "whole") == whole, "what is finished is not done again"


def test_a_kill_after_a_checkpoint_forgets_the_steps_behind_it(tmp_path: Path) -> None:
    train_stage("toy", Toy(), MICRO, TRAIN, tmp_path, stop_at=4)
    with (tmp_path / CURVE).open("a") as file:
        file.write("5,0,0,0,0\n")  # a step whose checkpoint was never written
    train_stage("toy", Toy(), MICRO, TRAIN, tmp_path, stop_at=6)
    steps = [line.split(",")[0] for line in (tmp_path / CURVE).read_text().splitlines()[1:]]
    assert steps == ["1", "2", "3", "4", "5", "6"]


@pytest.mark.parametrize(
    ("config", "train", "message"),
    [
        (find_preset("tiny"), TRAIN, "other sizes"),
        (MICRO, TRAIN.model_copy(update={"learning_rate": 1e-3}), "was begun with train"),
        (MICRO, TRAIN.model_copy(update={"epochs": 9.0}), "was begun with steps 13, not 23"),
    ],
)
def test_a_checkpoint_of_something_else_is_refused(
    tmp_path: Path, config: LavConfig, train: TrainConfig, message: str
) -> None:
    train_stage("toy", Toy(), MICRO, TRAIN, tmp_path, stop_at=3)
    with pytest.raises(ConfigError, match=message):
        train_stage("toy", Toy(), config, train, tmp_path)


def test_weights_keep_their_config_and_lineage_and_a_damaged_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    write_weights(path, Weights("bev", MICRO, {"a.b": torch.arange(3.0), "c": torch.zeros(0)}, {"seed": 4}))
    loaded = read_weights(path)
    assert loaded.config == MICRO
    assert (loaded.stage, loaded.lineage) == ("bev", {"seed": 4})
    assert loaded.part("a")["b"].tolist() == [0.0, 1.0, 2.0]
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(ConfigError, match=r"w\.safetensors can't be read"):
        read_weights(path)
    with pytest.raises(ConfigError, match="there are no weights"):
        read_weights(tmp_path / "none")


def test_every_sample_comes_once_an_epoch() -> None:
    order = Order(10, TRAIN)
    seen = np.concatenate([order.samples(step) for step in range(5)])
    assert sorted(seen[:10]) == sorted(seen[10:]) == list(range(10))
    assert seen[:10].tolist() != seen[10:].tolist()
    assert Order(10, TRAIN).samples(3).tolist() == seen[12:16].tolist()
    with pytest.raises(ConfigError, match="nothing to learn"):
        Order(0, TRAIN)


def test_rates_fall_as_their_schedules_say() -> None:
    for schedule, middle in (("constant", 1.0), ("halving", 0.25), ("cosine", 0.5)):
        train = TrainConfig(learning_rate=1.0, schedule=schedule)
        assert rate_at(0.0, train) == 1.0
        assert rate_at(0.5, train) == pytest.approx(middle)


def made_samples(count: int = 16) -> MotionSamples:
    """The ego drives straight on a road as wide as it is fast; two others, of which every second sample has one."""
    grid, steps = MICRO.grid, MICRO.motion.waypoints
    bev = np.zeros((count, 5, grid.rows, grid.cols), np.uint8)
    speed = np.linspace(2.0, 8.0, count).astype(np.float32)
    for k in range(count):
        half = int(speed[k])
        bev[k, 0, :, grid.cols // 2 - half : grid.cols // 2 + half] = 1
    poses = np.zeros((count, 3, 3), np.float32)
    poses[:, 1] = (3.0, -8.0, 0.5)
    poses[:, 2] = (-3.0, -5.0, -1.0)
    futures = np.zeros((count, 3, steps, 2), np.float32)
    futures[..., 1] = -0.25 * speed[:, None, None] * np.arange(1, steps + 1)
    real = np.ones((count, 3), bool)
    real[::2, 2] = False
    goals = np.zeros((count, 2, 2), np.float32)
    goals[..., 1] = -30.0, -80.0
    return MotionSamples(
        bev=np.packbits(bev, axis=-1),
        poses=poses,
        futures=futures,
        is_real=real,
        speeds=np.repeat(speed[:, None], 3, axis=1),
        command=np.full(count, 3),
        goals=goals,
        brake=np.zeros(count, bool),
        pushed=np.zeros(count, bool),
        centre=futures[:, 0].copy(),
        ways=np.stack([np.zeros((count, 33)), np.broadcast_to(-np.arange(33.0), (count, 33))], -1).astype(np.float32),
        half=(2.45, 1.06),
        grid=grid,
    )


def motions_of(network: nn.Module, batch: Batch) -> Motions:
    found: Motions = network(batch.images, batch.poses, batch.goals, batch.speeds, batch.is_real)
    return found


def test_jittered_windows_see_the_same_world() -> None:
    samples = made_samples()
    index = np.array([1, 2, 3])
    still, moved = plain_batch(samples, index), draw_batch(samples, index, Draws(7))
    assert isinstance(moved, Batch)
    assert moved.poses.shape[1] == min(OTHERS + 1, 3)
    assert float((moved.poses - still.poses).abs().max()) > 0.1
    assert moved.is_real[:, 0].all()
    for batch in (still, moved):
        ego = to_planner(batch.futures[:, 0], batch.poses[:, 0])
        way = torch.from_numpy(samples.futures[index, 0])
        assert torch.allclose(ego, led_back(way, batch.poses[:, 0, :2]), atol=1e-4)
        goals = to_planner(batch.goals, batch.poses[:, 0])
        assert torch.allclose(goals, torch.from_numpy(samples.goals[index]), atol=1e-4)
    again = draw_batch(samples, index, Draws(7))
    assert torch.equal(again.poses, moved.poses)


def test_a_moved_window_does_not_show_whence_it_was_moved() -> None:
    """The ego is drawn where the window is, and nowhere else: what is seen of it says nothing."""
    samples = made_samples()
    index = np.arange(16)
    moved = draw_batch(samples, index, Draws(7))
    assert float(moved.poses[:, 0, 0].abs().max()) > 2.0
    y, x = torch.meshgrid(
        torch.arange(MICRO.grid.rows) + 0.5 - MICRO.grid.ahead,
        torch.arange(MICRO.grid.cols) + 0.5 - MICRO.grid.aside,
        indexing="ij",
    )
    for image, pose in zip(moved.images, moved.poses[:, 0], strict=True):
        cells = image[1] > 0
        middle = torch.stack([x[cells].mean(), y[cells].mean()])
        assert float((middle - pose[:2]).abs().max()) < 0.6
        assert 10 <= int(cells.sum()) <= 32
    assert torch.equal(moved.images[:, 0], samples.images(index)[:, 0]), "the road stays"


def test_a_plan_comes_back_gently_and_stays() -> None:
    way = torch.stack([torch.zeros(20), -torch.arange(1.0, 21.0)], dim=-1)[None]
    led = led_back(way, torch.tensor([[3.0, 0.0]]))
    assert led[0, 0, 0] > 2.9
    assert torch.equal(led[0, 13:], way[0, 13:]), "4 m, and 3 m for each metre aside"
    assert (torch.diff(led[0, :, 0]) <= 0.0).all()
    assert torch.equal(led_back(way, torch.zeros(1, 2)), way)


def test_a_way_says_how_far_aside_and_not_how_fast() -> None:
    ways = torch.stack([torch.zeros(33), -torch.arange(33.0)], dim=-1)[None]
    for speed in (0.3, 1.0, 5.0):
        path = torch.stack([torch.full((4,), 0.7), -speed * torch.arange(1.0, 5.0)], dim=-1)
        assert way_loss(path[None, None], ways).tolist() == [[pytest.approx(0.7)]]
    start = pulled_away(ways, 10)[0]
    assert start[-1].tolist() == pytest.approx([0.0, -0.5 * PULL_AWAY * 2.5**2])


def test_who_stands_for_others_is_taught_to_pull_away_and_who_brakes_where_to_go_on() -> None:
    samples = made_samples(4)
    samples.brake[:2] = True
    samples.pushed[1] = True
    samples.speeds[0] = 0.0
    batch = plain_batch(samples, np.arange(4))
    assert batch.plans.tolist() == [True, False, True, True]
    assert batch.leads.tolist() == [True, False, True, True]
    assert batch.futures[0, 0, :, 1].tolist() == pytest.approx([-0.0625, -0.25, -0.5625, -1.0])
    samples.speeds[0] = 5.0
    batch = plain_batch(samples, np.arange(4))
    assert (batch.plans.tolist(), batch.leads.tolist()) == ([False, False, True, True], [True, False, True, True])


def test_frames_without_plan_and_way_teach_none_and_missing_vehicles_nothing() -> None:
    samples = made_samples(4)
    network = make_teacher(MICRO).eval()
    batch = plain_batch(samples, np.arange(4))
    motions = motions_of(network, batch)
    _, parts = teacher_loss(motions, batch, 1.0)
    batch.plans[:] = False
    batch.leads[:] = False
    total, braking = teacher_loss(motions, batch, 1.0)
    assert parts["ego"] > 0.0
    assert braking["ego"] == 0.0
    batch.is_real[:, 1:] = False
    early, alone = teacher_loss(motions, batch, 1.0)
    assert alone["others"] == 0.0
    assert early.item() < total.item()
    late, _ = teacher_loss(motions, plain_batch(samples, np.arange(4)), 1.0)
    begin, _ = teacher_loss(motions, plain_batch(samples, np.arange(4)), 0.0)
    assert begin.item() < late.item(), "others count little at first"


def test_the_teacher_learns_a_handful_of_samples() -> None:
    torch.manual_seed(1)
    samples, network = made_samples(), make_teacher(MICRO)
    before = measures_of(network.eval(), samples)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    network.train()
    for step in range(150):
        batch = draw_batch(samples, np.arange(16), Draws(step))
        loss, _ = teacher_loss(motions_of(network, batch), batch, step / 150)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    after = measures_of(network.eval(), samples)
    assert after["plan"] < 0.3 * before["plan"]
    assert after["constant_velocity"] == after["route_centre"] == pytest.approx(0.0, abs=1e-5)
    assert after["others_constant_velocity"] == pytest.approx(0.0, abs=1e-5)
    assert (after["frames"], after["others"]) == (16.0, 24.0)


def test_a_lateral_error_is_the_part_across_the_true_path() -> None:
    right = torch.tensor([[[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]])  # drives to its right
    assert lateral(right + torch.tensor([0.7, -0.2]), right).item() == pytest.approx(0.2)
    still = torch.zeros(1, 3, 2)
    assert lateral(still + torch.tensor([0.3, 5.0]), still).item() == pytest.approx(0.3)


def test_padding_teaches_nothing_and_changes_nobody() -> None:
    samples, network = made_samples(4), make_teacher(MICRO)
    network.train()
    batch = plain_batch(samples, np.arange(4))
    first = motions_of(network, batch)
    batch.poses[~batch.is_real] += 3.0
    second = motions_of(network, batch)
    assert torch.equal(first.coarse, second.coarse)
    assert not first.coarse[~batch.is_real].any()


def test_windows_that_stand_are_few_and_bends_come_twice() -> None:
    samples = made_samples(1000)
    samples.brake[:500] = True
    samples.speeds[:400] = 0.0
    samples.futures[900:, 0, -1, 0] = 4.0
    chosen = worth_learning(samples, Draws(5))
    times = np.bincount(chosen, minlength=1000)
    assert 80 < times[:400].sum() < 160
    assert 50 < times[400:500].sum() < 90
    assert (times[500:900] == 1).all()
    assert (times[900:] == 2).all()
    assert np.array_equal(chosen, worth_learning(samples, Draws(5)))


def test_recorded_labels_land_on_the_grid_where_the_ego_sees_them() -> None:
    recorded = BevConfig(type="sensor.lavsim.bev", id="bev")
    layers = np.zeros((5, 320, 320), np.uint8)
    layers[1, 280 - 40, 160 + 20] = 255  # 10 m ahead, 5 m right
    for name in ("tiny", "micro", "small", "paper"):
        grid = find_preset(name).grid
        found = grid_layers(layers, recorded, grid)
        assert found.shape == (5, grid.rows, grid.cols)
        row, col = np.argwhere(found[1])[0]
        assert grid.ahead - (row + 0.5) * grid.cell == pytest.approx(9.875, abs=grid.cell / 2)
        assert (col + 0.5) * grid.cell - grid.aside == pytest.approx(5.125, abs=grid.cell / 2)
    with pytest.raises(ConfigError, match="do not fit"):
        grid_layers(layers, recorded, find_preset("tiny").grid.model_copy(update={"cell": 0.4}))
