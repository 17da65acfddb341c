"""Drawings on their way from an agent's process to the side file, and what the expert shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.behavior import BehaviorAgent
from lavsim.agent import AgentSpec, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import run_episode
from lavsim.isolation import ChildAgent
from lavsim.log.drawings import DrawingsWriter, read_drawings
from lavsim.log.writer import LogWriter
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from tests.drives import hazard, straight_drive

AGENT = """
import numpy as np
from lavsim.agent import Agent
from lavsim.drawings import points, raster, scalar
from lavsim.types import Control

class Shows(Agent):
    def setup(self, path):
        self.steps = 0
    def run_step(self, input_data, timestamp):
        self.steps += 1
        return Control(throttle=0.3)
    def drawings(self):
        if self.steps == 3:
            raise ValueError("no picture")
        if self.steps == 4:
            return {"plan": {"kind": "points", "xy": object()}}
        seen = points([(self.steps, 0.0)], frame="ego")
        return {"seen": seen, "heat": raster(np.ones((3, 5))), "n": scalar(self.steps)}
"""


def drive(folder: Path, agent: ChildAgent | InProcessAgent, ticks: int, **changes: object) -> bytes:
    """Drives, with drawings beside the log; the log's bytes."""
    simulation = Simulation(straight_drive(**changes))
    agent.start(plan_of(simulation.route, simulation.town))
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    observers = [LogWriter(folder / "a.lavlog"), DrawingsWriter(folder / "a.lavdraw", agent.drawings)]
    run_episode(simulation, agent, observers, suite, max_ticks=ticks)
    agent.close()
    return (folder / "a.lavlog").read_bytes()


def test_drawings_come_through_the_child_and_never_touch_the_log(tmp_path: Path) -> None:
    (tmp_path / "shows.py").write_text(AGENT)
    logs = []
    for wanted in (True, False):
        spec = AgentSpec(str(tmp_path / "shows.py:Shows"), drawings=wanted)
        logs.append(drive(tmp_path, ChildAgent(spec, tmp_path / "said.txt"), 6))
        found = dict(read_drawings(tmp_path / "a.lavdraw"))
        assert len(found) == (4 if wanted else 0)
        if wanted:
            assert [drawings["n"]["value"] for drawings in found.values()] == [1.0, 2.0, 5.0, 6.0]
            assert found[max(found)]["heat"]["values"].tolist() == [[255] * 5] * 3
            assert "nothing is shown: ValueError: no picture" in (tmp_path / "said.txt").read_text()
    assert logs[0] == logs[1]


def test_expert_shows_its_plan_its_forecasts_and_what_it_brakes_for(tmp_path: Path) -> None:
    agent = InProcessAgent(AgentSpec(f"{BehaviorAgent.__module__}:BehaviorAgent", drawings=True))
    drive(
        tmp_path, agent, 160, scenarios=(hazard("DynamicObjectCrossing", 30, distance="14"),), vehicles=6, traffic="lav"
    )
    frames = dict(read_drawings(tmp_path / "a.lavdraw"))
    assert len(frames) == 160
    assert all({"plan", "forecast", "acceleration", "wanted speed"} <= set(drawings) for drawings in frames.values())
    first = frames[min(frames)]["plan"]
    assert np.hypot(*np.diff(first["xy"], axis=0).T).sum() == pytest.approx(39.5, abs=1.0)
    assert any(drawings["forecast"]["count"].size for drawings in frames.values())
    braked = [drawings for drawings in frames.values() if "brakes for" in drawings]
    assert braked
    assert all(drawings["acceleration"]["value"] < 0.0 for drawings in braked)
    assert braked[0]["brakes for"]["labels"][0].startswith("brakes for 1")
