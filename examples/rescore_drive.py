"""Judges a recorded drive again by other rules: nothing is driven a second time."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from leaderboard.evaluator import EvaluationConfig, evaluate
from leaderboard.rescore import rescore
from leaderboard.run import Run

ROUTES = Path(__file__).with_name("short.xml")


def main(arguments: Sequence[str] | None = None) -> int:
    """Drives once, or takes the run at --run, and prints its score under each rule set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/rescore"))
    parser.add_argument("--run", type=Path, help="folder of a run of `lavsim score`; driven here otherwise")
    parser.add_argument("--rules", nargs="+", default=["2.1", "corrected"])
    given = parser.parse_args(arguments)
    if given.run is not None:
        run = Run.load(given.run)
    else:
        agent = "agents.baselines.constant_speed:ConstantSpeed"
        config = EvaluationConfig.of(
            agent=agent, routes=str(ROUTES), route_ids="0", out=given.out / "driven", overwrite=True
        )
        run = evaluate(config)
    print(f"rules {run.run['rules']}: {run.mean['score_composed']:.1f}")
    for rules in given.rules:
        again = rescore(run.folder, rules, given.out / f"rules-{rules}", overwrite=True)
        print(f"rules {rules}: {again.mean['score_composed']:.1f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
