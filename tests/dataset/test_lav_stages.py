# ruff: noqa: E402 - torch comes first
"""Perception and the student on a recorded drive: one step of each, losses by hand, and a handful of frames learnt."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.batches import Batch
from agents.lav.config import LavConfig, find_preset
from agents.lav.models.crop import to_planner
from agents.lav.models.student import Perception
from agents.lav.models.teacher import Motions, make_teacher
from agents.lav.stages.base import StageInput, StepContext, TrainConfig
from agents.lav.stages.bev import COMMAND_WEIGHT, OTHERS_WEIGHT
from agents.lav.stages.full import FullStage, distillation_loss
from agents.lav.stages.perception import PerceptionStage
from agents.lav.training import train_stage
from agents.lav.variants import VARIANTS
from agents.lav.weights import Weights, read_weights
from lavsim.config import read_config
from lavsim.dataset.reader import Dataset
from lavsim.random import Draws

ONCE = TrainConfig(batch=4, epochs=0.01, learning_rate=1e-3, precision="float32")


def micro(*sets: str) -> LavConfig:
    return read_config(LavConfig, None, ('training.painting="truth"', *sets), find_preset("micro"))


def given(root: Path, train: TrainConfig = ONCE, *sets: str) -> StageInput:
    """Input of a stage, with parents that have learnt nothing."""
    config, data = micro(*sets), Dataset(root)
    torch.manual_seed(5)
    networks = {"perception": Perception(config), "bev": make_teacher(config)}
    parents = {name: Weights(name, config, network.state_dict(), {}) for name, network in networks.items()}
    return StageInput(config, train, data, data, parents)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def one_step(stage: Any, samples: range) -> tuple[float, dict[str, float], float]:
    draws = Draws(11)
    batch = stage.load(np.array(samples), draws)
    loss, parts = stage.loss(batch, StepContext(draws, 0.5))
    loss.backward()
    gradients = [value.grad for value in stage.network.parameters()]
    assert all(gradient is not None and torch.isfinite(gradient).all() for gradient in gradients)
    return loss.item(), parts, float(sum(gradient.square().sum() for gradient in gradients)) ** 0.5


def test_a_golden_step_of_perception(recorded: Path) -> None:
    loss, parts, norm = one_step(PerceptionStage(given(recorded)), range(4))
    assert loss == pytest.approx(parts["detection"] + parts["map"], rel=1e-5)
    assert (loss, norm) == pytest.approx(GOLDEN["perception"], rel=2e-3)


def test_a_golden_step_of_the_student(recorded: Path) -> None:
    loss, parts, norm = one_step(FullStage(given(recorded)), range(4))
    motion = parts["ego"] + OTHERS_WEIGHT * parts["others"] + COMMAND_WEIGHT * parts["command"]
    assert loss == pytest.approx(motion + parts["detection"] + parts["map"], rel=1e-5)
    assert (loss, norm) == pytest.approx(GOLDEN["full"], rel=2e-3)


@pytest.mark.parametrize("name", sorted(VARIANTS))
def test_every_variant_takes_a_step(recorded: Path, name: str) -> None:
    sets = [text.removeprefix("lav.") for text in VARIANTS[name].sets]
    loss, parts, _ = one_step(FullStage(given(recorded, ONCE, *sets)), range(4))
    assert np.isfinite(loss)
    if name == "perception-none":
        assert loss < parts["ego"] + parts["others"] + parts["command"] + 1e-5


def test_the_student_sees_windows_where_the_teacher_does(recorded: Path) -> None:
    """Poses in the student's world are those in the true one, moved and turned; the ego's window at the origin, and
    about straight."""
    lesson = FullStage(given(recorded)).load(np.arange(4), Draws(3))
    true, seen = lesson.motions.poses, lesson.poses
    angle = seen[:, 0, 2] - true[:, 0, 2]
    assert float(angle.abs().max()) > 0.01
    back = torch.stack([true[:, 0, 0], true[:, 0, 1], -angle], dim=1)
    assert float(seen[:, 0, :2].abs().max()) == 0.0
    assert float(true[:, 0, 0].abs().max()) > 0.1
    assert torch.allclose(to_planner(seen[..., :2], back), true[..., :2], atol=1e-4)
    assert float(seen[:, 0, 2].abs().max()) < np.radians(20.0) + 1e-6
    assert lesson.scene.boxes[:, 0, :3].abs().max() == 0.0


def test_distillation_by_hand() -> None:
    """One frame, a real and a padded vehicle; the student is off by 1 m in coarse plans, 2 m in refined ones."""
    zeros = torch.zeros
    taught = Motions(zeros(1, 3, 8), zeros(1, 3, 6, 4, 2), zeros(1, 3, 6), zeros(1, 2, 6, 4, 2))
    coarse = torch.stack([torch.full((6, 4, 2), value) for value in (1.0, 3.0, 9.0)])[None]
    student = Motions(zeros(1, 3, 8), coarse, zeros(1, 3, 6), torch.full((1, 2, 6, 4, 2), 2.0))
    batch = Batch(
        images=zeros(1), poses=zeros(1, 3, 3), futures=zeros(1, 3, 4, 2),
        is_real=torch.tensor([[True, True, False]]), speeds=zeros(1, 3), commands=torch.tensor([3]),
        goals=zeros(1, 2, 2), brakes=torch.tensor([True]), plans=torch.tensor([False]),
        ways=zeros(1, 33, 2), leads=torch.tensor([True]),
    )  # fmt: skip
    total, parts = distillation_loss(student, taught, batch)
    assert parts["ego"] == pytest.approx(1.0 + 2.0), "all branches, also of frames in which the expert brakes"
    assert parts["others"] == pytest.approx(3.0)
    assert parts["command"] == pytest.approx(np.log(2.0))
    assert total.item() == pytest.approx(3.0 + OTHERS_WEIGHT * 3.0 + COMMAND_WEIGHT * np.log(2.0))
    alone, _ = distillation_loss(student, taught, batch, with_others=False)
    assert alone.item() == pytest.approx(3.0 + COMMAND_WEIGHT * np.log(2.0))


def test_measures_and_pictures_of_both_stages(recorded: Path, tmp_path: Path) -> None:
    for name, kind in (("perception", PerceptionStage), ("full", FullStage)):
        path = train_stage(name, kind(given(recorded)), micro(), ONCE, tmp_path / name)
        assert path is not None
        measures = read_weights(path).lineage["measures"]
        assert 0.0 <= measures["road_iou"] <= 1.0
        assert (tmp_path / name / "pictures" / "unseen.png").stat().st_size > 1000
    assert {"plan", "plan_lateral", "constant_velocity", "road_iou"} <= set(measures)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [("perception", PerceptionStage), ("full", FullStage)])
def test_a_handful_of_frames_is_learnt(recorded: Path, tmp_path: Path, name: str, kind: Any) -> None:
    train = TrainConfig(batch=8, epochs=100.0, learning_rate=5e-3, precision="float32", average=0.9)
    stage = kind(given(recorded, train))
    before = stage.loss(stage.load(np.arange(8), Draws(1)), StepContext(Draws(1), 0.0))[1]
    path = train_stage(name, stage, micro(), train, tmp_path)
    assert path is not None
    after = stage.loss(stage.load(np.arange(8), Draws(1)), StepContext(Draws(1), 1.0))[1]
    assert after["map"] < 0.4 * before["map"]
    assert after["detection"] < 0.5 * before["detection"]
    if name == "full":
        assert after["ego"] < 0.4 * before["ego"]


GOLDEN = {"perception": (3.819684, 44.8359), "full": (7.095595, 1029.686)}  # loss, norm of the gradient
