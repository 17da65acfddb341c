"""Routes, commands and progress."""

from __future__ import annotations

from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis.strategies import DrawFn, composite, floats, integers, lists, tuples

from lavsim.errors import RouteError
from lavsim.map.planner import RoutePlanner, get_planner, shortest_way
from lavsim.map.route import Route, RouteTracker, polyline_length
from lavsim.map.town_files import load_town
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


def over_estimate(graph: nx.DiGraph[int], best: list[int]) -> float:
    """How much more than the rest of the best way the straight line to its end is, at most."""
    goal = np.array(graph.nodes[best[-1]]["vertex"])
    straight = [float(np.linalg.norm(np.array(graph.nodes[node]["vertex"]) - goal)) for node in best]
    rest = [nx.path_weight(graph, best[k:], "length") for k in range(len(best))]
    return max(0.0, *(line - left for line, left in zip(straight, rest, strict=True)))


@given(start=integers(0, 10**6), goal=integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_routes_are_longer_than_dijkstra_s_by_no_more_than_the_heuristic_over_estimates(start: int, goal: int) -> None:
    town = load_town("eu_small_a")
    planner = get_planner(town)
    driving = [int(k) for k in town.lanes.where(int(LaneType.DRIVING)) if town.lanes.junction[k] < 0]
    nodes = planner.search(driving[start % len(driving)], driving[goal % len(driving)])[:-1]
    best = nx.dijkstra_path(planner.graph, nodes[0], nodes[-1], weight="length")
    cost, least = (nx.path_weight(planner.graph, way, "length") for way in (nodes, best))
    assert least <= cost <= least + over_estimate(planner.graph, best)


@composite
def small_graphs(draw: DrawFn) -> nx.DiGraph[int]:
    """Up to 7 nodes in a plane, edges not shorter than the straight line."""
    count = draw(integers(2, 7))
    graph: nx.DiGraph[int] = nx.DiGraph()
    for node in range(count):
        x, y = draw(tuples(integers(0, 20), integers(0, 20)))
        graph.add_node(node, vertex=(float(x), float(y), 0.0))
    for a, b in draw(lists(tuples(integers(0, count - 1), integers(0, count - 1)), max_size=24)):
        straight = float(np.linalg.norm(np.subtract(graph.nodes[a]["vertex"], graph.nodes[b]["vertex"])))
        if a != b:
            graph.add_edge(a, b, length=int(np.ceil(straight)) + draw(integers(0, 9)))
    return graph


@given(graph=small_graphs())
@settings(max_examples=150, deadline=None)
def test_the_way_found_is_the_shortest_of_all_ways(graph: nx.DiGraph[int]) -> None:
    goal = len(graph) - 1
    costs = [nx.path_weight(graph, way, "length") for way in nx.all_simple_paths(graph, 0, goal)]
    if not costs:
        with pytest.raises(nx.NetworkXNoPath):
            shortest_way(graph, 0, goal)
    else:
        assert nx.path_weight(graph, shortest_way(graph, 0, goal), "length") == min(costs)


def somewhere(planner: RoutePlanner, share: float, along: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """A place on a lane outside junctions, off its ends."""
    lanes = planner.town.lanes
    roads = [k for k in lanes.where(int(LaneType.DRIVING)).tolist() if lanes.junction[k] < 0 and lanes.length[k] > 12.0]
    lane = roads[min(int(share * len(roads)), len(roads) - 1)]
    return planner.town.waypoint_at(lane, 5.0 + along * (float(lanes.length[lane]) - 10.0)).xyz


PLACES = tuples(floats(0.0, 1.0), floats(0.0, 1.0))


@given(start=PLACES, goal=PLACES)
@settings(max_examples=40, deadline=None)
def test_the_points_of_a_route_are_continuous(start: tuple[float, float], goal: tuple[float, float]) -> None:
    planner = get_planner(load_town("eu_small_a"))
    route = planner.trace([somewhere(planner, *start), somewhere(planner, *goal)])
    assert np.isfinite(route.points).all()
    assert (route.command != RoadOption.VOID).all()
    assert np.diff(route.distance).max(initial=0.0) < 2.1
    turned = np.abs(np.angle(np.exp(1j * np.diff(route.yaw))))
    assert turned.max(initial=0.0) < 0.5
    assert planner.town.nearest(route.points).distance.max() < 0.01
    assert (planner.town.centre(route.lane, route.u)[:, :3] == route.points).all()


def ways_between(planner: RoutePlanner, route: Route) -> list[list[int]]:
    """What is searched from each key point of a route to the next."""
    lanes = [place.lane for place in planner.locate(route.keypoints)]
    return [planner.search(start, goal) for start, goal in pairwise(lanes)]


def is_part(piece: list[int], whole: list[int]) -> bool:
    return any(whole[k : k + len(piece)] == piece for k in range(len(whole)))


@given(start=PLACES, goal=PLACES, shares=lists(floats(0.0, 1.0), min_size=1, max_size=5))
@settings(max_examples=40, deadline=None)
def test_more_key_points_on_a_route_leave_its_commands_unless_they_change_the_way(
    start: tuple[float, float], goal: tuple[float, float], shares: list[float]
) -> None:
    planner = get_planner(load_town("eu_small_a"))
    route = planner.trace([somewhere(planner, *start), somewhere(planner, *goal)])
    lanes = planner.town.lanes
    usable = (lanes.junction[route.lane] < 0) & (route.u > 3.0) & (route.u < lanes.length[route.lane] - 3.0)
    chosen = sorted({int(share * (len(route) - 1)) for share in shares} & set(np.flatnonzero(usable).tolist()))
    assume(chosen)
    finer = planner.trace([route.keypoints[0], *route.points[chosen], route.keypoints[-1]])
    [whole] = ways_between(planner, route)
    assume(all(is_part(piece, whole) for piece in ways_between(planner, finer)))
    assert [option for option, _ in finer.commands()] == [option for option, _ in route.commands()]
    assert finer.length == pytest.approx(route.length, abs=3.0 * len(chosen))


def test_a_key_point_on_a_route_can_change_the_way_by_what_carla_over_estimates() -> None:
    planner = get_planner(load_town("eu_small_a"))
    keypoints = [somewhere(planner, 0.0, 0.0), somewhere(planner, 0.375, 0.5)]
    route = planner.trace(keypoints)
    finer = planner.trace([keypoints[0], route.points[int(0.8125 * (len(route) - 1))], keypoints[1]])
    [whole], [first, _] = ways_between(planner, route), ways_between(planner, finer)
    assert not is_part(first, whole)
    shorter = whole[: whole.index(first[-2]) + 1]
    assert nx.path_weight(planner.graph, first[:-1], "length") > nx.path_weight(planner.graph, shorter, "length")


def test_what_was_decided_is_forgotten_between_routes() -> None:
    planner = get_planner(worlds.crossing())
    inside = [[-40.0, 1.75, 0.0], [0.0, 1.75, 0.0]]  # ends within the crossing
    turn = [[-40.0, 1.75, 0.0], [1.75, -40.0, 0.0]]
    before = planner.trace(turn)
    planner.trace(inside)
    assert (planner.trace(turn).command == before.command).all()


def test_a_key_point_inside_a_crossing_costs_the_command_as_in_carla() -> None:
    route = get_planner(worlds.crossing()).trace([[-40.0, 1.75, 0.0], [0.0, 1.75, 0.0], [40.0, 1.75, 0.0]])
    assert [option for option, _ in route.commands()] == [F, S, F]
    before, behind = (int(np.argmin(np.abs(route.points[:, 0] - x))) for x in (-4.0, 4.0))
    assert route.command[before] == S
    assert route.command[behind] == F


def test_a_key_point_where_lanes_of_a_crossing_run_together_causes_no_detour() -> None:
    town = load_town("eu_small_a")
    lanes, planner = town.lanes, get_planner(town)
    merging = 0
    for after in lanes.where(int(LaneType.DRIVING)).tolist():
        ways = lanes.predecessors(after).tolist()
        if len(ways) < 2 or lanes.junction[ways[0]] < 0 or lanes.length[after] < 40.0 or merging > 20:
            continue
        together = town.waypoint_at(ways[0], float(lanes.length[ways[0]]) - 0.05).xyz
        target = town.waypoint_at(after, 30.0).xyz
        for way in ways:
            before = int(lanes.predecessors(way)[0])
            start = town.waypoint_at(before, float(lanes.length[before]) / 2.0).xyz
            direct, through = planner.trace([start, target]), planner.trace([start, together, target])
            assert through.length == pytest.approx(direct.length, abs=3.0)
            merging += 1
    assert merging > 20


@pytest.mark.parametrize(("window", "reached"), [(5, 5), (20, 20)])
def test_the_tracker_looks_no_farther_than_its_window(window: int, reached: int) -> None:
    tracker = RouteTracker(of_commands((F, 80)), window)
    assert tracker.update((40.0, 0.0)) == reached
    assert tracker.update((40.0, 0.0)) == min(2 * reached, 40)


def test_the_tracker_takes_the_later_of_equally_near_points_and_ends_at_100_percent() -> None:
    tracker = RouteTracker(of_commands((F, 10)))
    assert tracker.update((2.5, 0.0)) == 3
    for x in range(3, 12):
        tracker.update((float(x), 0.0))
    assert tracker.index == 9
    assert tracker.percentage == 100.0
