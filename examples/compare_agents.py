"""Compares two agents drive by drive, on the same routes, seeds and traffic, with an interval for the difference."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from leaderboard.evaluator import EvaluationConfig, evaluate
from leaderboard.report.compare import compare
from leaderboard.report.comparison import check_comparable, write_comparison

ROUTES = Path(__file__).with_name("short.xml")


def main(arguments: Sequence[str] | None = None) -> int:
    """Drives both and says whether the second is better."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/compare"))
    parser.add_argument("--routes", default=str(ROUTES))
    parser.add_argument("--agents", nargs=2, default=["agents.idle:IdleAgent", "agents.baselines.constant_speed"])
    parser.add_argument("--repetitions", type=int, default=1)
    given = parser.parse_args(arguments)
    common = {"routes": given.routes, "repetitions": given.repetitions, "rules": "bench2drive", "overwrite": True}
    runs = [
        evaluate(EvaluationConfig.of(agent=agent, out=given.out / name, **common))
        for name, agent in zip(("first", "second"), given.agents, strict=True)
    ]
    check_comparable(runs)
    for found in compare(*runs).differences:
        print(f"{found.metric}: {found.base:.3g} and {found.other:.3g}, by {found.low:.3g} to {found.high:.3g}")
    print(write_comparison(runs, given.out / "comparison.html"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
