"""An agent of one's own in thirty lines: it steers by GNSS and compass and keeps a speed; then it is scored."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lavsim.agent import Agent, Track
from lavsim.guidance import Guide
from lavsim.types import Control
from leaderboard.evaluator import EvaluationConfig, evaluate

ROUTES = Path(__file__).with_name("short.xml")


class Straightforward(Agent):
    """Drives towards the next point of its plan at 6 m/s; it sees nobody."""

    def setup(self, path_to_conf_file: str | None) -> None:
        self.track = Track.SENSORS
        self._guide: Guide | None = None

    def sensors(self) -> list[dict[str, Any]]:
        return [
            {"type": "sensor.other.gnss", "id": "gnss"},
            {"type": "sensor.other.imu", "id": "imu"},
            {"type": "sensor.speedometer", "id": "speed"},
        ]

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        if self._guide is None:
            plan = self._global_plan or []
            self._guide = Guide(np.array([[p["lat"], p["lon"]] for p, _ in plan]), [option for _, option in plan])
        self._guide.update(input_data["gnss"][1])
        ahead, right = self._guide.now(float(input_data["imu"][1][-1])).goal
        wanted = 6.0 - float(input_data["speed"][1]["speed"])
        steer = math.atan2(right, max(ahead, 1.0))
        return Control(throttle=max(0.0, 0.3 * wanted), steer=steer, brake=max(0.0, -0.3 * wanted))


def main(arguments: Sequence[str] | None = None) -> int:
    """Scores the agent above on a short route."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/own-agent"))
    parser.add_argument("--routes", default=str(ROUTES))
    parser.add_argument("--route-ids", default="0")
    given = parser.parse_args(arguments)
    config = EvaluationConfig.of(
        agent=f"{Path(__file__).resolve()}:Straightforward", routes=given.routes, route_ids=given.route_ids,
        out=given.out, overwrite=True,
    )  # fmt: skip
    run = evaluate(config)
    print(f"driving score {run.mean['score_composed']:.1f}: {given.out / 'report.html'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
