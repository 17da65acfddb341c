"""What published agents import beside their sensors: `srunner` for its clock, in their own process alone."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from lavsim.agent import AgentFailure, AgentPlan, AgentSpec
from lavsim.isolation import ChildAgent

SOURCE = """
from types import SimpleNamespace
from leaderboard.autoagents import autonomous_agent
from leaderboard.envs.sensor_interface import SensorConfigurationInvalid, SensorInterface, SensorReceivedNoData
from leaderboard.utils.route_manipulation import downsample_route
from agents.navigation.local_planner import RoadOption
{imports}

def get_entry_point():
    return "Timed"

class Timed(autonomous_agent.AutonomousAgent):
    def setup(self, path):
        self.track = autonomous_agent.Track.SENSORS

    def run_step(self, input_data, timestamp):
        {body}
"""
CLOCK = "from srunner.scenariomanager.timer import GameTime"
PROVIDER = "from srunner.scenariomanager.carla_data_provider import CarlaDataProvider"


def started(folder: Path, imports: str, body: str) -> ChildAgent:
    path = folder / "timed.py"
    path.write_text(SOURCE.format(imports=imports, body=body))
    agent = ChildAgent(AgentSpec(str(path)))
    points = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    agent.start(AgentPlan(points, np.zeros(5), np.full(5, 4, np.int8), points / 111_319.49))
    return agent


def test_the_scenario_runners_clock_tells_simulated_time(tmp_path: Path) -> None:
    body = "return SimpleNamespace(throttle=GameTime.get_time() / 10, steer=GameTime.get_frame() / 1000, brake=0.0)"
    with started(tmp_path, CLOCK, body) as agent:
        control = agent.step({}, 1.5)
        assert (control.throttle, control.steer) == (pytest.approx(0.15), pytest.approx(0.03))
        assert agent.step({}, 2.0).throttle == pytest.approx(0.2)
    assert "srunner" not in sys.modules


def test_what_needs_a_server_says_so_in_a_line(tmp_path: Path) -> None:
    with (
        started(tmp_path, PROVIDER, "return CarlaDataProvider.get_world()") as agent,
        pytest.raises(AgentFailure, match=r"CarlaDataProvider\.get_world needs a CARLA server"),
    ):
        agent.step({}, 0.0)


def test_other_parts_of_the_scenario_runner_are_named_as_missing(tmp_path: Path) -> None:
    with pytest.raises(AgentFailure, match=r"has srunner\.scenariomanager\.timer and .*, not 'srunner\.tools'"):
        started(tmp_path, "import srunner.tools.route_manipulation", "return None")
