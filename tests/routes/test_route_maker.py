"""Made routes keep what was wished, and follow from the seed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lavsim.errors import ConfigError, RouteError
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.random import Draws
from lavsim.types import LaneType
from leaderboard.route_check import check_entry
from leaderboard.route_maker import (
    AFTER_START,
    APART,
    BEFORE_JUNCTION,
    RouteWish,
    entry_of,
    hazard_places,
    make_routes,
    with_hazards,
)
from leaderboard.route_writer import write_routes
from leaderboard.routes import read_routes
from tests import worlds


@pytest.mark.parametrize("town", ["eu_small_a", "us_large_a"])
def test_made_routes_keep_to_the_wish(town: str) -> None:
    loaded = load_town(town)
    wish = RouteWish(4, 500.0, 1000.0, seed=9)
    entries = make_routes(loaded, wish)
    assert [entry.id for entry in entries] == ["0", "1", "2", "3"]
    for entry in entries:
        route = get_planner(loaded).trace(entry.keypoints)
        assert 500.0 <= route.length <= 1000.0
        assert check_entry(entry) == []
        lanes = [int(route.lane[0])] + [int(b) for a, b in pairwise(route.lane.tolist()) if a != b]
        assert len(set(lanes)) == len(lanes), "a lane is driven twice"
        ends = loaded.nearest(entry.keypoints[[0, -1]])
        assert (loaded.lanes.junction[ends.lane] < 0).all()
        assert (ends.distance < 0.01).all()


def test_made_routes_follow_from_the_seed() -> None:
    town = load_town("eu_small_a")
    first, again, other = (write_routes(make_routes(town, RouteWish(3, seed=s))) for s in (4, 4, 5))
    assert first == again
    assert first != other


def test_a_wish_for_no_stop_sign_is_kept() -> None:
    town = load_town("us_large_a")
    stops = {lane for sign in town.signs if sign.kind == "stop" for lane in sign.lanes}
    assert stops
    for entry in make_routes(town, RouteWish(6, most_stops=0)):
        assert not stops & set(get_planner(town).trace(entry.keypoints).lane.tolist())


@pytest.mark.parametrize("wish", [(0, 500.0, 900.0), (1, 900.0, 500.0), (1, 10.0, 500.0), (2000, 500.0, 900.0)])
def test_impossible_wishes_are_refused(wish: tuple[int, float, float]) -> None:
    with pytest.raises(ConfigError):
        RouteWish(*wish)


def test_a_town_without_such_ways_says_so() -> None:
    with pytest.raises(RouteError, match=r"straight has ways for 0 routes of 5000 to 9000 m, not for 2\."):
        make_routes(worlds.straight(), RouteWish(2, 5000.0, 9000.0))


def test_hazards_stand_where_they_can_be_met_fairly() -> None:
    town = load_town("us_large_a")
    for entry in make_routes(town, RouteWish(6, seed=2)):
        route = get_planner(town).trace(entry.keypoints)
        places = hazard_places(town, route)
        junction = town.lanes.junction[route.lane] >= 0
        for before, after in pairwise(places):
            assert route.distance[after] - route.distance[before] >= APART
        for at in places:
            here = route.distance[at]
            assert here >= AFTER_START
            ahead = (route.distance >= here) & (route.distance <= here + BEFORE_JUNCTION)
            assert not junction[ahead].any()
            assert town.lanes.right[route.lane[at]] < 0, "a walker steps out beside the ego's own lane"


def test_no_walker_steps_onto_a_fast_road() -> None:
    slow, fast = worlds.straight(400.0, speed=50), worlds.straight(400.0, speed=90)
    for town, some in ((slow, True), (fast, False)):
        route = get_planner(town).trace([[10.0, 1.75, 0.0], [390.0, 1.75, 0.0]])
        assert bool(hazard_places(town, route)) == some


def test_a_route_gets_no_more_hazards_than_asked_for() -> None:
    town = worlds.straight(800.0)
    entry = entry_of(town, "0", np.array([[10.0, 1.75, 0.0], [790.0, 1.75, 0.0]]), ())
    assert [len(with_hazards(town, entry, count, Draws.of_seed(0)).scenarios) for count in (0, 2, 50)] == [0, 2, 6]


def test_what_is_written_is_read_back(tmp_path: object) -> None:
    from pathlib import Path

    entries = make_routes(load_town("us_large_a"), RouteWish(8, seed=11))
    path = Path(str(tmp_path)) / "made.xml"
    path.write_bytes(write_routes(entries, "empty"))
    found = read_routes(path)
    assert {entry.traffic for entry in found} == {"empty"}
    for ours, theirs in zip(entries, found, strict=True):
        assert (ours.id, ours.town, ours.weather) == (theirs.id, theirs.town, theirs.weather)
        assert np.allclose(ours.keypoints, theirs.keypoints, atol=1e-3)
        for made, read in zip(ours.scenarios, theirs.scenarios, strict=True):
            assert (made.name, made.type, made.parameters) == (read.name, read.type, read.parameters)
            assert np.allclose(made.trigger[:3], read.trigger[:3], atol=1e-3)
            assert np.isclose(np.cos(made.trigger[3] - read.trigger[3]), 1.0)


def test_every_lane_type_but_driving_is_left_alone() -> None:
    town = load_town("us_large_a")
    for entry in make_routes(town, RouteWish(3, seed=1)):
        lanes = get_planner(town).trace(entry.keypoints).lane
        assert (town.lanes.type[lanes] & int(LaneType.DRIVING) > 0).all()
