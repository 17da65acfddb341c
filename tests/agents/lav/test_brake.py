"""The brake network's stage: a golden step, losses by hand, a kill, measures, and 32 frames learnt by heart."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.brake_measures import Facts, measures_of, signal_measures
from agents.lav.config import LavConfig, find_preset
from agents.lav.data.images import far_view
from agents.lav.data.signals import GREEN, NONE, OPEN, RED, Signals, recorded_signals, repeats_of
from agents.lav.data.staged import StagedFrames
from agents.lav.models.brake import BrakeNetwork, Causes, causes_of, stop_of, telephoto_size
from agents.lav.painted import painted_folder
from agents.lav.records import CURVE
from agents.lav.stages.approaches import ApproachesStage
from agents.lav.stages.base import StageInput, StepContext, TrainConfig
from agents.lav.stages.brake import BrakeBatch, BrakeStage, Truth, brake_loss
from agents.lav.training import train_stage
from agents.lav.weights import read_weights
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.random import Draws
from tests.dataset.recorded import SUITE, drive, record

GOLDEN = (  # loss, stop, light, sign, others, distance, pixels; twice
    *(6.98111, 0.68939, 1.46563, 0.67132, 0.68471, 1.41462, 2.59423),
    *(4.6471, 0.5683, 0.77366, 0.46324, 0.50421, 0.67128, 2.4568),
)
SHARP = (96, 160)


def micro(causes: bool = True, approaches: int = 32) -> LavConfig:
    """The smallest brake network, with all of tiny's inputs and outputs."""
    config = find_preset("micro")
    brake = config.brake.model_copy(update={"causes": causes, "sharp": SHARP if causes else None})
    training = config.training.model_copy(update={"approaches": approaches})
    return config.model_copy(update={"brake": brake, "training": training})


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A short recorded drive."""
    root = tmp_path_factory.mktemp("drive")
    info = DatasetInfo.of(RecordConfig(SUITE), seed=3)
    info.write(root)
    record(root, 0, info, drive(0), ticks=42)
    return Dataset(root)


@pytest.fixture(scope="module")
def staged(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Approaches rendered from it."""
    folder = tmp_path_factory.mktemp("approaches")
    stage = ApproachesStage(StageInput(micro(), TrainConfig(), data))
    assert stage.run(folder, lambda share: None) == {"frames": 32.0}
    return folder


def stage_of(data: Dataset, staged: Path, train: TrainConfig, config: LavConfig | None = None) -> BrakeStage:
    config = config or micro()
    return BrakeStage(StageInput(config, train, data, data, folders={"approaches": staged}))


def images(config: LavConfig, count: int = 2) -> tuple[torch.Tensor, torch.Tensor]:
    cameras = config.cameras
    return torch.rand(count, 3, cameras.height, 3 * cameras.width), torch.rand(count, 3, *telephoto_size(config))


def test_causes_hang_on_both_images_and_on_places_in_them() -> None:
    config = micro()
    network, (wide, tele) = BrakeNetwork(config).eval(), images(config)
    outputs, first, second = network(wide, tele, with_tags=True)
    assert outputs.shape == (2, 8)
    assert causes_of(outputs).light.shape == (2, 4)
    assert torch.equal(stop_of(outputs), outputs[:, 0])
    assert torch.equal(causes_of(outputs).distance, 10.0 * outputs[:, 7])
    assert not torch.allclose(outputs, network(wide.flip(3), tele))
    assert not torch.allclose(outputs, network(wide, tele.flip(3)))
    assert first.shape[1] == second.shape[1] == 4
    one = BrakeNetwork(micro(causes=False)).eval()
    assert one(*images(micro(causes=False))).shape == (2,)


def test_the_sharp_view_is_the_middle_as_it_is_and_the_other_all_of_it_shrunk() -> None:
    image = np.random.default_rng(0).integers(0, 255, (288, 480, 3), np.uint8)
    assert np.array_equal(far_view(image, micro()), image[:96, 160:320])
    assert np.array_equal(far_view(image[..., 0], micro()), image[:96, 160:320, 0])
    assert far_view(image, micro(causes=False)).shape == (32, 80, 3)


def test_losses_by_hand_and_what_is_not_asked_counts_nothing() -> None:
    outputs = torch.zeros(2, 8)
    outputs[0, 7] = 1.5
    light = torch.tensor([RED, OPEN])
    truth = Truth(
        torch.tensor([OPEN, OPEN]), light, torch.tensor([1, OPEN]), torch.tensor([0, 1]), torch.tensor([10.0, math.nan])
    )
    config = micro()
    tags = torch.zeros(2, config.cameras.height, 3 * config.cameras.width), torch.zeros(2, *SHARP)
    _, first, second = BrakeNetwork(config)(*images(config), with_tags=True)
    loss, parts = brake_loss(outputs, first, second, BrakeBatch(*images(config), *tags, truth))
    assert parts["stop"] == 0.0
    assert parts["light"] == pytest.approx(math.log(4.0))
    assert parts["sign"] == parts["others"] == pytest.approx(math.log(2.0))
    assert parts["distance"] == pytest.approx(0.5 - 0.1), "5 m off, beyond the square's 2 m"
    wanted = 2.0 * math.log(4.0) + 2.0 * math.log(2.0) + 0.5 * 0.4 + 0.5 * parts["pixels"]
    assert loss.item() == pytest.approx(wanted, rel=1e-5)
    assert torch.isfinite(loss)


def test_recorded_frames_are_told_by_the_tables(data: Dataset) -> None:
    count = data.episodes[0].frames
    frames = np.stack([np.zeros(count, np.int64), np.arange(count)[::-1]], axis=1)
    table, found = data.table(0), recorded_signals(data, frames)
    assert found.stop.tolist() == np.asarray(table["brake"])[::-1].tolist()
    assert set(found.light.tolist()) <= {NONE, RED, 2, GREEN, OPEN}
    repeats = repeats_of(data, frames, found)
    assert repeats.shape == (count,)
    assert set(repeats.tolist()) <= {0, 1, 3}


def test_measures_by_hand() -> None:
    truth = Signals(
        stop=np.array([1, 0, 0, OPEN]),
        light=np.array([RED, GREEN, NONE, RED]),
        sign=np.array([0, 0, 1, 0]),
        others=np.array([0, 0, 1, OPEN]),
        distance=np.array([20.0, 8.0, 10.0, 6.0]),
    )
    logits = torch.zeros(4, 4)
    logits[0, RED] = logits[1, GREEN] = logits[2, RED] = logits[3, GREEN] = 9.0
    sure, distance = torch.tensor([-9.0, -9.0, 9.0, -9.0]), torch.tensor([18.0, 8.0, 13.0, 7.0])
    facts = Facts(
        np.array([True, False, False, False]),
        np.array(["light", "none", "none", "none"]),
        truth.light == RED,
        np.array([False, True, False, False]),
    )
    found = signal_measures(Causes(sure, logits, sure, -sure, distance), truth, "all", facts)
    assert found["all_red_told"] == 0.5
    assert found["all_red_near_told"] == found["all_green_near_held"] == 0.0
    assert found["all_no_light_held"] == found["all_light_false_driving"] == 1.0
    assert found["all_sign_told"] == 1.0
    assert found["all_others_told"] == 0.0
    assert found["all_others_false"] == 1.0
    assert found["all_distance_error"] == 1.5
    scores = measures_of(np.array([0.9, 0.8, 0.1, 0.2]), facts, 0.5)
    assert (scores["recall"], scores["recall_light"], scores["precision"]) == (1.0, 1.0, 0.5)
    assert scores["false_alarms"] == pytest.approx(1.0 / 3.0)
    assert scores["average_precision"] == 1.0


def test_a_step_is_what_it_was() -> None:
    config, rng = micro(), np.random.default_rng(4)
    torch.manual_seed(3)
    network = BrakeNetwork(config).train()
    cameras, count = config.cameras, 8
    sizes = (cameras.height, 3 * cameras.width), SHARP
    shown = [torch.from_numpy(rng.integers(0, 256, (count, 3, *size), np.uint8)) for size in sizes]
    tags = [torch.from_numpy(rng.integers(0, 23, (count, *size), np.uint8)) for size in sizes]
    stop, sign, others = (torch.from_numpy(rng.integers(-1, 2, count)) for _ in range(3))
    light = torch.from_numpy(rng.integers(-1, 4, count))
    truth = Truth(stop, light, sign, others, torch.from_numpy(rng.uniform(0.0, 40.0, count).astype(np.float32)))
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    found = []
    for step in range(2):
        torch.manual_seed(step)
        outputs, wide, far = network(*(image.float() / 255.0 for image in shown), with_tags=True)
        loss, parts = brake_loss(outputs, wide, far, BrakeBatch(*shown, *tags, truth))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        found += [loss.item(), *parts.values()]
    assert found == pytest.approx(GOLDEN, rel=1e-3)


def test_a_training_that_was_killed_goes_on_to_the_same_bits(data: Dataset, staged: Path, tmp_path: Path) -> None:
    train = TrainConfig(batch=4, epochs=0.4, learning_rate=1e-2, save_every=2)
    whole = train_stage("brake", stage_of(data, staged, train), micro(), train, tmp_path / "whole")
    for stop in (1, 2, None):
        pieces = train_stage("brake", stage_of(data, staged, train), micro(), train, tmp_path / "pieces", stop_at=stop)
    assert whole is not None
    assert pieces is not None
    first, second = read_weights(whole), read_weights(pieces)
    assert all(torch.equal(first.tensors[name], second.tensors[name]) for name in first.tensors)
    assert (tmp_path / "whole" / CURVE).read_text() == (tmp_path / "pieces" / CURVE).read_text()
    measures = first.lineage["measures"]
    assert measures["frames"] == data.episodes[0].frames
    assert 0.0 <= measures["approaches_no_light_held"] <= 1.0
    assert {"brake.png", "approaches.png"} <= {path.name for path in (tmp_path / "whole" / "pictures").iterdir()}


def test_the_paper_learns_full_stops_alone(data: Dataset, tmp_path: Path) -> None:
    config = micro(causes=False, approaches=0)
    assert BrakeStage.needs(config) == ()
    assert BrakeStage.needs(micro()) == ("approaches",)
    stage = BrakeStage(StageInput(config, TrainConfig(batch=4), data, data))
    draws = Draws(0)
    _, parts = stage.loss(stage.load(np.arange(4), draws), StepContext(draws, 0.0))
    assert set(parts) == {"stop", "pixels"}
    stage.network.eval()
    assert {"average_precision", "false_alarms"} <= set(stage.measure())


@pytest.mark.slow
def test_frames_are_learnt_by_heart(data: Dataset, staged: Path) -> None:
    config = micro()
    brake = config.brake.model_copy(update={"width": 8})
    config = config.model_copy(update={"brake": brake, "cameras": find_preset("tiny").cameras})
    stage = stage_of(data, staged, TrainConfig(batch=16), config)
    known = StagedFrames(painted_folder(staged, data), data)
    assert len(known) == 32
    samples = np.arange(len(stage) - 32, len(stage))
    optimiser = torch.optim.Adam(stage.network.parameters(), lr=3e-3)
    batch = stage.load(samples, Draws(0))
    stage.network.train()
    for step in range(100):
        loss, parts = stage.loss(batch, StepContext(Draws(step), 0.0))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert parts["light"] < 0.05
    assert parts["distance"] < 0.1
