"""The agent protocol: thinning of the plan, controls, and how agents are found and constructed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lavsim.agent
from lavsim.agent import (
    Agent,
    AgentFailure,
    AgentPlan,
    AgentSpec,
    AgentStatus,
    Location,
    Rotation,
    Track,
    Transform,
    downsample_route,
    parse_control,
)
from lavsim.agent_runner import InProcessAgent
from lavsim.agent_source import find_agent, load_agent_class
from lavsim.errors import AgentError
from lavsim.types import Control, RoadOption

FIXTURES = Path(__file__).parent / "fixtures"

F, L, S, CL = RoadOption.LANEFOLLOW, RoadOption.LEFT, RoadOption.STRAIGHT, RoadOption.CHANGELANELEFT


def straight_plan(count: int = 120) -> AgentPlan:
    points = np.stack([np.arange(1.0, count + 1.0), np.zeros(count), np.zeros(count)], axis=1)
    return AgentPlan(points, np.zeros(count), np.full(count, int(F), np.int8), points / 111_319.49)


def slanted_plan() -> AgentPlan:
    """Metres that add up to the very limit, at places that single precision has not."""
    way = np.arange(400.0)
    points = np.stack([700.1 + 0.6 * way, -300.3 - 0.8 * way, np.zeros(400)], axis=1)
    return AgentPlan(points, np.full(400, 53.13), np.full(400, int(F), np.int8), points / 111_319.49)


@pytest.mark.parametrize("has_carla", [False, True])
def test_a_plan_is_the_same_with_and_without_the_package_carla(
    has_carla: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if has_carla:
        classes = pytest.importorskip("carla", reason="its package is not installed")
        monkeypatch.setattr(
            lavsim.agent, "carla_classes", lambda: (classes.Location, classes.Rotation, classes.Transform)
        )
    else:
        monkeypatch.setattr(lavsim.agent, "carla_classes", lambda: (Location, Rotation, Transform))
    world, points = slanted_plan().world, slanted_plan().points.astype(np.float32)
    assert [(t.location.x, t.location.y) for t, _ in world] == [(x, y) for x, y, _ in points.tolist()]
    assert {t.rotation.yaw for t, _ in world} == {float(np.float32(53.13))}
    assert downsample_route(world, 50) == [0, 52, 104, 156, 208, 260, 312, 364, 399]  # 363 in double precision


def straight_route(*pieces: tuple[RoadOption, int]) -> list[tuple[Transform, RoadOption]]:
    options = [option for option, count in pieces for _ in range(count)]
    return [(Transform(Location(x=float(i))), option) for i, option in enumerate(options)]


@pytest.mark.parametrize(
    ("pieces", "spacing", "kept"),
    [
        (((F, 180), (L, 15), (F, 60)), 50, [0, 52, 104, 156, 180, 195, 247, 254]),
        (((F, 180), (L, 15), (F, 60)), 200, [0, 180, 195, 254]),
        (((F, 40), (CL, 2), (F, 70), (S, 20), (F, 5)), 50, [0, 40, 41, 93, 112, 132, 136]),
        (((F, 40), (CL, 2), (F, 70), (S, 20), (F, 5)), 200, [0, 40, 41, 112, 132, 136]),
    ],
)
def test_thinning_gives_the_indices_of_the_original_code(pieces: Any, spacing: float, kept: list[int]) -> None:
    assert downsample_route(straight_route(*pieces), spacing) == kept


def test_control_is_clipped_as_carla_does() -> None:
    asked = SimpleNamespace(throttle=7.0, steer=np.float32(-3.0), brake=-0.2, hand_brake=np.bool_(True), reverse=0)
    assert parse_control(asked) == Control(1.0, -1.0, 0.0, True, False)


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (None, "returned None"),
        (SimpleNamespace(throttle=0.0, steer=0.0), "no 'brake'"),
        ((0.1, 0.2, 0.3), "tuple, which has no 'throttle'"),
        (SimpleNamespace(throttle=0.0, steer=np.nan, brake=0.0), "steer=nan"),
        (SimpleNamespace(throttle="0.5", steer=0.0, brake=0.0), "throttle='0.5', not a number"),
        (SimpleNamespace(throttle=[0.5, 1.0], steer=0.0, brake=0.0), "throttle is a list"),
        (SimpleNamespace(throttle=None, steer=0.0, brake=0.0), "throttle=None"),
    ],
)
def test_control_that_no_vehicle_can_apply_is_a_crash(control: Any, message: str) -> None:
    with pytest.raises(AgentFailure, match=message) as failure:
        parse_control(control)
    assert failure.value.status is AgentStatus.CRASHED


@pytest.mark.parametrize(
    "target",
    ["agents.idle", "agents.idle:IdleAgent", str(FIXTURES / "team_agent_two.py"), f"{FIXTURES / 'broken.py'}:Raises"],
)
def test_agent_that_exists_is_found_and_loads(target: str) -> None:
    assert find_agent(target).target == target
    assert isinstance(load_agent_class(target), type)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("agents.idel:IdleAgent", "no module 'agents.idel'. Did you mean 'agents.idle'"),
        ("agnets.idle:IdleAgent", "no module 'agnets'. Did you mean 'agents'"),
        ("agents.idle:IdelAgent", "no class 'IdelAgent'. Did you mean 'IdleAgent'"),
        ("agents.idle.deeper:X", "no module 'agents.idle.deeper'"),
        (str(FIXTURES / "team_agents.py"), "does not exist. Did you mean 'team_agent.py'"),
        (f"{FIXTURES / 'team_agent.py'}:Team", "no class 'Team'. Did you mean 'TeamAgent'"),
        ("/nowhere/at/all.py", "there is no folder"),
        (str(FIXTURES / "broken.py"), r"no get_entry_point\(\)"),
        (str(FIXTURES), "is a folder"),
        ("agents.idle:", "neither"),
        ("no spaces please", "neither"),
    ],
)
def test_agent_that_does_not_exist_gets_one_clear_line(target: str, message: str) -> None:
    with pytest.raises(AgentError, match=message) as error:
        find_agent(target)
    assert "\n" not in str(error.value)


def test_agent_with_a_syntax_error_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("x = 1\ndef broken(:\n")
    with pytest.raises(AgentError, match=r"bad\.py:2"):
        find_agent(str(tmp_path / "bad.py"))


def test_finding_an_agent_runs_none_of_its_code(tmp_path: Path) -> None:
    (tmp_path / "trap.py").write_text("raise SystemExit('ran')\nclass Trap: ...\n")
    find_agent(f"{tmp_path / 'trap.py'}:Trap")


class Probe(Agent):
    calls: list[str] = []  # noqa: RUF012 - shared on purpose: the test reads it

    def setup(self, path_to_conf_file: str | None) -> None:
        self.calls.append(f"setup {path_to_conf_file} plan={self._global_plan is not None}")
        self.track = Track.PRIVILEGED

    def run_step(self, input_data: dict[str, tuple[int, Any]], timestamp: float) -> Control:
        input_data["array"][1][:] = 7
        self.calls.append(f"step {timestamp} {len(self._global_plan or [])}")
        return Control(throttle=0.5)

    def destroy(self) -> None:
        self.calls.append("destroy")


@pytest.mark.parametrize(
    ("generation", "first", "points"), [("1.0", "setup c.toml plan=False", 4), ("2.x", "setup c.toml plan=True", 2)]
)
def test_set_up_order_and_plan_spacing_follow_the_generation(generation: str, first: str, points: int) -> None:
    Probe.calls.clear()
    handle = InProcessAgent(AgentSpec(f"{__file__}:Probe", "c.toml", generation))
    handle._runner._class = Probe
    handle.start(straight_plan())
    given = np.zeros(3)
    assert handle.track is Track.PRIVILEGED
    assert handle.step({"array": (0, given)}, 0.05) == Control(throttle=0.5)
    handle.close()
    handle.close()
    assert not given.any(), "readings are copies"
    assert Probe.calls == [first, f"step 0.05 {points}", "destroy"]
