"""The tracked record: what counts as a fall, what its lines hold, and this checkout against its newest line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.record import Figure, Line, bench_figures, draw, falls, machine, measure, ratio, read, score_of
from leaderboard.config import EvaluationConfig
from leaderboard.evaluator import evaluate
from tests.leaderboard.runs import make_run

TRIES = 3  # a machine that is busy only slows down


def line(ticks: float = 10.0, score: float = 90.0, noise: float = 0.1, **changes: object) -> Line:
    made = Line(
        "abc", "2026-01-01T00:00:00+00:00", "1.0", "a test", "this", 15.0,
        {"world_ticks_per_s": Figure(ticks, noise)}, {"expert quick": Figure(score, 2.0, 8)},
    )  # fmt: skip
    return replace(made, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (line(), []),
        (line(ticks=9.01), []),
        (line(ticks=8.9), ["world_ticks_per_s: -11%"]),
        (line(ticks=8.9, machine="another"), []),
        (line(ticks=8.9, accepted=("world_ticks_per_s",)), []),
        (line(score=88.1), []),
        (line(score=87.9), ["expert quick: 90.0 to 87.9"]),
        (line(score=10.0, scores={}), []),
        (line(ticks=20.0, score=100.0), []),
    ],
)
def test_only_a_fall_by_more_than_the_noise_counts(after: Line, said: list[str]) -> None:
    found = falls(line(), after)
    assert len(found) == len(said)
    assert all(text.startswith(start) for text, start in zip(found, said, strict=True))


def test_ratios_do_not_depend_on_the_machine_s_pace_and_more_is_better() -> None:
    for name, quick, slow, better in (("world_ticks_per_s", 4000.0, 2000.0, 5000.0), ("lidar_ms", 0.5, 1.0, 0.4)):
        assert ratio(name, quick, 0.01) == pytest.approx(ratio(name, slow, 0.02))
        assert ratio(name, better, 0.01) > ratio(name, quick, 0.01)
    assert ratio("peak_rss_mb", 500.0, 0.01) == ratio("peak_rss_mb", 500.0, 0.02) == 2.0


def test_noise_is_that_of_the_repeats_and_never_none() -> None:
    found = bench_figures([{"a": 10.0, "b": 1.0}, {"a": 11.0, "b": 1.0}, {"a": 10.5, "b": 1.0}])
    assert found["a"] == Figure(10.5, 0.143)
    assert found["b"] == Figure(1.0, 0.05)


def test_score_of_runs_is_over_all_their_drives(tmp_path: Path) -> None:
    runs = [make_run(tmp_path / name).folder for name in ("a", "b")]
    found = score_of(runs)
    assert found.drives == 6
    assert found.noise > 10.0
    assert 0.0 < found.value < 100.0


def test_lines_come_back_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    path.write_text("".join(made.text() + "\n" for made in (line(), line(accepted=("x",)))), encoding="utf-8")
    assert read(path) == [line(), line(accepted=("x",))]
    draw(read(path), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_nothing_fell_from_line_to_line_of_the_record() -> None:
    lines = read()
    assert lines
    dates = [each.date for each in lines]
    assert dates == sorted(dates)
    for index, after in enumerate(lines):
        for name in (*after.bench, *after.scores):  # against the last line that has it
            before = next((each for each in lines[:index][::-1] if name in each.bench | each.scores), None)
            assert before is None or not [text for text in falls(before, after) if text.startswith(f"{name}:")]


@pytest.mark.slow
def test_this_checkout_is_no_slower_than_the_record() -> None:
    before = next((each for each in read()[::-1] if each.bench and each.machine == machine()), None)
    if before is None:
        pytest.skip(f"the record has no bench of this processor, {machine()}")
    fallen: set[str] = set(before.bench)
    told = ""
    for _ in range(TRIES):
        found = falls(before, replace(before, bench=measure(1)[1], scores={}))
        fallen &= {text.partition(":")[0] for text in found}
        told = "\n".join(found)
        if not fallen:
            return
    pytest.fail(f"slower than at {before.commit} in each of {TRIES} tries:\n{told}")


@pytest.mark.slow
def test_expert_scores_no_less_than_the_record(tmp_path: Path) -> None:
    before = next((each for each in read()[::-1] if "expert quick" in each.scores), None)
    if before is None:
        pytest.skip("the record has no score of the expert on quick")
    config = EvaluationConfig.of(agent="agents.behavior:BehaviorAgent", routes="quick", out=tmp_path, pictures=False)
    evaluate(config, lambda progress: None)
    found = {"expert quick": score_of([tmp_path])}
    assert not falls(before, replace(before, bench={}, scores=found))
