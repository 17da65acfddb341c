"""A dataset on a Ray cluster; without Ray on this machine's processes. Its bytes are the same either way."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from lavsim.dataset.collect import collect
from lavsim.dataset.plan import CollectPlan
from lavsim.errors import ConfigError
from lavsim.executor import make_executor


def main(arguments: Sequence[str] | None = None) -> int:
    """Collects logs; `lavsim render` makes sensor readings of them anywhere."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/on-ray"))
    parser.add_argument("--address", default="local", help="of the cluster; 'local' starts one here")
    parser.add_argument("--frames", type=int, default=16)
    parser.add_argument("--workers", type=int, default=1, help="processes where there is no Ray")
    given = parser.parse_args(arguments)
    plan = CollectPlan(
        towns=("eu_small_a",), frames=given.frames, seed=2, vehicles=(4, 8), walkers=(0, 2), episode_frames=16,
        length=(150.0, 300.0), log_only=True,
    )  # fmt: skip
    cluster: str | None = given.address
    try:
        make_executor(cluster=cluster)
    except ConfigError as error:
        print(f"{error} Going on with {given.workers} process(es) here.")
        cluster = None
    made = collect(plan, given.out, workers=given.workers, cluster=cluster, overwrite=True)
    print(f"{made.frames} frames in {len(made.records)} episodes, {made.bytes} bytes: {given.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
