# ruff: noqa: E402 - torch comes first
"""Segmentation, brake and painting on a recorded drive: one step of each, losses by hand, some frames learnt."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import find_preset
from agents.lav.models.segmentation import make_segmentation
from agents.lav.painted import PaintedScores, painted_folder
from agents.lav.stages.base import StageInput, TrainConfig
from agents.lav.stages.painting import PaintingStage
from agents.lav.weights import Weights
from lavsim.dataset.reader import Dataset
from lavsim.errors import DatasetError

MICRO = find_preset("micro")


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
