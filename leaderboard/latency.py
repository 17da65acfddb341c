"""Agents that are late: a control acts some ticks after the readings it was decided on, so that slow agents pay.

The delay is a number of ticks fixed before the drive: stated as such, as a time, or as the step time that an earlier
run measured. So a drive with latency repeats as any other.
"""

from __future__ import annotations

import math
import time as clock
from collections import deque
from pathlib import Path

import numpy as np

from lavsim.agent import AgentHandle, AgentShell, Readings
from lavsim.errors import ConfigError, OutputError
from lavsim.types import DT, Control
from leaderboard.run import Run

LONGEST = 100  # ticks


def latency_ticks(text: str) -> int:
    """How many ticks late controls act: "3" ticks, "0.12s", or as long as a step took in the run in a folder.

    Raises:
        ConfigError: neither of these, or more than 5 s.
        OutputError: the run has no measured step.
    """
    if text.isdigit():
        ticks = int(text)
    elif text.endswith("s") and _is_number(text[:-1]):
        ticks = _ticks(float(text[:-1]))
    elif text and Path(text).is_dir():
        ticks = _ticks(_measured(Path(text)))
    else:
        raise ConfigError(f"latency must be ticks ('3'), a time ('0.12s') or the folder of a run, got {text!r}")
    if ticks > LONGEST:
        raise ConfigError(f"latency may be {LONGEST} ticks (5 s) at most, got {text!r}: {ticks} ticks")
    return ticks


def _is_number(text: str) -> bool:
    try:
        return float(text) >= 0.0 and math.isfinite(float(text))
    except ValueError:
        return False


def _ticks(seconds: float) -> int:
    """Whole ticks that a step of `seconds` takes up; what is done within the tick it began in is not late."""
    return math.floor(seconds / DT + 1e-9)


def _measured(folder: Path) -> float:
    """Median step time of the drives of a run [s]."""
    steps = [drive["step_ms"]["median"] for drive in Run.load(folder).run["drives"] if drive.get("step_ms")]
    if not steps:
        raise OutputError(f"the run in {folder} has no drive in which the agent made a step")
    return float(np.median(steps)) / 1e3


class PacedAgent(AgentShell):
    """An agent whose steps are timed and whose controls act `ticks` ticks late; until the first it stands braked."""

    def __init__(self, agent: AgentHandle, ticks: int = 0) -> None:
        super().__init__(agent)
        self._times: list[float] = []
        self._under_way = deque([Control(brake=1.0)] * ticks)

    def step(self, readings: Readings, time: float) -> Control:
        begun = clock.perf_counter()
        self._under_way.append(self._agent.step(readings, time))
        self._times.append(clock.perf_counter() - begun)
        return self._under_way.popleft()

    def step_ms(self) -> dict[str, float] | None:
        """Wall-clock time of a step, its way to the agent's process included [ms]; None before the first."""
        if not self._times:
            return None
        median, slow = np.percentile(self._times, [50.0, 95.0]) * 1e3
        mean = float(np.mean(self._times)) * 1e3
        return {"mean": round(mean, 3), "median": round(float(median), 3), "p95": round(float(slow), 3)}
