"""Controls that act late."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lavsim.errors import ConfigError, OutputError
from lavsim.log.reader import LogReader
from lavsim.types import Control
from leaderboard.evaluator import evaluate
from leaderboard.latency import PacedAgent, latency_ticks
from leaderboard.record import RUN
from tests.leaderboard.runs import make_run
from tests.leaderboard.test_evaluator import same, statuses, steady


def test_latency_is_what_an_earlier_run_measured(tmp_path: Path) -> None:
    """The median over drives of the median step; a drive whose agent made no step says nothing."""
    run = make_run(tmp_path)
    told = json.loads((run.folder / RUN).read_text())
    for median, drive in zip((60.0, 340.0, 120.0), told["drives"], strict=True):
        drive["step_ms"] = {"median": median, "p95": 999.0}
    (run.folder / RUN).write_text(json.dumps(told))
    assert latency_ticks(str(run.folder)) == 2
    told["drives"][1]["step_ms"] = None
    told["drives"][0]["step_ms"]["median"] = 190.0
    (run.folder / RUN).write_text(json.dumps(told))
    assert latency_ticks(str(run.folder)) == 3
    told["drives"] = [{**drive, "step_ms": None} for drive in told["drives"]]
    (run.folder / RUN).write_text(json.dumps(told))
    with pytest.raises(OutputError, match="no drive in which the agent made a step"):
        latency_ticks(str(run.folder))


class Counter:
    """Its n-th control has throttle n / 100."""

    def __init__(self) -> None:
        self.steps = 0

    def step(self, readings: object, time: float) -> Control:
        self.steps += 1
        return Control(throttle=self.steps / 100.0)


@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_a_control_acts_so_many_ticks_late(ticks: int) -> None:
    agent = PacedAgent(Counter(), ticks)  # type: ignore[arg-type]
    given = [agent.step({}, 0.05 * k) for k in range(6)]
    assert given[:ticks] == [Control(brake=1.0)] * ticks
    assert [control.throttle for control in given[ticks:]] == [k / 100.0 for k in range(1, 7 - ticks)]
    times = agent.step_ms()
    assert times is not None
    assert 0.0 <= times["median"] <= times["p95"]


@pytest.mark.parametrize(("text", "ticks"), [("0", 0), ("3", 3), ("0.12s", 2), ("0.049s", 0), ("0.15s", 3)])
def test_latency_is_read_as_ticks_or_time(text: str, ticks: int) -> None:
    assert latency_ticks(text) == ticks


@pytest.mark.parametrize("text", ["", "-1", "fast", "101", "6s", "nans", "-1s", "nowhere/at/all"])
def test_other_latencies_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="latency"):
        latency_ticks(text)


def test_a_late_drive_repeats_and_shows_in_its_log(tmp_path: Path) -> None:
    prompt = evaluate(steady(tmp_path, 1))
    late = evaluate(steady(tmp_path, 1, out=tmp_path / "late", latency=4))
    again = evaluate(steady(tmp_path, 1, out=tmp_path / "again", latency=4))
    assert same(late, again)
    assert statuses(late) == ["Completed"]
    assert late.run["benchmark_id"] != prompt.run["benchmark_id"]
    controls = LogReader(late.folder / late.run["drives"][0]["log"]).controls()
    assert controls[1:5, 2].tolist() == [1.0] * 4, "braked until the first control is there"
    assert controls[5, 0] == pytest.approx(0.6)
    assert latency_ticks(str(prompt.folder)) == 0, "a step of this agent takes less than a tick"
