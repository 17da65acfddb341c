"""LAV with parts of its work done by the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.helped import HelpedLavAgent
from lavsim.agent import AgentSpec, Track, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.errors import ConfigError
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.types import ActorClass
from tests.agents.lav.test_agent import trained
from tests.drives import straight_drive


def settings(folder: Path, *parts: str) -> str:
    path = folder / "helped.toml"
    path.write_text(f'weights = "{trained(folder / "weights")}"\ntruth = {list(parts)}\n')
    return str(path)


def test_a_part_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="truth"):
        HelpedLavAgent(settings(tmp_path, "wheel"))


def test_it_drives_some_ticks_on_the_truth(tmp_path: Path) -> None:
    simulation = Simulation(straight_drive(traffic="lav"))
    spec = AgentSpec("agents.lav.helped:HelpedLavAgent", settings(tmp_path, "brake", "detections", "plan"))
    agent = InProcessAgent(spec)
    agent.start(plan_of(simulation.route, simulation.town))
    assert agent.track is Track.PRIVILEGED
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    for tick in range(3):
        simulation.tick(agent.step(suite.read([simulation.snapshot]), 0.05 * tick))
    agent.close()


def test_true_detections_are_where_and_as_fast_as_others_are(tmp_path: Path) -> None:
    agent = HelpedLavAgent(settings(tmp_path, "detections"))
    truth = {
        "xyz": np.array([[10.0, 5.0, 0.0], [22.0, 5.0, 0.0], [13.0, 9.0, 0.0], [14.0, 3.0, 0.0]]),
        "yaw": np.zeros(4),
        "sizes": np.tile([4.8, 1.9, 1.5], (4, 1)),
        "velocities": np.array([[5.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.5, 0.0]]),
        "classes": np.array([ActorClass.CAR, ActorClass.CAR, ActorClass.CAR, ActorClass.WALKER]),
    }
    found = agent.told(truth)
    boxes = [[4.0, -3.0, 0.0, 2.4, 0.95], [0.0, -12.0, 0.0, 2.4, 0.95]]
    assert found.vehicles.tolist() == [pytest.approx(box, abs=1e-5) for box in boxes]
    assert found.speeds.tolist() == [0.0, 3.0]
    assert found.walkers.tolist() == [pytest.approx([-2.0, -4.0])]
    assert found.walking.tolist() == [pytest.approx([1.5, 0.0])]
