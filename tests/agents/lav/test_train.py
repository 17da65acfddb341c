"""`lavsim train`: which stages, and one line for what does not fit."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.config import find_preset
from agents.lav.stages.base import STAGES
from agents.lav.train import stages_of
from lavsim.cli import main


def test_parents_come_first() -> None:
    order = stages_of("all", find_preset("tiny"))
    assert sorted(order) == sorted(str(name) for name in STAGES if STAGES[name].is_lav)
    for name in order:
        assert all(order.index(parent) < order.index(name) for parent in STAGES[name].parents)
    assert stages_of("bev") == ["bev"]
    assert stages_of("cloning") == ["cloning"]
    assert "cloning" not in order, "a baseline is no part of LAV"
    assert "approaches" not in stages_of("all"), "the paper's brake network learns from what was recorded"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bevv"], "no stage 'bevv'. Did you mean 'bev'?"),
        (["bev", "--preset", "tny"], "no preset 'tny'. Did you mean 'tiny'?"),
        (["bev", "--set", "train.epoch=3"], "unknown key 'train.epoch'. Did you mean 'epochs'?"),
        (["bev", "--set", "lav.grid.cell=-1"], "lav.grid.cell: Input should be greater than 0"),
        (["bev"], "is no dataset"),
    ],
)
def test_mistakes_get_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["train", *arguments, "--data", str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_folder_with_a_training_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bev").mkdir()
    assert main(["train", "bev", "--data", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "--resume goes on with it" in capsys.readouterr().err
