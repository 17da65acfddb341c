"""Recorded drives judged again."""

from __future__ import annotations

from pathlib import Path

import pytest

from lavsim.errors import OutputError, UnknownName
from leaderboard.evaluator import evaluate
from leaderboard.rescore import rescore
from leaderboard.run import Run
from tests.leaderboard.test_evaluator import config, statuses, steady


def scored(run: Run) -> list[dict[str, object]]:
    return [{key: value for key, value in record.items() if key != "meta"} for record in run.records]


def test_the_same_rules_give_the_same_records(tmp_path: Path) -> None:
    first = evaluate(config(tmp_path, "go raise exit no-setup"))
    again = rescore(first.folder, "1.0")
    assert again.records == first.records
    assert again.total == first.total
    assert again.results["sensors"] == first.results["sensors"]
    assert again.folder == first.folder / "rescored-1.0"
    assert (again.folder / again.run["drives"][0]["log"]).is_file()


@pytest.mark.parametrize("version", ["2.0", "2.1", "bench2drive"])
def test_other_rules_judge_as_a_drive_under_them(tmp_path: Path, version: str) -> None:
    first = evaluate(steady(tmp_path, 2))
    driven = evaluate(steady(tmp_path, 2, out=tmp_path / "driven", rules=version))
    judged = rescore(first.folder, version)
    assert statuses(judged) == statuses(driven) == ["Perfect", "Perfect"]
    assert [r["scores"] for r in judged.records] == [r["scores"] for r in driven.records]
    assert [r["route_id"] for r in judged.records] == ["RouteScenario_0_rep0", "RouteScenario_1_rep0"]


def test_a_run_cut_short_is_not_judged(tmp_path: Path) -> None:
    def stop(progress: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(steady(tmp_path, 2), stop)
    with pytest.raises(OutputError, match="0 of 2 drives: finish it with --resume"):
        rescore(tmp_path / "out", "2.1")


def test_unknown_rules_and_occupied_folders_are_refused(tmp_path: Path) -> None:
    run = evaluate(steady(tmp_path, 1))
    with pytest.raises(UnknownName, match=r"2\.1"):
        rescore(run.folder, "2.2")
    rescore(run.folder, "2.1")
    with pytest.raises(OutputError, match="already holds a run"):
        rescore(run.folder, "2.1")
    assert statuses(rescore(run.folder, "2.1", overwrite=True)) == ["Perfect"]
