"""`--strict-compat`: the originals' bookkeeping defects, each with it and without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lavsim.errors import ConfigError
from leaderboard.criteria.base import Infraction
from leaderboard.evaluator import Progress, evaluate
from leaderboard.merge import merge
from leaderboard.rules import RULES, Rules
from leaderboard.run import Run
from leaderboard.score import OUTSIDE, RouteRecord, record_of, summarise
from tests.leaderboard.test_evaluator import same, steady
from tests.leaderboard.test_score import record
from tests.leaderboard.worlds import V1, V20


def completed(rules: Rules, count: int = 2) -> list[RouteRecord]:
    return [record((1000, 100, "", None), rules, index) for index in range(count)]


def test_records_read_back_are_failed_in_1_0_by_identity() -> None:
    first, second = completed(V1)
    mixed = [replace(first, read_back=True), second]
    strict = summarise(mixed, 2, V1, strict=True)
    assert strict.status == "Failed"
    assert strict.exceptions == (("RouteScenario_0", 0, "Completed"),)
    plain = summarise(mixed, 2, V1)
    assert (plain.status, plain.exceptions) == ("Completed", ())
    assert strict.mean == plain.mean
    assert strict.rates == plain.rates


def test_nothing_is_failed_by_identity_in_one_process_or_in_2_x() -> None:
    assert summarise(completed(V1), 2, V1, strict=True).status == "Completed"
    back = [replace(r, read_back=True) for r in completed(V20)]
    assert summarise(back, 2, V20, strict=True).status == "Perfect"


def off_road(rules: Rules, metres: float) -> RouteRecord:
    text = f"Agent went outside its route lanes for about {round(metres, 3)} meters (1.0% of the completed route)"
    return record_of(
        index=0,
        route_id="RouteScenario_0_rep0",
        completion=100.0,
        reached=True,
        infractions=[Infraction(OUTSIDE, 0, (0.0, 0.0, 0.0), text, value=1.0, metres=metres)],
        failure=None,
        route_length=1000.0,
        duration_game=10.0,
        duration_system=1.0,
        rules=rules,
    )


def test_metres_off_the_road_are_read_from_their_text() -> None:
    """Rounded twice: 0.4996 m is 0.5 m in the text, which 2.x then shows as a metre, and we as none."""
    made = off_road(V20, 0.4996)
    assert summarise([made], 1, V20, strict=True).rates[OUTSIDE] == 0.001
    assert summarise([made], 1, V20).rates[OUTSIDE] == 0.0
    far = off_road(V20, 96.0)
    assert summarise([far], 1, V20, strict=True).rates[OUTSIDE] == summarise([far], 1, V20).rates[OUTSIDE] == 0.096


def test_a_resumed_run_of_1_0_lists_what_it_read_back(tmp_path: Path) -> None:
    def stop(progress: Progress) -> None:
        if progress.done == 1 and progress.completion > 20.0:
            raise KeyboardInterrupt

    whole = evaluate(steady(tmp_path, 2, strict_compat=True))
    with pytest.raises(KeyboardInterrupt):
        evaluate(steady(tmp_path, 2, out=tmp_path / "cut", strict_compat=True), stop)
    resumed = evaluate(steady(tmp_path, 2, out=tmp_path / "cut", resume=True, strict_compat=True))
    assert whole.total["status"] == "Completed"
    assert resumed.total["status"] == "Failed"
    assert resumed.total["meta"]["exceptions"] == [["RouteScenario_0", 0, "Completed"]]
    assert resumed.records[0]["scores"] == whole.records[0]["scores"]
    assert not same(whole, resumed)


def test_a_merged_run_of_1_0_lists_all(tmp_path: Path) -> None:
    run = evaluate(steady(tmp_path, 2))
    assert merge([run.folder], tmp_path / "plain").summary().status == "Completed"
    merge([run.folder], tmp_path / "strict", strict=True)
    total = Run.load(tmp_path / "strict").total
    assert total["status"] == "Failed"
    assert len(total["meta"]["exceptions"]) == 2


def test_strict_and_corrected_contradict(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="give one of them"):
        steady(tmp_path, 1, strict_compat=True, rules="corrected")


def test_only_1_0_itself_has_the_defect() -> None:
    back = [replace(r, read_back=True) for r in completed(RULES["corrected"])]
    assert summarise(back, 2, RULES["corrected"], strict=True).status == "Completed"
