# ruff: noqa: E402 - torch comes first
"""Segmentation, brake and painting on a recorded drive: one step of each, losses by hand, some frames learnt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.brake_measures import average_precision
from agents.lav.config import find_preset
from agents.lav.data.images import WIDE_TAGS, frames_of
from agents.lav.models.segmentation import CLASS_WEIGHTS, make_segmentation
from agents.lav.painted import PaintedScores, painted_folder
from agents.lav.stages.base import StageInput, StepContext, TrainConfig
from agents.lav.stages.brake import BrakeStage
from agents.lav.stages.painting import PaintingStage
from agents.lav.stages.segmentation import (
    SegmentationStage,
    camera_bounds,
    confusion,
    intersections_over_unions,
    segmentation_losses,
)
from agents.lav.training import train_stage
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.cli import main
from lavsim.dataset.reader import Dataset
from lavsim.errors import ConfigError, DatasetError
from lavsim.random import Draws
from lavsim.types import Tag

ONCE = TrainConfig(batch=4, epochs=0.01, precision="float32")
MICRO = find_preset("micro")


class _NoTags(Dataset):
    """A dataset that was recorded without semantic cameras."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        fields = tuple(item for item in self.info.fields if "sem" not in item.name)
        self.info = replace(self.info, fields=fields)


def stage_input(data: Dataset, train: TrainConfig = ONCE) -> StageInput:
    return StageInput(MICRO, train, data, data)


def one_step(stage: Any) -> tuple[float, dict[str, float], float]:
    """Loss, its parts and the norm of the gradient of a step on four samples."""
    draws = Draws(11)
    loss, parts = stage.loss(stage.load(np.arange(4), draws), StepContext(draws, 0.0))
    loss.backward()
    gradients = [value.grad for value in stage.network.parameters()]
    assert all(gradient is not None for gradient in gradients)
    return loss.item(), parts, float(sum(gradient.square().sum() for gradient in gradients)) ** 0.5


@pytest.mark.parametrize("kind", [SegmentationStage, BrakeStage])
def test_a_golden_step(recorded: Path, kind: Any) -> None:
    loss, _, norm = one_step(kind(stage_input(Dataset(recorded))))
    assert (loss, norm) == pytest.approx(GOLDEN[kind], rel=2e-3)


def test_samples_are_functions_of_numbers_and_draws(recorded: Path) -> None:
    stage = SegmentationStage(stage_input(Dataset(recorded)))
    first, again, other = (
        stage.load(np.array(samples), Draws(seed)) for samples, seed in (([0, 5], 1), ([0, 5], 1), ([0, 5], 2))
    )
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first[0], other[0])


@pytest.mark.parametrize(("name", "kind"), [("segmentation", SegmentationStage), ("brake", BrakeStage)])
def test_measures_and_pictures(recorded: Path, tmp_path: Path, name: str, kind: Any) -> None:
    path = train_stage(name, kind(stage_input(Dataset(recorded))), MICRO, ONCE, tmp_path)
    assert path is not None
    measures = read_weights(path).lineage["measures"]
    main = {"segmentation": "iou_mean", "brake": "average_precision"}[name]
    assert 0.0 <= measures[main] <= 1.0
    assert (tmp_path / "pictures" / f"{name}.png").stat().st_size > 1000


def test_a_segmentation_that_was_killed_goes_on_to_the_same_bits(recorded: Path, tmp_path: Path) -> None:
    train = TrainConfig(batch=2, epochs=0.2, precision="float32", save_every=1)
    for folder, stops in (("whole", (None,)), ("pieces", (1, 2, None))):
        for stop in stops:
            stage = SegmentationStage(StageInput(MICRO, train, Dataset(recorded)))
            path = train_stage("segmentation", stage, MICRO, train, tmp_path / folder, stop_at=stop)
    first, second = (read_weights(tmp_path / name / "segmentation.safetensors") for name in ("whole", "pieces"))
    assert path is not None
    assert first.lineage["steps"] >= 3
    assert all(torch.equal(first.tensors[name], second.tensors[name]) for name in first.tensors)


@pytest.mark.parametrize("kind", [SegmentationStage, BrakeStage])
def test_a_dataset_without_tags_gets_one_line(recorded: Path, kind: Any) -> None:
    with pytest.raises(ConfigError, match=r"needs sem_\d.*does not hold"):
        kind(stage_input(_NoTags(recorded)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [("segmentation", SegmentationStage), ("brake", BrakeStage)])
def test_some_frames_are_learnt(recorded: Path, tmp_path: Path, name: str, kind: Any) -> None:
    """The frames of the recorded drives, over and over: classes of nearly all pixels, stops of all frames."""
    train = TrainConfig(batch=8, epochs=150.0, learning_rate=1e-2, precision="float32", average=0.9)
    path = train_stage(name, kind(stage_input(Dataset(recorded), train)), MICRO, train, tmp_path)
    assert path is not None
    measures = read_weights(path).lineage["measures"]
    if name == "segmentation":
        assert measures["iou_road"] > 0.9
        assert measures["iou_mean"] > 0.45  # lines are thinner than pixels at this size
    else:
        assert measures["average_precision"] > 0.98 or not measures["frames_braking"]


def test_losses_of_classes_by_hand() -> None:
    """Two pixels, a walker's and a background's, of which nothing is known; then the truth, told for certain."""
    tags = torch.tensor([[[int(Tag.PEDESTRIAN), int(Tag.SKY)]]])
    crossed, missed = segmentation_losses(torch.zeros(1, 5, 1, 2), tags)
    assert crossed.item() == pytest.approx(np.log(5.0))  # a weighted mean of equal terms
    two, none = (2 * 0.2 + 1) / (0.4 + 1 + 1), 1 / (0.4 + 1)  # dice of classes with a pixel, and without
    assert missed.item() == pytest.approx(1.0 - (2 * two + 3 * none) / 5)
    sure = torch.full((1, 5, 1, 2), -50.0)
    sure[0, 1, 0, 0] = sure[0, 0, 0, 1] = 50.0
    assert [value.item() for value in segmentation_losses(sure, tags)] == pytest.approx([0.0, 0.0], abs=1e-6)
    wrong = torch.zeros(1, 5, 1, 2)
    wrong[0, 3, 0, 0] = 30.0
    crossed, _ = segmentation_losses(wrong, tags)
    walker, background = CLASS_WEIGHTS[1], CLASS_WEIGHTS[0]
    assert crossed.item() == pytest.approx((walker * 30.0 + background * np.log(5.0)) / (walker + background), rel=1e-3)


def test_intersections_over_unions_by_hand() -> None:
    told, truth = torch.tensor([3, 3, 4, 0]), torch.tensor([3, 4, 4, 0])
    found = intersections_over_unions(confusion(told, truth))
    assert found == {"iou_background": 1.0, "iou_road": 0.5, "iou_vehicle": 0.5, "iou_mean": pytest.approx(2 / 3)}


def test_cameras_that_see_walkers_are_drawn_more_often(recorded: Path) -> None:
    data = Dataset(recorded)
    frames = frames_of(data)
    bounds = camera_bounds(data, frames)
    odds = np.diff(np.column_stack([np.zeros(len(frames)), bounds, np.ones(len(frames))]), axis=1)
    assert (odds > 0.0).all()
    for shares, (episode, frame) in zip(odds, frames.tolist(), strict=True):
        tags = data.read(episode, frame, WIDE_TAGS)
        seen = np.array([(tags[name] == Tag.PEDESTRIAN).sum() > 300 for name in WIDE_TAGS])
        none = np.array([not (tags[name] == Tag.PEDESTRIAN).any() for name in WIDE_TAGS])
        if seen.any() and none.any():
            assert shares[seen].min() == pytest.approx(3.0 * shares[none].max())


def test_average_precision_by_hand() -> None:
    truth = np.array([True, False, True, False])
    assert average_precision(np.array([0.9, 0.8, 0.7, 0.1]), truth) == pytest.approx((1.0 + 2 / 3) / 2)
    assert average_precision(np.array([0.9, 0.1, 0.8, 0.2]), truth) == 1.0
    assert average_precision(np.full(4, 0.5), truth) == 0.5, "equal scores are one rank"


def weights(seed: int = 0) -> Weights:
    torch.manual_seed(seed)
    return Weights("segmentation", MICRO, make_segmentation(MICRO.segmentation).state_dict())


def given(root: Path, seed: int = 0) -> StageInput:
    return StageInput(MICRO, TrainConfig(), Dataset(root), None, {"segmentation": weights(seed)})


def test_a_dataset_is_painted_once(recorded: Path, tmp_path: Path) -> None:
    data = Dataset(recorded)
    shares: list[float] = []
    measures = PaintingStage(given(recorded)).run(tmp_path, shares.append)
    assert measures["frames"] == len(data)
    assert shares[-1] == 1.0
    scores = PaintedScores(tmp_path, data).scores(1, 3)
    assert scores.shape == (len(data.read(1, 3, ("lidar",))["lidar"]), 4)
    assert 0.0 < scores.max() <= 1.0
    assert (scores.sum(axis=1) <= 1.01).all()
    first, second = sorted(painted_folder(tmp_path, data).iterdir())
    before, kept = first.read_bytes(), second.stat().st_mtime_ns
    first.unlink()  # as if it had been killed there
    PaintingStage(given(recorded)).run(tmp_path, shares.append)
    assert first.read_bytes() == before
    assert second.stat().st_mtime_ns == kept
    PaintingStage(given(recorded, seed=1)).run(tmp_path, shares.append)
    assert first.read_bytes() != before, "other weights paint anew"


def test_what_was_not_painted_gets_one_line(recorded: Path, tmp_path: Path) -> None:
    data = Dataset(recorded)
    with pytest.raises(DatasetError, match="was not painted"):
        PaintedScores(tmp_path, data)
    folder = painted_folder(tmp_path, data)
    folder.mkdir()
    with pytest.raises(DatasetError, match="missing or damaged"):
        PaintedScores(tmp_path, data).scores(0, 0)
    PaintingStage(given(recorded)).run(tmp_path, lambda share: None)
    (folder / "ep_000000.scores").write_bytes((folder / "ep_000001.scores").read_bytes())
    with pytest.raises(DatasetError, match="painted from other readings"):
        PaintedScores(tmp_path, data).scores(0, 0)


def test_a_parent_that_is_missing_or_of_other_sizes_gets_one_line(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["train", "painting", "--data", str(recorded), "--out", str(tmp_path), "--preset", "micro"]
    assert main(arguments) == 2
    missing = capsys.readouterr().err
    write_weights(
        tmp_path / "segmentation" / "segmentation.safetensors", replace(weights(), config=find_preset("tiny"))
    )
    assert main([*arguments, "--resume"]) == 2
    other = capsys.readouterr().err
    assert "segmentation" in missing
    assert "segmentation" in other
    assert missing.count("\n") == other.count("\n") == 1


GOLDEN = {SegmentationStage: (2.90522, 0.93253), BrakeStage: (1.86890, 3.82712)}  # loss, norm of the gradient
