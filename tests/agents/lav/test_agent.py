"""LAV behind the wheel: what it needs, and that it drives, looks and stops on sensors alone."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="LAV needs torch: pip install 'lavsim[lav]'")

from agents.lav.agent import LavAgent
from agents.lav.config import DriveConfig, LavConfig, find_preset
from agents.lav.controller import BrakeHold
from agents.lav.driving import Driver, Forecasts, Outlook, goals_of, straight_forecasts, vehicle_forecasts
from agents.lav.frames import planner_from_vehicle, planner_from_world
from agents.lav.leaders import leader_paths, same_way
from agents.lav.localise import Pose
from agents.lav.look import carried_forecasts, carried_points, carried_sight
from agents.lav.models.brake import BrakeNetwork
from agents.lav.models.detection import Detections
from agents.lav.models.segmentation import make_segmentation
from agents.lav.models.student import Student
from agents.lav.perceive import Perceiver, Sight, read_trained
from agents.lav.scans import Scans
from agents.lav.weights import Weights, write_weights
from lavsim.agent import AgentSpec, Track, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.agent_source import load_agent_class
from lavsim.drawings import checked_all
from lavsim.errors import ConfigError
from lavsim.guidance import GOAL_FARTHEST, GOAL_REACHED, Guidance
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from lavsim.types import Control, RoadOption
from leaderboard.routes import read_routes
from tests.drives import straight_drive

MICRO = find_preset("micro")
AHEAD = np.stack([np.zeros(10), -1.5 * np.arange(1, 11)], axis=1)  # a plan at 6 m/s
BOX = [0.0, 2.4, 1.0]


@cache
def networks(config: LavConfig) -> dict[str, Any]:
    torch.manual_seed(1)
    return {
        "full": Student(config),
        "segmentation": make_segmentation(config.segmentation),
        "brake": BrakeNetwork(config),
    }


def trained(folder: Path, config: LavConfig = MICRO, **configs: LavConfig) -> Path:
    """A folder as a training leaves it, with weights that have learnt nothing."""
    for stage in ("full", "segmentation", "brake"):
        own = configs.get(stage, config)
        path = folder / stage / f"{stage}.safetensors"
        write_weights(path, Weights(stage, own, networks(own)[stage].state_dict()))
    return folder


def forecast(x: float, y: float, speed: float, likelihood: float = 1.0) -> Forecasts:
    """Of somebody at (x, y) who drives to the left."""
    path = np.stack([x - speed * 0.25 * np.arange(1, 11), np.full(10, y)], axis=1)
    paths = np.broadcast_to(path, (1, 6, 10, 2))
    return Forecasts(paths, np.full((1, 6), likelihood), np.array([[-np.pi / 2.0, 2.4, 1.0]]))


def driver() -> Driver:
    return Driver(MICRO.drive, BOX[1:])


@pytest.mark.parametrize(
    ("x", "y", "speed", "likelihood", "stops"),
    [
        (12.0, -10.0, 7.0, 0.9, True),
        (12.0, -10.0, 7.0, 0.1, False),
        (40.0, -10.0, 7.0, 0.9, False),
        (12.0, 5.0, 7.0, 0.9, False),
        (4.0, -10.0, 0.0, 0.9, False),
    ],
)
def test_it_stops_before_whoever_likely_crosses_its_plan(
    x: float, y: float, speed: float, likelihood: float, stops: bool
) -> None:
    control = driver().step(AHEAD, {"vehicle": forecast(x, y, speed, likelihood)}, 5.5, 3)
    assert (control.brake > 0.0) == stops


def test_walkers_go_on_as_they_go() -> None:
    places, velocities = np.array([[3.0, -8.0]]), np.array([[-2.0, 0.0]])
    assert driver().step(AHEAD, {"vehicle": straight_forecasts(places, velocities, 10)}, 6.0, 3).brake > 0.8
    assert driver().step(AHEAD, {"vehicle": straight_forecasts(places, -velocities, 10)}, 6.0, 3).brake == 0.0


def test_who_stands_is_not_foreseen_to_pull_out() -> None:
    moving = forecast(4.0, -8.0, 4.0)
    outlook = Outlook(AHEAD, moving.paths, moving.likelihood)
    pose, size = np.array([[4.0, -8.0, 0.0]]), np.array([[2.4, 1.0]])
    for stands in (True, False):
        others = vehicle_forecasts(outlook, pose, size, np.array([stands]))
        assert (driver().step(AHEAD, {"vehicle": others}, 6.0, 3).brake == 0.0) == stands


@pytest.mark.parametrize(
    ("x", "velocity", "braking", "brakes"),
    [
        (0.8, (0.0, -3.0), 2.0, True),
        (0.8, (0.0, -3.0), 0.0, False),  # forecasts alone
        (0.8, (0.0, -9.0), 2.0, False),  # drives away
        (2.6, (0.0, -3.0), 2.0, False),  # beside
        (0.8, (np.nan, np.nan), 2.0, False),
    ],
)
def test_it_keeps_behind_a_leader_whose_forecasts_say_nothing(
    x: float, velocity: tuple[float, float], braking: float, brakes: bool
) -> None:
    outlook = Outlook(AHEAD, np.full((1, 6, 10, 2), 50.0), np.zeros((1, 6)))
    place, size = np.array([[x, -6.0, 0.0]]), np.array([[0.9, 0.3]])
    rider = vehicle_forecasts(outlook, place, size, np.array([False]), np.array([velocity]), braking)
    assert (driver().step(AHEAD, {"vehicle": rider}, 6.0, 3).brake > 0.0) == brakes


@pytest.mark.parametrize(("half", "brakes"), [((0.9, 0.3), True), ((2.2, 0.9), False)])
def test_riders_who_cross_go_on_as_they_go_and_cars_as_is_foreseen(half: tuple[float, float], brakes: bool) -> None:
    outlook = Outlook(AHEAD, np.full((1, 6, 10, 2), 50.0), np.zeros((1, 6)))
    place, velocity = np.array([[5.0, -8.0, -np.pi / 2.0]]), np.array([[-4.0, 0.0]])
    others = vehicle_forecasts(outlook, place, np.array([half]), np.array([False]), velocity, 3.0)
    assert (driver().step(AHEAD, {"vehicle": others}, 6.0, 3).brake > 0.0) == brakes


def test_leaders_go_straight_on_or_come_to_a_stand() -> None:
    paths = leader_paths(np.zeros((2, 2)), np.array([[0.0, -4.0], [0.0, 0.0]]), 10, 2.0)
    np.testing.assert_allclose(paths[0, 0, :, 1], -np.arange(1.0, 11.0))
    np.testing.assert_allclose(paths[0, 1, [0, 3, 7, 9], 1], [-0.9375, -3.0, -4.0, -4.0])
    assert not paths[1].any()


@pytest.mark.parametrize(
    ("place", "velocity", "goes_its_way"),
    [
        ((0.0, -5.0), (0.0, -3.0), True),
        ((0.0, -5.0), (0.0, 3.0), False),
        ((0.0, -5.0), (3.0, 0.0), False),
        ((9.0, -9.0), (3.0, 0.0), True),  # round the bend
        ((0.0, -5.0), (np.nan, np.nan), False),
    ],
)
def test_who_goes_the_egos_way_is_told_by_the_plan_where_he_is(
    place: tuple[float, float], velocity: tuple[float, float], goes_its_way: bool
) -> None:
    bend = np.array([[0.0, -3.0], [0.0, -6.0], [2.0, -8.5], [5.0, -9.0], [8.0, -9.0]])
    assert same_way(bend, np.array([place]), np.array([velocity])).tolist() == [goes_its_way]


@pytest.mark.parametrize(("x", "y", "passes"), [(1.95, -4.0, True), (0.2, -6.0, False)])
def test_it_passes_who_stands_beside_its_way_in_time_and_nobody_on_it(x: float, y: float, passes: bool) -> None:
    car = Forecasts(np.tile([x, y], (1, 6, 10, 1)).astype(float), np.ones((1, 6)), np.array([[0.0, 2.2, 0.9]]))
    waits = driver()
    controls = [waits.step(AHEAD, {"vehicle": car}, 0.0, 3) for _ in range(180)]
    assert controls[0] == Control(brake=1.0)
    assert (controls[-1].throttle > 0.0) == passes


@pytest.mark.parametrize("allowed", [0.0, 1.4])
def test_nobody_creeps_who_stands_for_a_light(allowed: float) -> None:
    waits = driver()
    controls = [waits.step(AHEAD, {}, 0.0, 3, allowed=allowed) for _ in range(600)]
    assert all(control == Control(brake=1.0) for control in controls)


def test_it_creeps_later_where_the_brake_network_holds_it() -> None:
    for is_held, patience in ((False, 200), (True, 1200)):
        stuck = driver()
        crowd = {} if is_held else {"vehicle": forecast(0.0, -6.0, 0.0)}
        controls = [stuck.step(AHEAD, crowd, 0.0, 3, is_held) for _ in range(patience)]
        assert controls[-2] == Control(brake=1.0)
        assert controls[-1].throttle > 0.0


@pytest.mark.parametrize(("score", "holds_for"), [(0.2, 0), (0.45, 40), (0.9, 400)])
def test_a_doubtful_score_holds_for_a_while_and_a_sure_one_for_good(score: float, holds_for: int) -> None:
    hold = BrakeHold(MICRO.drive)
    assert hold.step(score, 6.0) == (score > 0.3)
    held = [hold.step(score, 0.0) for _ in range(400)]
    assert sum(held) == pytest.approx(holds_for, abs=1)
    assert hold.step(0.95, 2.0)
    away = [hold.step(score, 3.0) for _ in range(200)]
    assert away[-1] == (score > 0.3)


@pytest.mark.parametrize("look_every", [1, 2])
def test_two_half_sweeps_are_one_scan_and_past_scans_lie_where_they_were(look_every: int) -> None:
    stacked = MICRO.model_copy(update={"temporal": MICRO.temporal.model_copy(update={"scans": 3})})
    scans = Scans(stacked)
    first, second = np.full((2, 4), 1.0, np.float32), np.full((3, 4), 2.0, np.float32)
    assert scans.merged(first).tolist() == first.tolist()
    assert scans.merged(second)[:, 0].tolist() == [2.0, 2.0, 2.0, 1.0, 1.0]
    post = np.array([10.0, 5.0])  # in the frame that stands still
    for tick in range(13):
        scans.merged(first)
        if tick % look_every:
            continue
        pose = Pose(np.array([0.4 * tick, 0.0]), 0.02 * tick)
        c, s = np.cos(pose.yaw), np.sin(pose.yaw)
        offset = post - pose.xy
        seen = [c * offset[0] + s * offset[1], c * offset[1] - s * offset[0], 0.0, 1.0]
        found = scans.stacked(np.array([seen], np.float32), pose)
    assert found[:, 4:].tolist() == np.eye(3).tolist()
    assert np.abs(found[:, :2] - found[0, :2]).max() < 1e-5


def seen(places: list[list[float]], scores: list[float]) -> Detections:
    boxes = np.column_stack([places, np.tile([0.0, 2.2, 0.9], (len(places), 1))]) if places else np.zeros((0, 5))
    return Detections(torch.from_numpy(boxes.astype(np.float32)), torch.tensor(scores))


def test_what_moves_like_somebody_is_somebody_even_in_doubt(tmp_path: Path) -> None:
    agent, here = LavAgent(str(trained(tmp_path))), Pose(np.zeros(2), 0.0)
    for tick in range(10):
        crossing = [-6.0 + 0.4 * tick, -12.0]  # at 4 m/s to the right
        sure, cyclist, fence = [3.0, -8.0], crossing, [5.0, -15.0]
        vehicles = seen([sure, cyclist, fence, [0.0, 6.0]], [0.6, 0.2, 0.2, 0.6])
        found = agent.found(Sight(torch.zeros(0), vehicles, seen([[2.0, -5.0]], [0.5]), torch.zeros(0), np.zeros(0)),
                            here, {"EGO": {"speed": 0.0}})  # fmt: skip
        assert len(found.vehicles) + len(found.walkers) == 0 or tick >= 1, "nobody counts who was found once"
    assert found.vehicles[:, :2].tolist() == [pytest.approx(sure)], "nor who is behind"
    assert found.walkers.tolist() == [pytest.approx(crossing), pytest.approx([2.0, -5.0])]
    assert found.walking[0] == pytest.approx([4.0, 0.0], abs=0.5)


def test_far_goals_are_brought_near_along_the_arc() -> None:
    def goals(ahead: float, right: float) -> Any:
        here, then = np.array([ahead, right], np.float32), np.array([ahead + 9.0, right], np.float32)
        return goals_of(Guidance(RoadOption.LANEFOLLOW, here, then, 0))

    assert goals(60.0, 40.0) == pytest.approx(planner_from_vehicle(np.array([[60.0, 40.0], [69.0, 40.0]]))), "near"
    assert goals(200.0, 0.0) == pytest.approx(planner_from_vehicle(np.array([[50.0, 0.0], [100.0, 0.0]])))
    radius, far = 120.0, 1.4  # [m], [rad] of the bend
    on_arc = [[radius * math.sin(a), radius * (1.0 - math.cos(a))] for a in (50.0 / radius, 100.0 / radius)]
    found = goals(radius * math.sin(far), radius * (1.0 - math.cos(far)))
    assert found == pytest.approx(planner_from_vehicle(np.array(on_arc)), abs=1e-3)


def test_no_goal_of_1_0_s_plans_is_far() -> None:
    for entry in read_routes("quick"):
        route = get_planner(load_town(entry.town)).trace(entry.keypoints)
        apart = np.hypot(*np.diff(route.xy[route.thinned(50.0)], axis=0).T)
        assert apart.max() + GOAL_REACHED < GOAL_FARTHEST, "who reaches one is near the next"


def test_weights_that_ship_fit_each_other() -> None:
    found = read_trained(None)
    assert (found.student.stage, found.student.config.name) == ("full", "tiny")
    assert found.segmentation is not None
    assert load_agent_class("agents.lav:LavAgent") is LavAgent


def test_missing_and_unfit_weights_are_named_in_one_line(tmp_path: Path) -> None:
    folder = trained(tmp_path / "a")
    (folder / "brake" / "brake.safetensors").unlink()
    with pytest.raises(ConfigError, match=r"no weights at .*brake/brake\.safetensors"):
        LavAgent(str(folder))
    with pytest.raises(ConfigError, match=r"no weights at .*nowhere\.safetensors"):
        LavAgent(str(tmp_path / "nowhere.safetensors"))
    with pytest.raises(ConfigError, match="weights of stage 'segmentation', not 'full'"):
        LavAgent(str(folder / "segmentation" / "segmentation.safetensors"))
    with pytest.raises(ConfigError, match=r"no weights at .*segmentation-micro"):
        LavAgent(str(folder / "full" / "full.safetensors"))
    wide = MICRO.model_copy(update={"name": "wide", "cameras": find_preset("tiny").cameras})
    with pytest.raises(ConfigError, match="'brake' are of preset 'wide', the student's of 'micro': their cameras"):
        LavAgent(str(trained(tmp_path / "b", brake=wide)))


def test_how_it_drives_is_set_beside_its_weights(tmp_path: Path) -> None:
    folder, settings = trained(tmp_path / "a"), tmp_path / "mine.toml"
    settings.write_text(f'weights = "{folder}"\n[drive]\nbrake_score = 0.9\n')
    agent = LavAgent(str(settings))
    assert (agent.config.name, agent.config.drive.brake_score) == ("micro", 0.9)
    assert LavAgent(str(folder)).config.drive == DriveConfig()
    settings.write_text("[drive]\nbreak_score = 0.9\n")
    with pytest.raises(ConfigError, match="break_score"):
        LavAgent(str(settings))


@pytest.mark.parametrize("is_painted", [True, False])
def test_it_drives_some_ticks_on_sensors_alone(tmp_path: Path, is_painted: bool) -> None:
    config = MICRO.model_copy(update={"painted": is_painted})
    folder = trained(tmp_path, config)
    if not is_painted:
        (folder / "segmentation" / "segmentation.safetensors").unlink()
    simulation = Simulation(straight_drive(traffic="lav"))
    agent = InProcessAgent(AgentSpec("agents.lav:LavAgent", str(folder), drawings=True))
    agent.start(plan_of(simulation.route, simulation.town))
    assert agent.track is Track.SENSORS
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    for tick in range(4):
        control = agent.step(suite.read([simulation.snapshot]), 0.05 * tick)
        assert 0.0 <= control.throttle <= 1.0
        assert {"plan", "forecast", "vehicles", "road", "brake"} <= set(checked_all(agent.drawings()))
        simulation.tick(control)
    agent.close()


def test_between_looks_what_was_seen_stays_where_it_was(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    then, now = Pose(np.array([4.0, -2.0]), 0.3), Pose(np.array([4.6, -1.7]), 0.35)
    post, car = rng.uniform(-9.0, 9.0, 2), seen([[1.0, -8.0]], [0.9])
    there = planner_from_world(post, *then)
    assert carried_points(there, then, now) == pytest.approx(planner_from_world(post, *now))
    others = {"vehicle": forecast(0.0, -6.0, 0.5)}
    carried = carried_forecasts(others, then, now)["vehicle"]
    assert carried.boxes[0] == pytest.approx(others["vehicle"].boxes[0] - [0.05, 0.0, 0.0])
    assert carried.paths.shape == others["vehicle"].paths.shape
    scan = np.array([[8.0, 1.0, 0.5, 1.0]], np.float32)  # ahead, right: on the car
    sight = carried_sight(Sight(torch.zeros(0), car, seen([], []), torch.zeros(0), scan), then, now)
    assert sight.vehicles.boxes[0, :2].numpy() == pytest.approx([sight.points[0, 1], -sight.points[0, 0]], abs=1e-5)
    assert sight.vehicles.boxes[0, 1] > -8.0 + 0.5


@pytest.mark.parametrize("look_every", [1, 2, 3])
def test_networks_look_as_often_as_they_are_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, look_every: int
) -> None:
    settings = tmp_path / "mine.toml"
    settings.write_text(f'weights = "{trained(tmp_path / "a")}"\n[drive]\nlook_every = {look_every}\nbrake_every = 2\n')
    ticks: dict[str, list[int]] = {"see": [], "brake": []}
    for name, at in ticks.items():
        method = getattr(Perceiver, name)
        monkeypatch.setattr(
            Perceiver, name, lambda *given, at=at, method=method: (at.append(len(driven)), method(*given))[1]
        )
    simulation, driven = Simulation(straight_drive(traffic="lav")), list[float]()
    agent = InProcessAgent(AgentSpec("agents.lav:LavAgent", str(settings)))
    agent.start(plan_of(simulation.route, simulation.town))
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    for tick in range(7):
        control = agent.step(suite.read([simulation.snapshot]), 0.05 * tick)
        driven.append(control.throttle)
        simulation.tick(control)
    agent.close()
    assert ticks == {"see": list(range(0, 7, look_every)), "brake": [0, 1, 3, 5]}


def test_what_drives_is_what_was_trained(tmp_path: Path) -> None:
    """Frozen networks see what those of the training see, but for half precision."""
    eyes, student = Perceiver(read_trained(trained(tmp_path))), networks(MICRO)["full"].eval()
    points = np.random.default_rng(0).uniform(-8.0, 8.0, (400, 8)).astype(np.float32)
    with torch.inference_mode():
        truth = student.perception(torch.from_numpy(points), torch.zeros(400, dtype=torch.long), 1)
    found = eyes.see(points)
    assert torch.allclose(found.map, truth.map[0], atol=0.05)
    assert torch.allclose(found.features, truth.features, atol=0.1)
