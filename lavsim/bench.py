"""The figures of the performance budget on this machine (`lavsim bench`).

The scene is `us_large_a` with 100 vehicles and 50 walkers. Everything runs on one core, and each figure is the median
of several rounds, because machines are noisy.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from lavsim.dataset.pace import collect_pace, render_pace
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.render.scene import get_scene
from lavsim.sensors.base import SensorSuite, make_sensor
from lavsim.sensors.suites import SUITES, with_look
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control

TOWN = "us_large_a"
VEHICLES, WALKERS = 100, 50
_ROUNDS = 5
_WARM_UP = 100  # ticks, until traffic moves


def bench() -> dict[str, float]:
    """Measures all figures; keys as in DESIGN section 6, those that exist so far."""
    _pin_to_one_core()
    town = load_town(TOWN)
    simulation = Simulation(bench_drive(town))
    for _ in range(_WARM_UP):
        simulation.tick(Control(brake=1.0))
    scene = get_scene(town)
    suite = SensorSuite(scene, SUITES["lav"], simulation.draws)
    full = SensorSuite(scene, with_look(SUITES["lav"], "full"), simulation.draws)

    def world_and(suite: SensorSuite) -> None:
        simulation.tick(Control(brake=1.0))
        suite.read(simulation.recent(suite.history + 1))

    return {
        "world_ticks_per_s": 1.0 / _median_seconds(lambda: simulation.tick(Control(brake=1.0)), 400),
        "suite_ticks_per_s": 1.0 / _median_seconds(lambda: world_and(suite), 40),
        "suite_full_ticks_per_s": 1.0 / _median_seconds(lambda: world_and(full), 20),
        "collect_frames_per_s": collect_pace().frames_per_s,
        "log_frames_per_s": collect_pace(log_only=True).frames_per_s,
        "render_frames_per_s": render_pace().frames_per_s,
        "lidar_ms": 1e3 * _sensor_seconds(simulation, {"type": "sensor.lidar.ray_cast", "id": "lidar", "z": 2.4}),
        "camera_ms": 1e3
        * _sensor_seconds(
            simulation,
            {"type": "sensor.camera.rgb", "id": "camera", "x": 1.5, "z": 2.4, "width": 256, "height": 288, "fov": 64},
        ),
        "bev_ms": 1e3 * _sensor_seconds(simulation, {"type": "sensor.lavsim.bev", "id": "bev"}),
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        / (1024 if sys.platform == "linux" else 2**20),
    }


def bench_drive(town: TownMap) -> DriveSpec:
    """The bench scene: the ego at rest on the first driving lane outside junctions that is long enough."""
    lanes = town.lanes
    lane = int(np.flatnonzero((lanes.junction < 0) & (lanes.type == 2) & (lanes.length > 60.0))[0])
    ends = town.centre(np.array([lane, lane]), np.array([10.0, 50.0]))[:, :3]
    get_planner(town)
    counts: dict[str, Any] = {"vehicles": VEHICLES, "walkers": WALKERS, "parked": 0.0}
    return DriveSpec(town=town.name, route_id="bench", keypoints=ends, traffic="lav", **counts)


def _sensor_seconds(simulation: Simulation, sensor: dict[str, object]) -> float:
    """Median time of a reading, a new tick before each so that nothing is remembered."""
    scene, reader = get_scene(simulation.town), make_sensor(sensor)
    times = []
    for _ in range(60):
        simulation.tick(Control(brake=1.0))
        recent = simulation.recent(reader.history + 1)
        begun = time.perf_counter()
        reader.read(recent, scene, simulation.draws)
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


def _median_seconds(work: Callable[[], object], count: int) -> float:
    """Median over rounds of the mean time of one call [s]; the first round only warms up."""
    rounds = []
    for _ in range(_ROUNDS + 1):
        begun = time.perf_counter()
        for _ in range(count):
            work()
        rounds.append((time.perf_counter() - begun) / count)
    return float(np.median(rounds[1:]))


def _pin_to_one_core() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
