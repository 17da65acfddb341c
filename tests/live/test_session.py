"""Live drives as functions of their header and the ego's controls: saved, replayed and forked to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lavsim.agent import AgentFailure, AgentSpec, AgentStatus, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.episode import EpisodeResult, run_episode
from lavsim.live.commands import Command
from lavsim.live.drivers import AgentDriver
from lavsim.live.session import Session
from lavsim.log.reader import LogReader
from lavsim.log.replay import digest_of, resume
from lavsim.log.writer import LogWriter
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.types import Control
from lavsim.world.snapshot import Snapshot
from tests.live.drives import RouteDriver, session


def ask(live: Session, name: str, **values: Any) -> dict[str, Any]:
    """The answer to a command, obeyed at once."""
    answers: list[dict[str, Any]] = []
    live.obey(Command(name, values), answers.append)
    return answers[0] if answers else {}


def key_drive(folder: Path) -> Session:
    """A few seconds at the keys, with a hazard set on the way."""
    live = session(folder)
    ask(live, "drive", throttle=1.0, brake=0.0, steer=0.0)
    live.advance(30)
    assert "told" in ask(live, "hazard", type="DynamicObjectCrossing")
    live.advance(30)
    ask(live, "drive", throttle=0.0, brake=1.0, steer=0.2)
    live.advance(40)
    return live


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return key_drive(tmp_path_factory.mktemp("drive"))


def saved(live: Session, folder: Path) -> Path:
    live._folder = folder
    return folder / ask(live, "save")["saved"]


def test_saved_drive_holds_every_tick_and_drives_again_to_the_same_bytes(driven: Session, tmp_path: Path) -> None:
    path = saved(driven, tmp_path)
    log = LogReader(path)
    assert [digest_of(s) for s in log] == [digest_of(s) for s in driven.history.snapshots]
    assert log.header["scenarios"][-1]["tick"] == 31
    simulation = resume(log, log[0].tick)
    writer = LogWriter(tmp_path / "again.lavlog", {"suite": []})
    writer.start(simulation)
    writer.observe(simulation.snapshot)
    for control in log.controls()[1:].tolist():
        writer.observe(simulation.tick(Control(*control[:3], bool(control[3]), bool(control[4]))))
    writer.finish(EpisodeResult(len(log), "saved while under way"))
    assert (tmp_path / "again.lavlog").read_bytes() == path.read_bytes()


def test_hazard_set_under_way_is_met_and_told(driven: Session) -> None:
    kinds = [event.kind for event in driven.history.events]
    assert kinds[0] == "set"
    assert "hazard" in kinds
    assert driven.simulation.hazard_types == ["DynamicObjectCrossing"]
    assert any(len(snapshot.hazards) for snapshot in driven.history.snapshots)


def test_fork_goes_on_as_the_first_drive_would_have(tmp_path: Path) -> None:
    live = key_drive(tmp_path)
    before = [digest_of(s) for s in live.history.snapshots]
    epoch = live.view.epoch
    assert "told" in ask(live, "fork", tick=61)
    assert live.history.last == 61
    assert live.view.epoch == epoch + 1
    live.advance(40)
    assert [digest_of(s) for s in live.history.snapshots] == before


def test_fork_before_a_hazard_was_set_drops_it(tmp_path: Path) -> None:
    live = key_drive(tmp_path)
    ask(live, "fork", tick=20)
    assert live.simulation.hazard_types == []
    assert [event for event in live.history.events if event.kind == "set"] == []
    live.advance(20)
    assert "tick" not in str(live.simulation.header()["scenarios"])


def test_restart_with_a_seed_is_that_drive(tmp_path: Path) -> None:
    live = session(tmp_path)
    live.advance(5)
    ask(live, "restart", seed=5)
    assert live.view.status["seed"] == 5
    assert live.history.last == 1
    other = session(tmp_path, seed=5)
    assert digest_of(live.view.snapshot) == digest_of(other.view.snapshot)


def test_looking_back_pauses_and_going_on_returns_to_the_newest_tick(tmp_path: Path) -> None:
    live = session(tmp_path)
    live.advance(9)
    ask(live, "pause", on=False)
    ask(live, "look", tick=4)
    assert (live.view.snapshot.tick, live.view.status["last"], live.view.status["paused"]) == (4, 10, True)
    ask(live, "pause", on=False)
    assert live.view.snapshot.tick == 10


@pytest.mark.parametrize(
    ("name", "values"),
    [("look", {"tick": 999}), ("fork", {"tick": 999}), ("fork", {"tick": 0}), ("hazard", {"type": "Nonsense"})],
)
def test_wishes_that_cannot_be_met_are_answered(name: str, values: dict[str, Any], driven: Session) -> None:
    before = digest_of(driven.view.snapshot)
    assert ask(driven, name, **values)["error"]
    assert digest_of(driven.view.snapshot) == before


def test_agents_are_not_driven_by_keys_and_start_anew_after_a_fork(tmp_path: Path) -> None:
    driver = RouteDriver()
    live = session(tmp_path, driver)
    assert "agent drives" in ask(live, "drive", throttle=1.0, brake=0.0, steer=0.0)["error"]
    live.advance(12)
    assert live.view.drawings[1]["plan"]["kind"] == "polylines"
    ask(live, "fork", tick=6)
    assert driver.starts == 2
    live.close()
    assert driver.is_closed


def test_agent_that_fails_ends_the_drive_and_a_fork_mends_it(tmp_path: Path) -> None:
    class Weak(RouteDriver):
        def control(self, simulation: Simulation) -> Control:
            if simulation.snapshot.tick == 6 and self.starts == 1:
                raise AgentFailure(AgentStatus.CRASHED, "run_step raised ValueError")
            return super().control(simulation)

    live = session(tmp_path, Weak())
    live.advance(20)
    assert live.history.last == 6
    assert "ValueError" in live.view.status["note"]
    assert live.view.status["paused"]
    ask(live, "fork", tick=4)
    live.advance(10)
    assert (live.history.last, live.view.status["note"]) == (14, "")


def test_names_of_saves_are_the_servers_own(tmp_path: Path) -> None:
    live = session(tmp_path, route_id="../../etc/é\x00 x")
    names = [ask(live, "save")["saved"] for _ in range(2)]
    assert names == ["live_______etc____x_seed0_001.lavlog", "live_______etc____x_seed0_002.lavlog"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_watched_agent_drives_as_it_is_scored(tmp_path: Path) -> None:
    target = "agents.baselines.constant_speed"
    live = session(tmp_path, AgentDriver(AgentSpec(target)))
    live.advance(8)
    live.close()
    simulation, agent = Simulation(live.simulation.spec), InProcessAgent(AgentSpec(target))
    agent.start(plan_of(simulation.route, simulation.town))
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    digests = _Digests()
    run_episode(simulation, agent, [digests], suite, max_ticks=9)
    assert [digest_of(s) for s in live.history.snapshots] == digests.seen


class _Digests:
    """Observer that keeps a digest of each tick."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def start(self, simulation: Simulation) -> None:
        pass

    def observe(self, snapshot: Snapshot) -> None:
        self.seen.append(digest_of(snapshot))

    def finish(self, result: EpisodeResult) -> None:
        pass
