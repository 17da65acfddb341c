"""A live drive small enough for tests: the long street of `eu_small_a`, with some traffic."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lavsim.drawings import Drawing, polylines, scalar
from lavsim.live.drivers import Driver, KeyboardDriver
from lavsim.live.session import Session
from lavsim.simulation import Simulation
from lavsim.types import Control
from tests.drives import follow, straight_drive


class RouteDriver:
    """Keeps to the route, ignores everybody, shows a plan."""

    name = "blind"

    def start(self, simulation: Simulation) -> None:
        self.starts = getattr(self, "starts", 0) + 1

    def control(self, simulation: Simulation) -> Control:
        return follow(simulation.route, simulation.snapshot)

    def drawings(self) -> dict[str, Drawing]:
        return {"plan": polylines([[[0.0, 0.0], [20.0, 0.0]]], frame="ego"), "wanted speed": scalar(8.0, "m/s")}

    def sensors(self) -> list[dict[str, Any]]:
        return []

    def close(self) -> None:
        self.is_closed = True


def session(folder: Path, driver: Driver | None = None, **changes: Any) -> Session:
    """A session of a straight drive with a few others, paused at its first tick."""
    spec = straight_drive(**{"traffic": "leaderboard", "vehicles": 12, "walkers": 4, "parked": 0.3, **changes})
    return Session(spec, driver or KeyboardDriver(), folder)
