"""One short drive as a dataset, recorded once a session: `eu_small_a` with some traffic, the expert at the wheel."""

from __future__ import annotations

from pathlib import Path

from agents.behavior import BehaviorAgent
from lavsim.agent import plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.dataset.watched import Watched
from lavsim.dataset.writer import EpisodeWriter
from lavsim.episode import run_episode
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.sensors.suites import SUITES
from lavsim.simulation import DriveSpec, Simulation
from tests.drives import straight_drive

TICKS = 62
SUITE = SUITES["lav_data"]


def record(root: Path, episode: int, info: DatasetInfo, spec: DriveSpec, ticks: int = TICKS) -> EpisodeWriter:
    """Drives an episode into a dataset."""
    simulation = Simulation(spec)
    agent = Watched(InProcessAgent(BehaviorAgent))
    agent.start(plan_of(simulation.route, simulation.town))
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    header = {"agent": {"target": "agents.behavior:BehaviorAgent", "config": None}}
    writer = EpisodeWriter(root, episode, info, agent, log_extra=header)
    run_episode(simulation, agent, [writer], suite, max_ticks=ticks)
    agent.close()
    return writer


def make_dataset(root: Path, episodes: int = 2, blobs: bool = True, tables: bool = True) -> Path:
    """A small dataset in `root`."""
    info = DatasetInfo.of(RecordConfig(SUITE, tables=tables, blobs=blobs), seed=3)
    info.write(root)
    for episode in range(episodes):
        record(root, episode, info, drive(episode))
    return root


def drive(episode: int) -> DriveSpec:
    """The drive of an episode."""
    return straight_drive(traffic="lav", vehicles=40, walkers=30, seed=episode)
