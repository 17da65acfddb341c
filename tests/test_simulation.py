"""One drive: repeatable, logged exactly, and undisturbed by what it does not perceive."""

import json
from pathlib import Path

import numpy as np
import pytest

from lavsim.errors import RouteError, UnknownName
from lavsim.log.reader import LogReader
from lavsim.log.replay import route_of, town_of
from lavsim.log.writer import LogWriter
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import ActorIds, Control, Role
from lavsim.world.lights import LightCycle
from lavsim.world.weather import Weather, WeatherKeyframe
from tests.drives import follow, hazard, run, straight_drive
from tests.map.xodr import road


class Result:
    def summary(self) -> dict[str, str]:
        return {"ending": "tick limit"}


def record(path: Path, ticks: int = 150, **changes: object) -> list[bytes]:
    simulation = Simulation(straight_drive(traffic="lav", **changes))
    writer = LogWriter(path)
    writer.start(simulation)
    seen = []
    for _ in range(ticks):
        snapshot = simulation.snapshot
        writer.observe(snapshot)
        seen.append(snapshot.pose.tobytes() + snapshot.control.tobytes() + snapshot.ego_motion.tobytes())
        simulation.tick(follow(simulation.route, snapshot))
    writer.finish(Result())  # type: ignore[arg-type]
    return seen


def test_the_ego_stands_at_the_start_of_its_route() -> None:
    simulation = Simulation(straight_drive())
    snapshot = simulation.snapshot
    assert snapshot.tick == 1
    assert snapshot.ego.speed == 0.0
    assert np.hypot(*(snapshot.ego.xy - simulation.route.xy[0])) < 0.01
    assert snapshot.roles[0] == Role.EGO
    assert snapshot.ids[0] == ActorIds.EGO


def test_one_seed_gives_one_log_and_the_log_what_was_seen(tmp_path: Path) -> None:
    seen = record(tmp_path / "a.lavlog")
    record(tmp_path / "b.lavlog")
    assert (tmp_path / "a.lavlog").read_bytes() == (tmp_path / "b.lavlog").read_bytes()
    record(tmp_path / "c.lavlog", seed=1)
    assert (tmp_path / "a.lavlog").read_bytes() != (tmp_path / "c.lavlog").read_bytes()
    reader = LogReader(tmp_path / "a.lavlog")
    assert [s.pose.tobytes() + s.control.tobytes() + s.ego_motion.tobytes() for s in reader] == seen
    town = town_of(reader)
    assert np.array_equal(route_of(reader, town).points, Simulation(straight_drive()).route.points)


def test_a_hazard_leaves_spawns_and_drivers_as_they_were() -> None:
    without = run(straight_drive(traffic="lav"), 60, lambda s: Control(brake=1.0))
    spec = hazard("DynamicObjectCrossing", 40, distance="20")
    with_hazard = run(straight_drive(traffic="lav", scenarios=(spec,)), 60, lambda s: Control(brake=1.0))
    for a, b in zip(without, with_hazard, strict=True):
        mine = b.ids < ActorIds.SCENARIOS
        assert np.array_equal(a.ids, b.ids[mine])
        assert np.array_equal(a.pose, b.pose[mine])


def test_the_control_of_the_log_is_the_one_applied() -> None:
    simulation = Simulation(straight_drive())
    snapshot = simulation.tick(Control(throttle=0.7, steer=0.1))
    assert snapshot.control.tolist() == [np.float32(0.7), np.float32(0.1), 0.0, 0.0, 0.0]


def test_weather_follows_the_route() -> None:
    frames = (WeatherKeyframe(0.0, Weather(cloudiness=0.0)), WeatherKeyframe(100.0, Weather(cloudiness=100.0)))
    snapshots = run(straight_drive(weather=frames), 200)
    assert snapshots[0].weather.cloudiness == 0.0
    assert 10.0 < snapshots[-1].weather.cloudiness < 100.0


def test_wrong_names_and_places_are_named() -> None:
    with pytest.raises(UnknownName, match="Did you mean 'eu_small_a'"):
        Simulation(straight_drive(town="eu_smal_a"))
    with pytest.raises(UnknownName, match="no traffic profile 'rush'"):
        straight_drive(traffic="rush")
    with pytest.raises(RouteError, match="off the nearest driving lane"):
        Simulation(straight_drive(keypoints=np.array([[9000.0, 9000.0, 0.0], [9100.0, 9000.0, 0.0]])))


def test_a_header_holds_all_that_decides_a_drive() -> None:
    spec = straight_drive(
        traffic="lav",
        vehicles=12,
        seed=5,
        jaywalking=0.25,
        light_cycle=LightCycle(6.0, 2.0, 1.0),
        weather=(WeatherKeyframe(0.0, Weather()), WeatherKeyframe(100.0, Weather(precipitation=80.0))),
        scenarios=(hazard("DynamicObjectCrossing", 40, distance="20"),),
    )
    first = Simulation(spec)
    again = Simulation(DriveSpec.from_header(json.loads(json.dumps(first.header()))))
    assert again.header() == first.header()
    for _ in range(100):
        control = follow(first.route, first.snapshot)
        assert first.tick(control).pose.tobytes() == again.tick(control).pose.tobytes()


def test_vehicles_lean_with_the_hill_they_drive_on(tmp_path: Path) -> None:
    profile = '<elevationProfile><elevation s="0" a="0" b="0.08" c="0" d="0"/></elevationProfile>'
    text = "<OpenDRIVE>" + road(length=200.0, before=profile) + "</OpenDRIVE>"
    (tmp_path / "hill.xodr").write_text(text, encoding="utf-8")
    climb = [(10.0, 1.75, 0.8), (190.0, 1.75, 15.2)]
    drive = {"town": "hill", "town_path": (tmp_path,), "route_id": "up", "traffic": "empty"}
    up = Simulation(DriveSpec(keypoints=np.array(climb), **drive))
    for _ in range(5):
        snapshot = up.tick(Control(throttle=0.7))
    assert snapshot.pitch[0] == pytest.approx(np.arctan(0.08), abs=1e-4)
    assert snapshot.xyz[0, 2] == pytest.approx(0.08 * snapshot.xyz[0, 0], abs=0.002)
