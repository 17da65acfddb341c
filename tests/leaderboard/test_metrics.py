"""Measures beside the score: distances and times to contact, smoothness, success, abilities."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from lavsim.types import DT
from leaderboard.abilities import ABILITIES, is_success, run_metrics
from leaderboard.contact_time import nearest_contact, nearest_contact_around
from leaderboard.metrics import DriveMetrics, MetricsObserver, smoothness
from leaderboard.score import RouteRecord, Scores
from tests.leaderboard.worlds import Strip, StripTown, ego_at, straight_route
from tests.snapshots import Body

Box = tuple[float, float, float, float, float]  # x, y, yaw, length, width


def contact(boxes: list[Box], velocities: list[tuple[float, float]], horizon: float = 1.5) -> tuple[float, float]:
    array = np.array(boxes, np.float64)
    sizes = array[:, 3:].astype(np.float32)
    return nearest_contact(array[:, :2], array[:, 2], np.array(velocities, np.float64), sizes, horizon)


def polygon(box: Box) -> shapely.Polygon:
    x, y, yaw, length, width = box
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (length / 2.0, width / 2.0)
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    return shapely.Polygon(corners @ turn + (x, y))


boxes = st.tuples(
    st.floats(-20, 20), st.floats(-20, 20), st.floats(-4, 4), st.floats(0.5, 9.0), st.floats(0.5, 3.0)
)  # fmt: skip


@given(boxes, boxes)
@settings(max_examples=200, deadline=None)
def test_distances_are_those_of_shapely(first: Box, second: Box) -> None:
    distance, _ = contact([first, second], [(0.0, 0.0), (0.0, 0.0)])
    assert distance == pytest.approx(polygon(first).distance(polygon(second)), abs=1e-5)


def test_time_to_contact_is_that_of_the_gap() -> None:
    ego, ahead = (0.0, 0.0, 0.0, 4.0, 2.0), (14.0, 0.0, 0.0, 4.0, 2.0)
    assert contact([ego, ahead], [(10.0, 0.0), (0.0, 0.0)]) == (pytest.approx(10.0), pytest.approx(1.0, abs=0.05))
    assert contact([ego, ahead], [(5.0, 0.0), (0.0, 0.0)])[1] == math.inf, "beyond the horizon"
    assert contact([ego, (14.0, 4.0, 0.0, 4.0, 2.0)], [(10.0, 0.0), (0.0, 0.0)])[1] == math.inf, "passes beside it"
    assert contact([ego], [(10.0, 0.0)]) == (math.inf, math.inf)


@given(st.lists(st.tuples(boxes, st.floats(-2, 2), st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=6))
@settings(max_examples=100, deadline=None)
def test_the_search_around_the_ego_leaves_out_those_beyond_alone(
    actors: list[tuple[Box, float, float, float]],
) -> None:
    xyz = np.array([[*box[:2], z] for box, z, _, _ in actors])
    yaw = np.array([box[2] for box, *_ in actors])
    velocity = np.array([[vx, vy, 0.0] for *_, vx, vy in actors])
    sizes = np.array([[*box[3:], 1.5] for box, *_ in actors], np.float32)
    near = (np.abs(xyz - xyz[0]) < (15.0, 15.0, 1.0)).all(axis=1)
    near[0] = True
    expected = nearest_contact(xyz[near, :2], yaw[near], velocity[near, :2], sizes[near, :2], 1.5)
    assert nearest_contact_around(xyz, yaw, velocity, sizes, 15.0, 1.0, 1.5) == expected
    alone = [nearest_contact(xyz[[0, k], :2], yaw[[0, k]], velocity[[0, k], :2], sizes[[0, k], :2], 1.5)
             for k in np.flatnonzero(near) if k > 0]  # fmt: skip
    assert expected == tuple(np.min([*alone, (math.inf, math.inf)], axis=0))


def observed(snapshots: list[Any], junction: int = -1) -> DriveMetrics:
    town, route = StripTown([Strip(limit=10.0, junction=junction)]), straight_route()
    route.lane = np.zeros(len(route.points), np.int32)
    observer = MetricsObserver()
    observer.watch(town, route)  # type: ignore[arg-type]
    for snapshot in snapshots:
        observer.observe(snapshot)
    return observer.metrics()


def test_a_drive_is_measured() -> None:
    snapshots = [ego_at(0.6 * k, tick=k, speed=12.0, others=[Body(7, x=40.0, y=3.0)]) for k in range(100)]
    found = observed(snapshots)
    assert found.mean_speed == pytest.approx(12.0, abs=0.01)
    assert found.speeding_seconds == pytest.approx(100 * DT)
    assert found.top_excess == pytest.approx(2.0, abs=0.01)
    assert found.least_distance is not None
    assert 0.5 < found.least_distance < 1.5
    assert found.critical_seconds == 0.0
    assert found.first_junction is None


def test_a_near_miss_is_told() -> None:
    snapshots = [ego_at(0.5 * k, tick=k, speed=10.0, others=[Body(7, x=40.0)]) for k in range(60)]
    found = observed(snapshots)
    assert found.least_contact_time is not None
    assert found.least_contact_time < 1.0
    assert 0.5 < found.critical_seconds < 2.0


def test_a_drive_without_a_tick_has_no_measures() -> None:
    assert observed([], junction=0) == DriveMetrics(first_junction=8.0)


def test_smoothness_counts_comfortable_pieces() -> None:
    still = np.zeros(200)
    assert smoothness(still, still, still) == 1.0
    rough = still.copy()
    rough[40:80] = 5.0  # the second of five pieces of 2 s: out of bounds
    share = smoothness(rough, still, still)
    assert share is not None
    assert share == pytest.approx(0.8)
    assert smoothness(still, still, np.full(200, 1.0)) == 0.0
    assert smoothness(still[:30], still[:30], still[:30]) is None


def record(status: str = "Completed", route: float = 100.0, **infractions: int) -> RouteRecord:
    texts = {key: ("text",) * count for key, count in infractions.items()}
    return RouteRecord(0, "RouteScenario_0", status, Scores(route, 1.0, route), texts, 150.0)


def test_success_forgives_slowness_alone() -> None:
    assert is_success(record(min_speed_infractions=3))
    assert not is_success(record(red_light=1))
    assert not is_success(record("Failed - Agent got blocked"))


def test_abilities_are_rated_by_type() -> None:
    drives = [
        {"scenarios": ["Accident"], "metrics": {"efficiency": 120.0, "smoothness": 0.5}},
        {"scenarios": ["Accident"], "metrics": {"efficiency": None, "smoothness": 1.0}},
        {"scenarios": ["T_Junction"], "metrics": {"first_junction": 40.0}},
    ]
    records = [record(), record(red_light=1), record("Failed", 60.0, collisions_vehicle=1)]
    found = run_metrics(records, drives, 4)
    assert found["success_rate"] == pytest.approx(25.0)
    assert found["efficiency"] == pytest.approx(120.0)
    assert found["smoothness"] == pytest.approx(75.0)
    assert found["abilities"] == {"Overtaking": 50.0, "Traffic signs": 100.0, "Mean": 75.0}
    ran = run_metrics([record("Failed", 60.0, stop_infraction=1)], drives[2:], 1)
    assert ran["abilities"]["Traffic signs"] == 0.0


def test_every_type_of_an_ability_is_named_once() -> None:
    assert all(len(set(types)) == len(types) for types in ABILITIES.values())
