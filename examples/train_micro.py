"""Trains LAV's privileged teacher at its smallest size, `micro`, on a handful of frames: the whole way in seconds."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from lavsim.dataset.collect import collect
from lavsim.dataset.plan import CollectPlan


def main(arguments: Sequence[str] | None = None) -> int:
    """Collects a little data and trains on it. It shows that the parts fit; nothing is learnt from so little."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/train-micro"))
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--epochs", type=float, default=2.0)
    given = parser.parse_args(arguments)
    try:
        from agents.lav.train import TrainTask, train
    except ImportError as error:
        print(f"training needs {error.name}: pip install 'lavsim[lav]'")
        return 2
    data = given.out / "data"
    plan = CollectPlan(
        towns=("eu_small_a",), frames=given.frames, seed=2, vehicles=(10, 20), walkers=(0, 2), episode_frames=48,
        length=(150.0, 400.0),
    )  # fmt: skip
    collect(plan, data, overwrite=True)
    sets = (f"train.epochs={given.epochs}", "train.batch=8")
    folder = given.out / "weights"
    measures = train(
        TrainTask("bev", data, folder, preset="micro", sets=sets, resume=(folder / "bev").exists()),
        lambda stage, pace: print(f"{stage}: step {pace.step} of {pace.steps}") if pace.step == pace.steps else None,
    )
    print({name: round(value, 3) for name, value in measures["bev"].items()})
    print(folder / "bev" / "bev.safetensors")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
