"""Cloning: what is learnt of a drive, a golden step, measures by hand, a few frames by heart, and a drive."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="cloning needs torch: pip install 'lavsim[lav]'")

from agents.cloning.agent import SHIPPED, CloningAgent, read_cloning
from agents.cloning.measures import measures_of
from agents.cloning.network import LEAST_TOLD, CloningNetwork
from agents.cloning.samples import CloningSamples, read_samples, worth_learning
from agents.cloning.stage import CloningBatch, CloningStage, cloning_loss
from agents.lav.config import LavConfig, find_preset
from agents.lav.frames import planner_from_world
from agents.lav.models.motion import straight_on
from agents.lav.records import CURVE
from agents.lav.stages.base import STAGES, StageInput, StepContext, TrainConfig
from agents.lav.training import train_stage
from agents.lav.weights import Weights, read_weights, write_weights
from lavsim.agent import AgentSpec, Track, plan_of
from lavsim.agent_runner import InProcessAgent
from lavsim.agent_source import load_agent_class, packaged_agents
from lavsim.dataset.reader import Dataset
from lavsim.dataset.schema import DatasetInfo, RecordConfig
from lavsim.drawings import checked_all
from lavsim.errors import ConfigError
from lavsim.random import Draws
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite
from lavsim.simulation import Simulation
from tests.dataset.recorded import SUITE, drive, record
from tests.drives import straight_drive

MICRO = find_preset("micro")
STEPS = MICRO.motion.waypoints
GOLDEN = (1.40882, 0.99003)  # loss of two steps


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A short recorded drive."""
    root = tmp_path_factory.mktemp("drive")
    info = DatasetInfo.of(RecordConfig(SUITE), seed=3)
    info.write(root)
    record(root, 0, info, drive(0), ticks=52)
    return Dataset(root)


def made(speeds: list[float], ends: list[tuple[float, float]], **changes: np.ndarray) -> CloningSamples:
    """Frames of one episode, whose futures run straight to their ends."""
    count = len(speeds)
    share = np.arange(1, STEPS + 1)[:, None] / STEPS
    fields = {
        "places": np.stack([np.zeros(count, np.int64), np.arange(count)], axis=1),
        "futures": np.array([share * end for end in ends], np.float32),
        "speeds": np.array(speeds, np.float32),
        "commands": np.full(count, 3),
        "goals": np.tile(np.array([[0.0, -20.0], [0.0, -40.0]], np.float32), (count, 1, 1)),
        "brakes": np.zeros(count, bool),
        "pushed": np.zeros(count, bool),
    }
    return CloningSamples(**{**fields, **changes})


def inputs(config: LavConfig, count: int = 2) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng, size = np.random.default_rng(4), (config.cameras.height, 3 * config.cameras.width)
    images = torch.from_numpy(rng.integers(0, 256, (count, 3, *size), np.uint8))
    goals = torch.from_numpy(rng.uniform(-20.0, 20.0, (count, 2, 2)).astype(np.float32))
    return images, torch.linspace(2.0, 8.0, count), goals


def moved_from_its_start(network: CloningNetwork) -> CloningNetwork:
    """With goals that count: their input begins as nothing."""
    torch.nn.init.normal_(network.goal.second.weight, std=0.1)
    return network


def test_plans_hang_on_images_places_in_them_speed_and_goals() -> None:
    torch.manual_seed(0)
    network = moved_from_its_start(CloningNetwork(MICRO)).eval()
    images, speeds, goals = inputs(MICRO)
    plans = network(images, speeds, goals)
    assert plans.shape == (2, 6, STEPS, 2)
    others = ((images.flip(3), speeds, goals), (images, speeds + 1.0, goals), (images, speeds, goals + 3.0))
    for other in others:
        assert not torch.allclose(plans, network(*other), atol=1e-4)


def test_who_hardly_moves_is_not_told_so() -> None:
    network = CloningNetwork(MICRO).eval()
    images, _, goals = inputs(MICRO)
    slow, untold = torch.tensor([0.0, LEAST_TOLD - 0.1]), torch.full((2,), math.nan)
    assert torch.equal(network(images, slow, goals), network(images, untold, goals))
    assert not torch.equal(network(images, slow + 1.0, goals), network(images, untold, goals))


def test_a_frame_s_future_is_where_the_ego_drove_on(data: Dataset) -> None:
    samples, table = read_samples(data, MICRO), data.table(0)
    assert len(samples) == data.episodes[0].frames - STEPS
    assert samples.places[:, 1].tolist() == list(range(len(samples)))
    first = planner_from_world(table["position"][1 : STEPS + 1, :2], table["position"][0, :2], float(table["yaw"][0]))
    assert samples.futures[0] == pytest.approx(first, abs=1e-4)
    assert samples.futures[-1, -1, 1] < -1.0, "it drives ahead"
    assert (samples.goals[:, 0, 1] < 0.0).all()
    with pytest.raises(ConfigError, match="frames in a row"):
        read_samples(data, MICRO.model_copy(update={"motion": MICRO.motion.model_copy(update={"waypoints": 400})}))


def test_long_waits_are_learnt_seldom_starts_and_bends_often_and_pushes_never() -> None:
    waits, cruise, start, bend = (0.0, (0.0, 0.0)), (5.0, (0.0, -12.0)), (0.0, (0.0, -4.0)), (5.0, (3.0, -10.0))
    rows = [waits] * 10 + [cruise, start, bend, cruise]
    samples = made(*map(list, zip(*rows, strict=True)), pushed=np.arange(14) == 13)
    times = np.bincount(worth_learning(samples), minlength=14).tolist()
    assert times == [1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 3, 3, 0]


def test_measures_by_hand() -> None:
    stop, go = (0.0, 0.0), (0.0, -STEPS * 1.0)  # 4 m/s
    samples = made([4.0, 4.0, 0.0, 0.0], [go, stop, stop, go], brakes=np.array([False, True, True, False]))
    plans = torch.from_numpy(samples.futures).clone()
    plans[0, :, 0] += 1.0  # a metre aside
    plans[2] = plans[0]  # goes where it should stand
    found = measures_of(plans, samples, MICRO.drive)
    assert found["plan"] == found["plan_lateral"] == found["plan_last"] == pytest.approx(1.0)
    assert found["constant_velocity"] == pytest.approx(0.0, abs=1e-6)
    assert (found["frames"], found["recall"], found["recall_driving"]) == (1.0, 0.5, 1.0)
    assert (found["waits"], found["starts"], found["false_stops"]) == (0.0, 1.0, 0.0)


def test_a_step_is_what_it_was() -> None:
    torch.manual_seed(3)
    network = CloningNetwork(MICRO).train()
    optimiser, found = torch.optim.Adam(network.parameters(), lr=1e-2), []
    images, speeds, goals = inputs(MICRO, 8)
    batch = CloningBatch(images, speeds, goals, torch.arange(8) % 6, straight_on(speeds - 1.0, STEPS))
    for step in range(2):
        torch.manual_seed(step)
        loss = cloning_loss(network(*batch[:3]), batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        found.append(loss.item())
    assert found == pytest.approx(GOLDEN, rel=1e-3)


def test_only_the_commanded_branch_learns() -> None:
    network = CloningNetwork(MICRO)
    images, speeds, goals = inputs(MICRO, 4)
    batch = CloningBatch(images, speeds, goals, torch.full((4,), 1), straight_on(speeds, STEPS))
    cloning_loss(network(*batch[:3]), batch).backward()
    assert network.branches.out_bias.grad is not None
    learns = (network.branches.out_bias.grad != 0.0).any(dim=1)
    assert learns.tolist() == [False, True, False, False, False, False]


def test_a_training_that_was_killed_goes_on_to_the_same_bits(data: Dataset, tmp_path: Path) -> None:
    train = TrainConfig(batch=4, epochs=2.0, learning_rate=1e-2, save_every=2)
    assert STAGES["cloning"] is CloningStage

    def stage() -> CloningStage:
        return CloningStage(StageInput(MICRO, train, data, data))

    whole = train_stage("cloning", stage(), MICRO, train, tmp_path / "whole")
    for stop in (1, 2, None):
        pieces = train_stage("cloning", stage(), MICRO, train, tmp_path / "pieces", stop_at=stop)
    assert whole is not None
    assert pieces is not None
    first, second = read_weights(whole), read_weights(pieces)
    assert all(torch.equal(first.tensors[name], second.tensors[name]) for name in first.tensors)
    assert (tmp_path / "whole" / CURVE).read_text() == (tmp_path / "pieces" / CURVE).read_text()
    assert {"plan", "constant_velocity"} <= set(first.lineage["measures"])
    assert (tmp_path / "whole" / "pictures" / "unseen.png").exists()


def untrained(path: Path, stage: str = "cloning") -> Path:
    torch.manual_seed(1)
    write_weights(path, Weights(stage, MICRO, CloningNetwork(MICRO).state_dict()))
    return path


def test_missing_and_unfit_weights_are_named_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no weights at .*nowhere\.safetensors"):
        CloningAgent(str(tmp_path / "nowhere.safetensors"))
    with pytest.raises(ConfigError, match=r"no weights at .*cloning/cloning\.safetensors"):
        CloningAgent(str(tmp_path))
    with pytest.raises(ConfigError, match="weights of stage 'brake', not 'cloning'"):
        CloningAgent(str(untrained(tmp_path / "w.safetensors", "brake")))


def test_it_drives_five_seconds_on_sensors_alone(tmp_path: Path) -> None:
    untrained(tmp_path / "cloning" / "cloning.safetensors")
    simulation = Simulation(straight_drive(traffic="lav", vehicles=10))
    agent = InProcessAgent(AgentSpec("agents.cloning:CloningAgent", str(tmp_path), drawings=True))
    agent.start(plan_of(simulation.route, simulation.town))
    assert agent.track is Track.SENSORS
    assert not any("lidar" in sensor["type"] for sensor in agent.sensors())
    suite = SensorSuite(get_scene(simulation.town), agent.sensors(), simulation.draws)
    for tick in range(100):
        control = agent.step(suite.read([simulation.snapshot]), 0.05 * tick)
        assert 0.0 <= control.throttle <= 1.0
        assert -1.0 <= control.steer <= 1.0
        assert {"plan", "planned speed", "held"} <= set(checked_all(agent.drawings()))
        simulation.tick(control)
    agent.close()


def test_weights_ship_and_the_agent_is_listed() -> None:
    weights = read_cloning(None)
    assert (weights.stage, weights.config.name) == ("cloning", "tiny")
    assert SHIPPED.stat().st_size < 3_000_000
    assert load_agent_class("agents.cloning:CloningAgent") is CloningAgent
    assert dict(packaged_agents())["agents.cloning:CloningAgent"]


@pytest.mark.slow
def test_frames_are_learnt_by_heart(data: Dataset) -> None:
    brake = MICRO.brake.model_copy(update={"width": 8})
    config = MICRO.model_copy(update={"brake": brake, "cameras": find_preset("tiny").cameras})
    stage = CloningStage(StageInput(config, TrainConfig(batch=8), data))
    batch = stage.load(np.arange(len(stage))[-8:], Draws(0))
    optimiser = torch.optim.Adam(stage.network.parameters(), lr=3e-3)
    for step in range(150):
        stage.network.train()
        loss, _ = stage.loss(batch, StepContext(Draws(step), 0.0))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert loss.item() < 0.1
