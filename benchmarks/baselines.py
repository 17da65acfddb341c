"""Scores of the baselines on the bundled route files: the table of `docs/scoring.md`.

`python benchmarks/baselines.py --out runs/baselines` drives what is not driven yet (a run cut short goes on) and prints
the table; `--files` and `--agents` choose some of each, `--every 3` every third route of a file, `--workers` drives
several routes at a time. All of it takes an hour or two of a core.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lavsim.errors import OutputError
from leaderboard.config import EvaluationConfig
from leaderboard.evaluator import Progress, evaluate
from leaderboard.routes import read_routes
from leaderboard.run import Run
from leaderboard.table import short_name

FILES = ("quick", "devtest", "validation", "training", "hazards")
AGENTS = {
    "random": "agents.baselines.random_agent",
    "constant_speed": "agents.baselines.constant_speed",
    "blind": "agents.baselines.blind",
    "pure_pursuit": "agents.baselines.pure_pursuit",
    "npc": "agents.baselines.npc",
}


def drive(agent: str, routes: str, out: Path, workers: int, seed: int, every: int = 1) -> Run:
    """The run of one agent on one route file, driven or gone on with where it is not whole."""
    ids = ",".join(entry.id for entry in read_routes(routes)[::every]) if every > 1 else None
    config = EvaluationConfig.of(
        agent=AGENTS.get(agent, agent),
        routes=routes,
        route_ids=ids,
        out=out,
        seed=seed,
        workers=workers,
        resume=True,
        pictures=False,
    )
    told: list[int] = [-1]

    def tell(progress: Progress) -> None:
        if progress.done > told[0]:
            told[0] = progress.done
            print(f"{agent} {routes} {progress.done}/{progress.total}", flush=True)

    return evaluate(config, tell)


def whole(folder: Path) -> Run | None:
    """The run in `folder`, if it is there and has all its drives."""
    try:
        run = Run.load(folder)
    except OutputError:
        return None
    done, total = run.results["_checkpoint"]["progress"]
    return run if done == total and run.mean else None


def row(name: str, run: Run) -> str:
    """A line of the table: means, routes completed, and the commonest infractions per km driven."""
    mean, records = run.mean, run.records
    completed = sum(record["status"] in ("Completed", "Perfect") for record in records)
    rates: dict[str, Any] = run.run["infractions_per_km"]
    worst = sorted((rate, key) for key, rate in rates.items() if rate > 0.0)[::-1][:4]
    told = ", ".join(f"{short_name(key)} {rate:.2f}" for rate, key in worst) or "none"
    return (
        f"| {name} | {mean['score_composed']:.1f} | {mean['score_route']:.1f} | {mean['score_penalty']:.3f} | "
        f"{completed}/{len(records)} | {told} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/baselines"))
    parser.add_argument("--files", default=",".join(FILES))
    parser.add_argument("--agents", default=",".join(AGENTS), help="names of the table, or any agent")
    parser.add_argument("--every", type=int, default=1, help="3: every third route of each file")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--print", action="store_true", help="drive nothing, print what there is")
    arguments = parser.parse_args()
    for routes in arguments.files.split(","):
        rows = []
        for agent in arguments.agents.split(","):
            share = f"_every{arguments.every}" if arguments.every > 1 else ""
            folder = arguments.out / f"{Path(routes).stem}{share}_{agent.replace(':', '_')}"
            run = whole(folder)
            if run is None and not arguments.print:
                run = drive(agent, routes, folder, arguments.workers, arguments.seed, arguments.every)
            rows += [row(agent, run)] if run is not None else []
        if rows:
            print(f"\n`{routes}`\n")
            print("| agent | driving score | completion % | penalty | completed | infractions per km |")
            print("|---|---|---|---|---|---|")
            print("\n".join(rows), flush=True)


if __name__ == "__main__":
    main()
