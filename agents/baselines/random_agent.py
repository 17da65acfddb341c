"""Presses pedals and turns the wheel at random: the floor of every table but the idle agent's."""

from __future__ import annotations

import math
from typing import Any

from lavsim.agent import Agent, Track
from lavsim.random import Draws
from lavsim.types import Control

HOLD = 10  # ticks a draw holds: half a second


def get_entry_point() -> str:
    """The class the leaderboard runs."""
    return "RandomAgent"


class RandomAgent(Agent):
    """Draws throttle, brake and steering anew every half second; the configuration is its seed."""

    def setup(self, path_to_conf_file: str | None) -> None:
        self.track = Track.SENSORS
        self._draws = Draws.of_seed(int(path_to_conf_file or 0)).stream("random agent")

    def sensors(self) -> list[dict[str, Any]]:
        return [{"type": "sensor.speedometer", "id": "speed"}]

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        unit = self._draws.uniform(math.floor(timestamp / (0.05 * HOLD) + 1e-6), 3)
        brakes = unit[0] < 0.2
        return Control(
            throttle=0.0 if brakes else 0.3 + 0.5 * float(unit[1]),
            steer=0.6 * float(2.0 * unit[2] - 1.0) ** 3,
            brake=0.5 if brakes else 0.0,
        )
