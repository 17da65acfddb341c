"""Runs beside each other, drive by drive."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.errors import OutputError
from lavsim.random import Draws
from leaderboard.report.compare import bootstrap, compare, smallest_difference
from leaderboard.report.comparison import check_comparable, comparison_page, write_comparison
from leaderboard.run import Run

EVIL = "<script>alert(1)</script>"


def run_of(scores: dict[tuple[str, int], float], folder: str = "a", **entries: Any) -> Run:
    """A run whose drives, by route and repetition, have these driving scores."""
    records, drives = [], []
    for index, ((route, repetition), score) in enumerate(scores.items()):
        parts = {"score_composed": score, "score_route": score, "score_penalty": score / 100.0}
        records.append({"index": index, "route_id": f"R{route}", "status": "Completed", "scores": parts})
        drives.append({"index": index, "route": route, "repetition": repetition, "town": "t", "seed": 7 * repetition})
    results = {"_checkpoint": {"records": records, "global_record": {}, "progress": [0, 0]}, "entry_status": ""}
    run = {"drives": drives, "config": {"agent": f"x:{EVIL}"}, "rules": "1.0", "benchmark_id": "b", **entries}
    return Run(Path(folder), results, run)


def routes(values: list[float]) -> dict[tuple[str, int], float]:
    return {(str(k), 0): value for k, value in enumerate(values)}


def test_only_drives_of_both_runs_are_paired() -> None:
    found = compare(run_of({("0", 0): 50.0, ("0", 1): 60.0, ("1", 0): 70.0}), run_of({("0", 0): 55.0, ("0", 1): 50.0}))
    assert (found.pairs, found.routes, found.unpaired) == (2, 1, 1)
    first = found.differences[0]
    assert (first.base, first.other, first.mean) == (55.0, 52.5, pytest.approx(-2.5))
    assert (first.wins, first.losses) == (1, 1)
    assert first.smallest == math.inf  # one route shows nothing


def test_same_runs_differ_by_nothing() -> None:
    run = run_of(routes([10.0, 50.0, 90.0]))
    first = compare(run, run).differences[0]
    assert (first.mean, first.low, first.high, first.smallest) == (0.0, 0.0, 0.0, 0.0)


def test_clear_difference_is_shown_and_scattered_one_is_not() -> None:
    base = [40.0 + 2.0 * k for k in range(20)]
    clear = compare(run_of(routes(base)), run_of(routes([v + 10.0 + (k % 3) for k, v in enumerate(base)])))
    assert clear.differences[0].low > 9.0
    assert clear.differences[0].high < 13.0
    noisy = compare(run_of(routes(base)), run_of(routes([v + (30.0 if k % 2 else -28.0) for k, v in enumerate(base)])))
    assert noisy.differences[0].low < 0.0 < noisy.differences[0].high
    assert noisy.differences[0].smallest > 15.0


def test_bootstrap_repeats_and_agrees_with_theory() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, 60)
    draws = Draws.of_seed(0).stream("bootstrap")
    low, high = bootstrap(values, draws)
    assert (low, high) == bootstrap(values, draws)
    error = values.std(ddof=1) / math.sqrt(60)
    assert (low, high) == pytest.approx((values.mean() - 1.96 * error, values.mean() + 1.96 * error), abs=0.08)
    assert smallest_difference(values) == pytest.approx(2.8 * error, rel=0.05)


def test_page_says_what_is_shown_and_escapes_names(tmp_path: Path) -> None:
    base, other = run_of(routes([40.0, 50.0, 60.0, 70.0])), run_of(routes([60.0, 71.0, 79.0, 90.0]), "b")
    text = comparison_page([base, other, run_of({}, "c")])
    assert "<script" not in text
    assert "scores higher: +20.0 points" in text
    assert "No drive of one has a partner in the other." in text
    assert text.count("<circle") == 4
    path = write_comparison([base, other], tmp_path / "c.html")
    assert path.read_text() == comparison_page([base, other])


def test_other_benchmarks_are_refused() -> None:
    run = run_of(routes([1.0]))
    check_comparable([run, run])
    with pytest.raises(OutputError, match="was driven under benchmark other"):
        check_comparable([run, replace(run, run={**run.run, "benchmark_id": "other"})])
