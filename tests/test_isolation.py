"""The agent's child process: what it sees, how it fails, and that nothing of it stays."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from lavsim.agent import AgentFailure, AgentPlan, AgentSpec, AgentStatus, Track
from lavsim.isolation import ChildAgent
from lavsim.messages import MessageError, pack, unpack
from lavsim.types import Control, RoadOption

FIXTURES = Path(__file__).parent / "agents" / "fixtures"


def plan(count: int = 120) -> AgentPlan:
    points = np.stack([np.arange(1.0, count + 1.0), np.zeros(count), np.zeros(count)], axis=1)
    return AgentPlan(points, np.zeros(count), np.full(count, int(RoadOption.LANEFOLLOW), np.int8), points / 111_319.49)


def broken(name: str, **limits: Any) -> AgentSpec:
    return AgentSpec(f"{FIXTURES / 'broken.py'}:{name}", **limits)


def body_of(value: Any) -> tuple[bytes, bytes]:
    header, buffers, size = pack(value)
    body = bytearray(size)
    start = 0
    for data in buffers:
        body[start : start + data.nbytes] = data
        start += -(-data.nbytes // 64) * 64
    return header, bytes(body)


def test_messages_come_back_as_they_were() -> None:
    value = {
        "text": "ü",
        "list": [1, 2.5, None, True, float("inf")],
        "tuple": (1, (2, "x")),
        "bytes": b"\x00\xff",
        "keys": {1: "one", (2, 3): "pair"},
        "arrays": [
            np.arange(6, dtype=np.float32).reshape(2, 3),
            np.zeros((0, 4)),
            np.array(3, np.uint8),
            np.zeros(2, [("a", "<i2"), ("b", "<f4")]),
        ],
    }
    back = unpack(*body_of(value))
    for ours, theirs in zip(value["arrays"], back.pop("arrays"), strict=True):  # type: ignore[call-overload]
        assert theirs.dtype == ours.dtype
        assert theirs.flags.writeable
        np.testing.assert_array_equal(theirs, ours)
    del value["arrays"]
    assert back == value


def test_objects_are_never_sent_or_accepted() -> None:
    with pytest.raises(TypeError, match="can't be sent"):
        pack(np.array([object()]))
    with pytest.raises(MessageError, match="objects"):
        unpack(b'{"\\u0000array":["|O",[1],0]}', b"\x00" * 8)
    with pytest.raises(MessageError, match="unreadable"):
        unpack(b"{", b"")


def test_agent_of_a_team_runs_unchanged(tmp_path: Path) -> None:
    output = tmp_path / "agent.txt"
    image = np.full((288, 256, 4), 9, np.uint8)
    image.flags.writeable = False
    with ChildAgent(AgentSpec(str(FIXTURES / "team_agent.py"), "some.toml"), output) as agent:
        agent.start(plan())
        assert agent.track is Track.SENSORS
        assert [s["id"] for s in agent.sensors()] == ["rgb", "speed"]
        pid = agent.pid
        for tick in range(3):
            control = agent.step({"rgb": (tick, image), "speed": (tick, {"speed": 1.0})}, tick * 0.05)
            assert control == Control(throttle=0.5, steer=1.0)
    assert image.min() == 9
    assert pid is not None
    assert not psutil.pid_exists(pid)
    assert "step 3 2 0.1" in output.read_text()
    assert "destroyed after 3" in output.read_text()


def test_second_generation_gets_its_plan_before_set_up() -> None:
    with ChildAgent(AgentSpec(str(FIXTURES / "team_agent_two.py"), generation="2.x")) as agent:
        agent.start(plan())
        assert agent.track is Track.MAP
        assert agent.step({}, 0.0).throttle == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("name", "status", "message"),
    [
        ("RaisesInSetup", AgentStatus.SETUP_FAILED, "set-up raised FileNotFoundError: no weights at None"),
        ("ExitsInSetup", AgentStatus.SETUP_FAILED, "ended itself with exit code 0"),
        ("UnknownTrack", AgentStatus.SETUP_FAILED, "track 'RAILS' is none of"),
        ("WrongSensors", AgentStatus.SENSORS_INVALID, "no list of dictionaries"),
    ],
)
def test_failure_in_set_up(name: str, status: AgentStatus, message: str) -> None:
    with ChildAgent(broken(name)) as agent:
        with pytest.raises(AgentFailure, match=message) as failure:
            agent.start(plan())
        assert failure.value.status is status


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Raises", "run_step raised ValueError: first line second line"),
        ("ReturnsNothing", "returned None"),
        ("ReturnsNan", "steer=nan"),
        ("ReturnsText", "throttle='full'"),
        ("ReturnsTuple", "tuple, which has no 'throttle'"),
        ("Exits", "ended itself with exit code 3"),
        ("ExitsPolitely", "run_step raised SystemExit: enough"),
        ("Segfaults", "killed by SIGSEGV"),
        ("WritesToSocket", "nonsense|malformed"),
    ],
)
def test_failure_in_a_step(name: str, message: str, tmp_path: Path) -> None:
    with ChildAgent(broken(name), tmp_path / "out.txt") as agent:
        agent.start(plan())
        with pytest.raises(AgentFailure, match=message) as failure:
            agent.step({}, 0.0)
        assert failure.value.status is AgentStatus.CRASHED
        assert "\n" not in failure.value.message
    if name == "Raises":
        assert "Traceback" in (tmp_path / "out.txt").read_text()


def test_agent_that_hangs_is_ended_in_time_with_its_offspring(tmp_path: Path) -> None:
    output = tmp_path / "out.txt"
    agent = ChildAgent(broken("HangsWithOffspring", step_timeout=0.2), output)
    agent.start(plan())
    pid = agent.pid
    began = time.monotonic()
    with pytest.raises(AgentFailure, match=r"run_step took longer than 1 s") as failure:
        agent.step({}, 0.0)
    assert time.monotonic() - began < 20.0, "it was not waited for: it sleeps for ever"
    assert failure.value.status is AgentStatus.TIMED_OUT
    agent.close()
    sleeper = int(output.read_text().split()[1])
    for left in (pid, sleeper):
        assert left is not None
        assert not psutil.pid_exists(left) or psutil.Process(left).status() == psutil.STATUS_ZOMBIE


def test_the_first_step_may_take_longer_and_no_other() -> None:
    with ChildAgent(broken("WarmsUp", step_timeout=1.0)) as agent:
        agent.start(plan())
        agent.step({}, 0.0)
        with pytest.raises(AgentFailure, match=r"run_step took longer than 1 s"):
            agent.step({}, 0.05)


def test_agent_that_takes_too_much_memory_is_ended() -> None:
    with ChildAgent(broken("EatsMemory", memory_limit=400 * 2**20)) as agent:
        agent.start(plan())
        with pytest.raises(AgentFailure, match=r"over its limit of 0\.39 GiB"):
            agent.step({}, 0.0)


def test_output_is_capped(tmp_path: Path) -> None:
    with ChildAgent(broken("Chatty", output_limit=150_000), tmp_path / "out.txt") as agent:
        agent.start(plan())
        for _ in range(5):
            agent.step({}, 0.0)
    size = (tmp_path / "out.txt").stat().st_size
    assert 150_000 <= size < 150_100


def test_readings_over_the_shared_block_still_arrive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lavsim.isolation.SHARED_BYTES", 4096)
    with ChildAgent(AgentSpec(str(FIXTURES / "team_agent.py"))) as agent:
        agent.start(plan())
        image = np.zeros((288, 256, 4), np.uint8)
        assert agent.step({"rgb": (0, image), "speed": (0, {"speed": 9.0})}, 0.0).throttle == 0.0
