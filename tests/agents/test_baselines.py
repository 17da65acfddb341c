"""The baselines: what each does, and what each leaves out."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.baselines.blind import alone
from lavsim.agent import plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.agent_source import packaged_agents
from lavsim.episode import run_episode
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.types import LightState, Role
from lavsim.world.blueprints import find_blueprint
from tests.drives import TOWN, long_lane, straight_drive, straight_route

FOLLOWERS = ("constant_speed:ConstantSpeed", "blind:BlindRouteFollower", "pure_pursuit:PurePursuit", "npc:NpcDriver")


def made(name: str, config: str | None = None) -> InProcessAgent:
    module, kind = name.split(":")
    return InProcessAgent(getattr(importlib.import_module(f"agents.baselines.{module}"), kind), config)


def driven(
    name: str, ticks: int, block: float | None = None, thing: str = "vehicle.audi.tt", **changes: Any
) -> list[Any]:
    """Snapshots of a drive along the straight route; a car, or another thing, stands on it after `block` metres."""
    simulation = Simulation(straight_drive(**changes))
    if block is not None:
        place = simulation.town.centre(np.array([long_lane()]), np.array([5.0 + block]))[0]
        simulation._world.spawn(300_000, find_blueprint(thing), place[:3], float(place[3]), Role.PARKED)
    agent = made(name)
    agent.start(plan_of(simulation.route, simulation.town))
    seen: list[Any] = []

    class Eye:
        def start(self, simulation: Simulation) -> None: ...
        def finish(self, result: object) -> None: ...
        def observe(self, snapshot: Any) -> None:
            seen.append(snapshot)

    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    run_episode(simulation, agent, [Eye()], suite, ticks)
    return seen


@pytest.mark.parametrize("name", FOLLOWERS)
def test_followers_keep_to_their_lane(name: str) -> None:
    seen = driven(name, 300)
    route = straight_route()
    offsets = [np.hypot(*(route.xy - snapshot.ego.xy).T).min() for snapshot in seen]
    assert max(offsets) < 0.7
    assert np.hypot(*(seen[-1].ego.xy - seen[0].ego.xy)) > 40.0


@pytest.mark.parametrize("name", FOLLOWERS)
def test_who_has_eyes_stops_behind_a_standing_car_and_who_has_none_does_not(name: str) -> None:
    touched = any(len(snapshot.contacts) for snapshot in driven(name, 320, block=50.0))
    assert touched == name.startswith(("constant", "blind"))


@pytest.mark.parametrize("name", FOLLOWERS[2:])
def test_debris_is_driven_over(name: str) -> None:
    seen = driven(name, 300, block=30.0, thing="static.prop.dirtdebris01")
    assert np.hypot(*(seen[-1].ego.xy - seen[0].ego.xy)) > 40.0


def test_the_blind_sees_itself_alone() -> None:
    truth = {"ids": np.arange(3), "xyz": np.zeros((3, 3)), "lights": np.zeros(5), "time": 1.0}
    found = alone(truth)
    assert (len(found["ids"]), len(found["xyz"]), len(found["lights"]), found["time"]) == (1, 1, 5, 1.0)


@pytest.mark.parametrize("name", ["blind:BlindRouteFollower", "pure_pursuit:PurePursuit", "npc:NpcDriver"])
def test_lights_are_kept(name: str) -> None:
    """The path leads over a stop line; under red it is not crossed, under green it is."""
    town = load_town(TOWN)
    light = town.lights[0]
    lane = light.stop_lines[0].lane
    after = int(town.lanes.successors(int(town.lanes.successors(lane)[0]))[0])
    start = max(town.lanes.length[lane] - 45.0, 0.0)
    ends = town.centre(np.array([lane, after]), np.array([start, 10.0]))[:, :3]
    route = get_planner(town).trace(ends)
    for state in (LightState.RED, LightState.GREEN):
        agent = made(name)
        agent.start(plan_of(route, town))
        simulation = Simulation(straight_drive(keypoints=ends))
        simulation._lights.hold(light.index, state)
        suite = SensorSuite(get_scene(town), agent.sensors(), simulation.draws)
        run_episode(simulation, agent, [], suite, 240)
        line = light.stop_lines[0]
        ego = simulation.snapshot.ego
        over = (ego.x - line.x) * np.cos(line.yaw) + (ego.y - line.y) * np.sin(line.yaw) > 0.0
        assert over == (state == LightState.GREEN)


def test_the_random_agent_repeats_under_its_seed() -> None:
    def controls(seed: str) -> list[Any]:
        agent = made("random_agent:RandomAgent", seed)
        agent.start(plan_of(straight_route(), load_town(TOWN)))
        return [agent.step({"speed": (k, {"speed": 0.0})}, 0.05 * k) for k in range(60)]

    assert controls("1") == controls("1")
    assert controls("1") != controls("2")
    assert len({c.steer for c in controls("1")}) == 6


def test_every_baseline_is_listed_with_what_it_does() -> None:
    listed = dict(packaged_agents())
    names = {path.stem for path in (Path(__file__).parents[2] / "agents" / "baselines").glob("*.py")}
    names -= {"__init__", "route_agent"}
    assert {target.split(".")[2].split(":")[0] for target in listed if "baselines" in target} == names
    assert "agents.behavior:BehaviorAgent" in listed
    assert "agents.idle:IdleAgent" in listed
    assert all(listed.values())
