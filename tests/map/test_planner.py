"""Routes, commands and progress."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import floats, integers

from lavsim.errors import RouteError
from lavsim.map.planner import RoutePlanner, get_planner
from lavsim.map.route import Route, RouteTracker, polyline_length
from lavsim.map.town_map import load_town
from lavsim.towns.draw_routes import FILES, draw_file
from lavsim.types import LaneType, RoadOption
from tests import worlds

F, L, S, C = RoadOption.LANEFOLLOW, RoadOption.LEFT, RoadOption.STRAIGHT, RoadOption.CHANGELANELEFT


def of_commands(*runs: tuple[RoadOption, int]) -> Route:
    """A straight route with points 1 m apart."""
    command = np.array([int(option) for option, count in runs for _ in range(count)], np.int8)
    points = np.zeros((len(command), 3))
    points[:, 0] = np.arange(len(command))
    zeros = np.zeros(len(command))
    return Route(points, zeros, command, zeros.astype(np.int32), zeros.copy(), polyline_length(points), points[[0, -1]])


@pytest.mark.parametrize(
    ("start", "goal", "command"),
    [
        ((-40.0, 1.75), (1.75, -40.0), RoadOption.LEFT),
        ((-40.0, 1.75), (-1.75, 40.0), RoadOption.RIGHT),
        ((-40.0, 1.75), (40.0, 1.75), RoadOption.STRAIGHT),
        ((1.75, 40.0), (-40.0, -1.75), RoadOption.LEFT),
        ((40.0, -1.75), (1.75, -40.0), RoadOption.RIGHT),
    ],
)
def test_a_way_over_the_crossing_has_its_command(
    start: tuple[float, float], goal: tuple[float, float], command: RoadOption
) -> None:
    town = worlds.crossing()
    route = get_planner(town).trace([[*start, 0.0], [*goal, 0.0]])
    assert [option for option, _ in route.commands()] == [F, command, F]
    inside = (town.lanes.junction[route.lane] >= 0) & (route.u > 0.0)  # where it begins, the road before ends
    assert (route.command[inside] == command).all()
    assert np.hypot(*(route.xy[0] - start)) < 1.0
    assert np.hypot(*(route.xy[-1] - goal)) < 2.0
    assert np.diff(route.distance).max() <= 2.0


def test_a_route_on_one_road_follows_it_a_metre_at_a_time() -> None:
    route = get_planner(worlds.straight()).trace([[10.0, 1.75, 0.0], [100.0, 1.75, 0.0]])
    assert route.commands() == [(F, len(route))]
    assert np.allclose(np.diff(route.distance), 1.0)
    assert np.allclose(route.points[:, 1], 1.75)
    assert route.keypoint_length == pytest.approx(90.0)


def test_pieces_between_key_points_are_joined() -> None:
    planner = get_planner(worlds.straight())
    route = planner.trace([[10.0, 1.75, 0.0], [50.0, 1.75, 0.0], [100.0, 1.75, 0.0]])
    assert route.length == pytest.approx(planner.trace([[10.0, 1.75, 0.0], [100.0, 1.75, 0.0]]).length, abs=3.0)


def test_a_goal_in_the_other_lane_takes_a_lane_change() -> None:
    route = get_planner(worlds.two_lanes()).trace([[20.0, 1.75, 0.0], [200.0, 5.25, 0.0]])
    assert [(option, count) for option, count in route.commands() if option.is_lane_change] == [
        (RoadOption.CHANGELANERIGHT, 2)
    ]
    change = np.flatnonzero(route.command == RoadOption.CHANGELANERIGHT)
    jump = route.points[change[1]] - route.points[change[0]]
    assert jump[0] == pytest.approx(5.0, abs=1.0)
    assert jump[1] == pytest.approx(3.5)


def test_a_mark_that_forbids_the_change_leaves_no_way() -> None:
    with pytest.raises(
        RouteError, match=r"waypoints 0 and 1: no way leads from lane -1 of road 1 to lane -2 of road 1"
    ):
        get_planner(worlds.two_lanes(lane_change="none")).trace([[20.0, 1.75, 0.0], [200.0, 5.25, 0.0]])


def test_a_key_point_off_the_road_is_named() -> None:
    with pytest.raises(
        RouteError, match=r"waypoint 1 \(100\.0, 58\.9\) is 57\.1 m off the nearest driving lane of straight\."
    ):
        get_planner(worlds.straight()).trace([[10.0, 1.75, 0.0], [100.0, 58.85, 0.0]])
    with pytest.raises(RouteError, match=r"waypoint 0 \(nan, 0\.0\) is no place"):
        get_planner(worlds.straight()).trace([[np.nan, 0.0, 0.0], [100.0, 0.0, 0.0]])


def test_one_key_point_is_no_route() -> None:
    with pytest.raises(RouteError, match="two or more waypoints"):
        get_planner(worlds.straight()).trace([[10.0, 1.75, 0.0]])


@pytest.mark.parametrize(
    ("runs", "near", "far"),
    [
        (((F, 180), (L, 15), (F, 60)), [0, 52, 104, 156, 180, 195, 247, 254], [0, 180, 195, 254]),
        (((F, 40), (C, 2), (F, 70), (S, 20), (F, 5)), [0, 40, 41, 93, 112, 132, 136], [0, 40, 41, 112, 132, 136]),
    ],
)
def test_plans_are_thinned_as_the_leaderboard_does(
    runs: tuple[tuple[RoadOption, int], ...], near: list[int], far: list[int]
) -> None:
    route = of_commands(*runs)
    assert route.thinned(50.0).tolist() == near
    assert route.thinned(200.0).tolist() == far
    assert route.thinned(50.0, keep_first=False).tolist() == near


def test_gps_points_are_those_of_the_leaderboard() -> None:
    route = of_commands((F, 2))
    points = np.array([[100.0, -50.0, 3.0], [1000.0, 2000.0, 0.0]])
    moved = Route(points, route.yaw, route.command, route.lane, route.u, polyline_length(points), points)
    assert moved.gps((0.0, 0.0)) == pytest.approx(
        np.array(
            [[0.0004491576420520005, 0.0008983152841195214, 3.0], [-0.01796630538795796, 0.008983152841195214, 0.0]]
        ),
        abs=1e-12,
    )


@given(places=integers(1, 60), wander=floats(-3.0, 3.0))
@settings(max_examples=30, deadline=None)
def test_the_tracker_never_goes_back(places: int, wander: float) -> None:
    tracker = RouteTracker(of_commands((F, 80)))
    before = 0
    for x in range(places):
        index = tracker.update((float(x), wander))
        assert before <= index <= x
        before = index
    assert before == places - 1
    assert tracker.percentage == pytest.approx(100.0 * (places - 1) / 79.0)
    assert tracker.update((0.0, 0.0)) == before


def test_every_lane_of_a_bundled_town_is_reached_from_every_other() -> None:
    assert nx.is_strongly_connected(get_planner(load_town("eu_small_a")).graph)


def test_routes_are_as_short_as_dijkstra_s() -> None:
    town = load_town("eu_small_a")
    planner = RoutePlanner(town)
    driving = [int(k) for k in town.lanes.where(int(LaneType.DRIVING)) if town.lanes.junction[k] < 0]
    rng = np.random.default_rng(1)
    for start, goal in rng.choice(driving, (30, 2)):
        if start == goal:
            continue
        nodes = planner.search(int(start), int(goal))[:-1]
        length = nx.path_weight(planner.graph, nodes, "length")
        best = nx.dijkstra_path_length(planner.graph, nodes[0], nodes[-1], weight="length")
        assert length == pytest.approx(best, rel=0.02)  # CARLA's heuristic may overestimate by a rounded hop


@pytest.mark.parametrize("name", sorted(FILES))
def test_route_files_are_what_the_script_draws(name: str) -> None:
    from importlib import resources

    town, sketches = FILES[name]
    assert (resources.files("routes") / f"{name}.xml").read_bytes() == draw_file(load_town(town), sketches)
