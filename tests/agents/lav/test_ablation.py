"""Ablations: what is trained for which row, and the tables beside the paper's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.ablation import FULL, Scores, shipped_eyes, table_text, tables_of, trainings_of
from agents.lav.train import TrainTask, needed, settings_of
from agents.lav.variants import VARIANTS
from lavsim.cli import main
from lavsim.commands import ablate
from lavsim.errors import ConfigError, UnknownName
from leaderboard.run import Run

TASK = TrainTask("all", Path("data"), Path("out"), "micro", sets=("train.epochs=2",))


def run_of(folder: Path, scores: list[float], seed: int) -> Run:
    """A run as it lies on disk, but for what tables do not read."""
    records: list[dict[str, Any]] = []
    for index, score in enumerate(scores):
        found = {"score_composed": score, "score_route": 100.0, "score_penalty": score / 100.0}
        records.append({"index": index, "route_id": str(index), "scores": found})
    drives = [{"index": k, "town": "t", "route": k, "repetition": 0, "seed": seed} for k in range(len(scores))]
    return Run(folder, {"_checkpoint": {"records": records}}, {"drives": drives})


def test_tables_are_the_paper_s() -> None:
    found = tables_of([])
    assert list(found) == ["components", "radius", "perception", "refinement"]
    assert sorted(name for rows in found.values() for name in rows) == sorted(VARIANTS)
    assert tables_of(["radius"]) == {"radius": ["radius-5", "radius-15", "radius-25"]}
    assert tables_of([], ["full", "radius-5"]) == {"components": ["full"], "radius": ["radius-5"]}
    with pytest.raises(UnknownName, match="no variant 'radius-6'"):
        tables_of([], ["radius-6"])
    with pytest.raises(UnknownName, match="no table 'radios'"):
        tables_of(["radios"])


def test_rows_that_change_nothing_are_trained_once_and_share_their_seed() -> None:
    trainings, stands_for = trainings_of(tables_of(["refinement"])["refinement"], 2, TASK)
    assert stands_for == {"full": "full", "refinements-0": "refinements-0", "refinements-1": "refinements-1",
                          "refinements-5": "refinements-5"}, "micro has two refinements"  # fmt: skip
    tiny, stands_for = trainings_of(list(VARIANTS), 1, replace(TASK, preset="tiny"))
    assert {name for name, other in stands_for.items() if other == FULL} == {
        "full", "radius-15", "perception-staged", "refinements-5"
    }  # fmt: skip
    assert len(tiny) == len(VARIANTS) - 3
    assert [training.variant for training in trainings[:3]] == ["full", "full", "refinements-0"]
    other = next(training for training in trainings if training.variant == "refinements-1" and training.seed == 1)
    assert other.task.shared == [Path("out/full/seed1")]
    assert other.task.out == Path("out/refinements-1/seed1")
    assert settings_of(other.task).lav.motion.refinements == 1
    assert settings_of(other.task, "bev").train.seed == 1


def test_eyes_that_ship_are_no_training_s(tmp_path: Path) -> None:
    eyes = shipped_eyes(tmp_path / "shipped", "tiny")
    trainings, _ = trainings_of(["ego-only"], 1, replace(TASK, preset="tiny", out=tmp_path, shared=[eyes]))
    assert [list(training.task.shared) for training in trainings] == [[eyes], [tmp_path / "full" / "seed0", eyes]]
    for training in trainings:
        assert "approaches" not in needed(training.task)
        assert {"segmentation", "brake", "full"} <= set(needed(training.task))
    with pytest.raises(ConfigError, match=r"no weights at .*segmentation-micro"):
        shipped_eyes(tmp_path / "shipped", "micro")


def test_a_table_says_ours_beside_the_paper_s() -> None:
    rows = {"refinements-5": Scores([60.0, 70.0], [95.0, 97.0]),
            "refinements-0": Scores([30.0, 34.0], [50.0, 52.0], -33.0, -40.0, -26.0, 9.5)}  # fmt: skip
    lines = table_text("refinement", rows).splitlines()
    assert lines[4] == "| K = 5 | 65.00 ± 7.07 | 96.00 ± 1.41 |  | - | 45.20 | 91.55 |"
    assert lines[5] == "| K = 0 | 32.00 ± 2.83 | 51.00 ± 1.41 | 33.0 (26.0 to 40.0) | 9.5 | 12.69 | 35.85 |"


def test_drives_are_paired_by_route_and_seed(tmp_path: Path) -> None:
    base = [run_of(tmp_path, [80.0, 60.0, 70.0], seed) for seed in (0, 1)]
    worse = [run_of(tmp_path, [70.0, 52.0, 58.0], seed) for seed in (0, 1)]
    found = ablate._scores(base, worse)
    assert found.difference == pytest.approx(-10.0)
    assert found.low <= -10.0 <= found.high < 0.0
    assert found.score == [pytest.approx(60.0)] * 2
    assert 0.0 < found.smallest < 20.0


def test_it_trains_and_drives_what_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    shared: list[str] = []
    done: list[str] = []

    def pretend(training: Any, routes: str = "", ids: str | None = None) -> Any:
        (done if routes else shared).append(f"{training.variant} {training.seed}")
        return training

    monkeypatch.setattr(ablate, "_train_shared", pretend)
    monkeypatch.setattr(ablate, "_train_and_drive", pretend)
    monkeypatch.setattr(Run, "load", lambda folder: run_of(folder, [50.0, 60.0], int(folder.parent.name[4:])))
    asked = ["--data", str(tmp_path), "--out", str(tmp_path), "--table", "refinement", "--seeds", "2"]
    assert main(["ablate", *asked]) == 0
    assert shared == ["full 0", "full 1"]
    assert done == [f"{name} {seed}" for name in ("full", "refinements-0", "refinements-1") for seed in (0, 1)]
    assert "| K = 5 | 55.00 ± 0.00 |" in (tmp_path / "ablations.md").read_text()
    assert main(["ablate", *asked[:4], "--table", "refinements"]) == 2
    assert "no table 'refinements'. Did you mean 'refinement'?" in capsys.readouterr().err
