"""Short drives in `eu_small_a` for tests that need a whole simulation."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import ScenarioSpec
from lavsim.simulation import DriveSpec, Simulation
from lavsim.types import Control, LaneType
from lavsim.world.snapshot import Snapshot

TOWN = "eu_small_a"


@cache
def long_lane() -> int:
    """The longest driving lane outside junctions."""
    lanes = load_town(TOWN).lanes
    outside = (lanes.type == LaneType.DRIVING) & (lanes.junction < 0)
    return int(np.argmax(np.where(outside, lanes.length, 0.0)))


@cache
def straight_route() -> Route:
    """Along the longest lane, without a junction."""
    town = load_town(TOWN)
    lane = long_lane()
    ends = town.centre(np.array([lane, lane]), np.array([5.0, town.lanes.length[lane] - 5.0]))[:, :3]
    return get_planner(town).trace(ends)


def hazard(type_name: str, index: int, generation: str = "2.x", **parameters: Any) -> ScenarioSpec:
    """A hazard triggered at point `index` of `straight_route`."""
    route = straight_route()
    x, y, z = (float(v) for v in route.points[index])
    return ScenarioSpec(f"{type_name}_1", type_name, generation, (x, y, z, float(route.yaw[index])), parameters)


def straight_drive(**changes: Any) -> DriveSpec:
    """A drive of `straight_route` without traffic; `changes` replaces fields."""
    fields = {"town": TOWN, "route_id": "straight", "keypoints": straight_route().keypoints, "traffic": "empty"}
    return DriveSpec(**{**fields, **changes})


def follow(route: Route, snapshot: Snapshot, speed: float = 8.0) -> Control:
    """A blind driver: keeps to the route, ignores everybody."""
    ego = snapshot.ego
    nearest = int(np.argmin(np.hypot(*(route.xy - ego.xy).T)))
    aim = route.xy[min(nearest + 5, len(route) - 1)] - ego.xy
    angle = np.arctan2(aim[1], aim[0]) - ego.yaw
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return Control(throttle=0.75 if ego.speed < speed else 0.0, steer=float(np.clip(1.5 * angle, -1.0, 1.0)))


def run(spec: DriveSpec, ticks: int, driver: Callable[[Snapshot], Control] | None = None) -> list[Snapshot]:
    """Snapshots of the first `ticks` ticks under `driver`, a blind one by default."""
    simulation = Simulation(spec)
    snapshots = [simulation.snapshot]
    for _ in range(ticks):
        control = driver(simulation.snapshot) if driver else follow(simulation.route, simulation.snapshot)
        snapshots.append(simulation.tick(control))
    return snapshots
