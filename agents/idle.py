"""An agent that does nothing: the lower bound of every table, and the test of the blocked rule."""

from __future__ import annotations

from typing import Any

from lavsim.agent import Agent, Track
from lavsim.types import Control


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "IdleAgent"


class IdleAgent(Agent):
    """Stands on the brake."""

    def setup(self, path_to_conf_file: str | None) -> None:
        self.track = Track.SENSORS

    def sensors(self) -> list[dict[str, Any]]:
        return [{"type": "sensor.speedometer", "id": "speed"}]

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        return Control(brake=1.0)
