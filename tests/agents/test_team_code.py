"""Agents in the style of published team code, driven unchanged; and how it reads where they ask for too much."""

from __future__ import annotations

import importlib
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from lavsim import carla_standin, route_standin
from lavsim.agent import AgentPlan, Location, Rotation, Transform
from lavsim.types import RoadOption
from leaderboard.evaluator import evaluate
from tests.leaderboard.test_evaluator import config, statuses

TEAM = Path(__file__).parent / "fixtures" / "team_code"


@pytest.mark.parametrize(
    ("agent", "rules", "status", "icons"),
    [
        ("lidar_agent.py", "1.0", "Completed", ["carla_camera"] * 3 + ["carla_lidar", "carla_imu", "carla_gnss"]),
        ("map_agent.py", "2.1", "Perfect", ["carla_opendrive_map", "carla_radar", "carla_gnss", "carla_imu"]),
    ],
)
def test_team_code_drives_unchanged(tmp_path: Path, agent: str, rules: str, status: str, icons: list[str]) -> None:
    run = evaluate(config(tmp_path, "", 1, agent=str(TEAM / agent), agent_config=None, rules=rules))
    assert [d["agent_message"] for d in run.run["drives"]] == [None]
    assert statuses(run) == [status]
    assert run.results["sensors"] == [*icons, "carla_speedometer"]


def test_asking_for_carlas_world_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASK_FOR_THE_WORLD", "1")
    run = evaluate(config(tmp_path, "", 1, agent=str(TEAM / "lidar_agent.py"), agent_config=None))
    assert statuses(run) == ["Failed - Agent crashed"]
    message = run.run["drives"][0]["agent_message"]
    assert "CarlaDataProvider.get_world needs a CARLA server" in message


def test_without_carlas_package_its_plain_data_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "carla", raising=False)
    monkeypatch.setattr(sys, "meta_path", [carla_standin._Finder(), *sys.meta_path])
    carla = importlib.import_module("carla")
    assert carla.VehicleControl(throttle=0.5).manual_gear_shift is False
    assert carla.Location(3.0, 4.0).distance(carla.Location()) == 5.0
    assert carla.Vector2D(3.0, 4.0).length() == 5.0
    with pytest.raises(AttributeError, match=r"stand-in for the 'carla' package has .*, not 'Client'"):
        _ = carla.Client
    del sys.modules["carla"]  # by hand: what monkeypatch takes away it puts back, for all tests that follow


def plan(count: int = 60) -> AgentPlan:
    points = np.stack([np.arange(float(count)), np.zeros(count), np.zeros(count)], axis=1)
    return AgentPlan(points, np.zeros(count), np.full(count, int(RoadOption.LANEFOLLOW), np.int8), points / 111_319.49)


def test_trajectories_are_interpolated_along_the_agents_own_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(route_standin, "_plan", None)
    ends = [Location(x=10.2), Location(x=40.0, y=1.0)]
    with pytest.raises(RuntimeError, match="there is none yet"):
        route_standin.interpolate_trajectory(ends)
    route_standin.tell_plan(plan())
    for arguments in ((ends,), (object(), ends, 1.0), (ends, 2.0)):
        gps, world = route_standin.interpolate_trajectory(*arguments)
        assert [t.location.x for t, _ in world] == list(range(10, 41))
        assert len(gps) == 31
    with pytest.raises(RuntimeError, match=r"\(5\.0, 30\.0\) is not on the agent's route"):
        route_standin.interpolate_trajectory([Location(x=5.0, y=30.0)])
    with pytest.raises(RuntimeError, match="after the places before it"):
        route_standin.interpolate_trajectory(ends[::-1])


def test_places_become_latitude_and_longitude() -> None:
    found = route_standin.location_to_gps(42.0, 2.0, Location(100.0, -50.0, 3.0))
    assert found == pytest.approx({"lat": 42.000449156056874, "lon": 2.001208802447817, "z": 3.0})
    route = [(Transform(Location(1000.0, 2000.0)), RoadOption.LEFT)]
    ((gps, option),) = route_standin.location_route_to_gps(route, 0.0, 0.0)
    assert (gps["lat"], option) == (pytest.approx(-0.01796630538795796), RoadOption.LEFT)


def test_matrices_of_a_transform_undo_each_other() -> None:
    pose = Transform(Location(3.0, -4.0, 1.0), Rotation(pitch=10.0, yaw=70.0, roll=-5.0))
    there, back = np.array(pose.get_matrix()), np.array(pose.get_inverse_matrix())
    np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-12)
    moved = pose.transform(Location(1.0, 2.0, 3.0))
    np.testing.assert_allclose((there @ [1.0, 2.0, 3.0, 1.0])[:3], [moved.x, moved.y, moved.z])
    assert math.isclose(np.linalg.det(there[:3, :3]), 1.0)
