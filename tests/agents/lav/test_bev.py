"""The teacher's stage: a golden step, a training on a recorded drive, and 32 frames learnt by heart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.batches import draw_batch
from agents.lav.config import LavConfig, find_preset
from agents.lav.labels import centre_path, is_pushed, read_motions
from agents.lav.models.teacher import make_teacher
from agents.lav.motion_measures import measures_of
from agents.lav.stages.base import StageInput, TrainConfig
from agents.lav.stages.bev import BevStage, teacher_loss
from agents.lav.training import train_stage
from agents.lav.weights import read_weights
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.dataset.tables import Column, Table
from lavsim.errors import ConfigError
from lavsim.random import Draws
from tests.agents.lav.test_training import made_samples, motions_of
from tests.dataset.recorded import drive, record

SEES_ONLY_LABELS = ({"type": "sensor.lavsim.bev", "id": "bev"},)
GOLDEN = (4.44698, 4.19850, 0.36136, 0.78906, 5.57543, 5.29264, 0.46082, 0.66542)  # loss, ego, others, command; twice


def micro(**motion: object) -> LavConfig:
    """The smallest teacher with all of tiny's inputs."""
    config = find_preset("micro")
    inputs = {"speeds": True, "goals": 2, "pooling": "grid", **motion}
    return config.model_copy(update={"motion": config.motion.model_copy(update=inputs)})


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of one drive, of labels from above alone."""
    root = tmp_path_factory.mktemp("labels")
    info = DatasetInfo.of(RecordConfig(SEES_ONLY_LABELS), seed=3)
    info.write(root)
    record(root, 0, info, drive(0), ticks=190)
    return root


def test_a_step_is_what_it_was() -> None:
    torch.manual_seed(3)
    network, samples = make_teacher(micro()), made_samples()
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    network.train()
    found = []
    for step in range(2):
        batch = draw_batch(samples, np.arange(16), Draws(step))
        loss, parts = teacher_loss(motions_of(network, batch), batch, 0.5)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        found += [loss.item(), *parts.values()]
    assert found == pytest.approx(GOLDEN, rel=1e-3)


def test_the_stage_learns_a_drive_by_heart(drives: Path, tmp_path: Path) -> None:
    data = Dataset(drives)
    train = TrainConfig(batch=16, epochs=12.0, learning_rate=5e-3)
    stage = BevStage(StageInput(micro(), train, data, data))
    before = measures_of(stage.network.eval(), read_motions(data, micro()))
    path = train_stage("bev", stage, micro(), train, tmp_path)
    assert path is not None
    weights = read_weights(path)
    measures = weights.lineage["measures"]
    assert measures["plan"] < 0.8 * before["plan"]
    assert measures["frames"] == before["frames"] > 15.0
    assert 0.0 < measures["route_centre_lateral"] < 0.5
    assert (tmp_path / "pictures" / "unseen.png").is_file()


@pytest.mark.slow
def test_32_frames_are_learnt_to_a_few_centimetres(drives: Path, tmp_path: Path) -> None:
    data = Dataset(drives)
    samples = read_motions(data, micro())
    assert len(samples) >= 32
    train = TrainConfig(batch=32, epochs=350.0, learning_rate=1e-2, average=0.9)
    path = train_stage("bev", BevStage(StageInput(micro(), train, data, data)), micro(), train, tmp_path)
    assert path is not None
    measures = read_weights(path).lineage["measures"]
    assert measures["plan"] < 0.25
    assert measures["plan_lateral"] < 0.1


def test_a_dataset_without_labels_from_above_is_refused(tmp_path: Path) -> None:
    info = DatasetInfo.of(RecordConfig(({"type": "sensor.other.gnss", "id": "gps"},)), seed=3)
    info.write(tmp_path)
    record(tmp_path, 0, info, drive(0), ticks=62)
    with pytest.raises(ConfigError, match="no picture from above"):
        read_motions(Dataset(tmp_path), micro())


def table(noise: float, speed: float = 8.0) -> Table:
    """Twelve frames of a straight drive; the control of the third is disturbed."""
    count = 12
    wish = np.zeros((count, 5), np.float32)
    ticks = np.zeros((5 * count, 5), np.float32)
    ticks[5 * 3, 1] = noise  # the first tick behind the third frame
    route = np.zeros((count, 20, 2), np.float32)
    route[..., 0] = np.arange(20) + 0.3
    columns = {
        "wish": Column(wish),
        "tick_control": Column(ticks, np.arange(count + 1) * 5),
        "speed": Column(np.full(count, speed, np.float32)),
        "route": Column(route),
        "route_index": Column(np.arange(count, dtype=np.int32) * 2),
        "position": Column(np.stack([2.0 * np.arange(count), np.zeros(count), np.zeros(count)], axis=1)),
        "yaw": Column(np.zeros(count)),
    }
    return Table(columns)


@pytest.mark.parametrize(("noise", "pushed"), [(0.0, False), (0.002, False), (0.2, True), (np.nan, False)])
def test_noise_that_pushes_is_seen_and_unknown_noise_is_none(noise: float, pushed: bool) -> None:
    assert is_pushed(table(noise), 0, 10) == pushed
    assert not is_pushed(table(noise), 3, 8)
    assert not is_pushed(table(noise), 0, 2)


def test_the_route_is_followed_beyond_the_stretch_that_a_frame_records() -> None:
    path = centre_path(table(0.0, speed=12.0), 1, 10)
    assert path[:, 0] == pytest.approx(np.zeros(10), abs=1e-6)
    assert path[:, 1] == pytest.approx(-3.0 * np.arange(1, 11), abs=1e-5)
