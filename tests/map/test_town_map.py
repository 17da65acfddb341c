"""Lanes, links, nearest lanes, waypoints, lights and marks of small towns and of the bundled one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import booleans, floats, integers

from lavsim.errors import MapError, UnknownName
from lavsim.geometry import right, wrap_angle
from lavsim.map.lane import gaps, kinks
from lavsim.map.town_files import TOWN_PATH, build_town, load_town, town_names
from lavsim.map.town_map import TownMap
from lavsim.towns.draw import TOWNS
from lavsim.types import LaneType, RoadOption
from tests import worlds


def eastbound(town: TownMap) -> int:
    """The lane of the first road that runs with its s."""
    return int(np.flatnonzero((town.lanes.lane_id == -1) & (town.lanes.junction < 0))[0])


def test_a_straight_road_has_its_lanes_where_traffic_keeps_right() -> None:
    town = worlds.straight()
    there, back = town.lane_index(1, 0, -1), town.lane_index(1, 0, 1)
    assert town.centre(there, 100.0)[0] == pytest.approx([100.0, 1.75, 0.0, 0.0, 0.0])
    x, y, z, yaw, curvature = town.centre(back, 30.0)[0]
    assert (x, y, z, curvature) == pytest.approx((170.0, -1.75, 0.0, 0.0))
    assert abs(float(wrap_angle(yaw))) == pytest.approx(np.pi)
    assert town.lanes.speed_limit[there] == pytest.approx(50.0 / 3.6)


def test_an_unknown_lane_is_named() -> None:
    with pytest.raises(MapError, match="straight has no lane -9 in section 0 of road 1"):
        worlds.straight().lane_index(1, 0, -9)


@given(radius=floats(8.0, 200.0), share=floats(0.0, 1.0), offset=floats(-1.7, 1.7), left=booleans(), side=booleans())
@settings(max_examples=40, deadline=None)
def test_lane_frame_round_trip(radius: float, share: float, offset: float, left: bool, side: bool) -> None:
    town = worlds.arc(radius=round(radius), length=2.0 * round(radius), left=left)  # does not meet itself
    lane = town.lane_index(1, 0, -1 if side else 1)
    u = share * float(town.lanes.length[lane])
    x, y, _, yaw, _ = town.centre(lane, u)[0]
    place = np.array([x, y]) + offset * right(yaw)
    hit = town.nearest(place[None])
    assert hit.lane[0] == lane
    assert hit.u[0] == pytest.approx(u, abs=2e-3)
    assert hit.offset[0] == pytest.approx(offset, abs=1e-3)
    assert hit.distance[0] == pytest.approx(abs(offset), abs=1e-3)


@given(lane=integers(0, 10_000), share=floats(0.0, 1.0), distance=floats(0.5, 60.0))
@settings(max_examples=60, deadline=None)
def test_previous_of_next_leads_back(lane: int, share: float, distance: float) -> None:
    town = load_town("eu_small_a")
    driving = town.lanes.where(int(LaneType.DRIVING))
    number = int(driving[lane % len(driving)])
    start = town.waypoint_at(number, share * float(town.lanes.length[number]))
    ahead = start.next(distance)
    assert ahead
    for place in ahead:
        back = place.previous(distance)
        # At a lane's very border the way back may end on either side of it.
        assert min(float(np.hypot(b.x - start.x, b.y - start.y)) for b in back) < 1e-3


def test_next_gives_one_waypoint_a_branch_and_none_past_a_dead_end() -> None:
    town = worlds.crossing()
    entry = town.waypoint((-40.0, 1.75))
    assert len(entry.next(40.0)) == 3
    assert len(entry.next(5.0)) == 1
    assert worlds.straight().waypoint((190.0, 1.75)).next(20.0) == []


def test_a_distance_that_does_not_move_is_refused() -> None:
    with pytest.raises(ValueError, match="distance must be positive"):
        worlds.straight().waypoint((5.0, 1.75)).next(0.0)


def test_neighbours_follow_the_direction_of_travel() -> None:
    place = worlds.straight().waypoint((100.0, 1.75))
    across, gutter = place.left(), place.right()
    assert across is not None
    assert gutter is not None
    assert (across.lane_id, across.y) == (1, pytest.approx(-1.75))
    assert gutter.lane_type == LaneType.SHOULDER
    sidewalk = gutter.right()
    assert sidewalk is not None
    assert sidewalk.lane_type == LaneType.SIDEWALK
    assert sidewalk.right() is None
    assert across.left() == place


def test_lane_changes_are_those_the_marks_allow() -> None:
    free, shut = worlds.two_lanes(), worlds.two_lanes(lane_change="none")
    inner, outer = free.lane_index(1, 0, -1), free.lane_index(1, 0, -2)
    assert free.lanes.right[inner] == outer
    assert free.lanes.left[outer] == inner
    assert free.lanes.change_right[inner]
    assert free.lanes.change_left[outer]
    assert not free.lanes.change_left[inner]
    assert not shut.lanes.change_right.any()
    assert not shut.lanes.change_left.any()


def test_opposite_lanes_are_no_neighbours() -> None:
    town = worlds.straight()
    assert (town.lanes.left == -1).all()
    assert (town.lanes.right == -1).all()


def test_nearest_takes_the_height_into_account_only_when_given() -> None:
    town = worlds.straight()
    assert town.nearest([[50.0, 2.75]]).distance[0] == pytest.approx(1.0)
    assert town.nearest([[50.0, 1.75, 3.0]]).distance[0] == pytest.approx(3.0)


def test_nearest_agrees_with_trying_every_point() -> None:
    town = load_town("eu_small_a")
    rng = np.random.default_rng(0)
    x0, y0, x1, y1 = town.bounds + np.array([-300.0, -300.0, 300.0, 300.0])
    places = np.stack([rng.uniform(x0, x1, 200), rng.uniform(y0, y1, 200)], axis=1)
    for types in (LaneType.DRIVING, LaneType.SIDEWALK, LaneType.DRIVING | LaneType.SHOULDER):
        keep = np.isin(np.repeat(np.arange(len(town.lanes)), np.diff(town.lanes.first)), town.lanes.where(types))
        cloud = town.lanes.points[keep, :2]
        brute = np.sqrt(((places[:, None] - cloud[None]) ** 2).sum(axis=2).min(axis=1))
        found = town.nearest(places, types).distance
        assert (found <= brute + 1e-6).all()
        # Centre points are at most 0.5 m apart; a bend comes 2 cm nearer between them.
        assert (found >= np.sqrt(np.maximum(brute**2 - 0.26**2, 0.0)) - 0.02).all()


def test_nearest_of_what_is_not_there_is_no_lane() -> None:
    town = worlds.two_lanes()
    assert town.nearest([[0.0, 0.0]], LaneType.SIDEWALK).lane[0] == -1
    assert town.nearest([[np.nan, 0.0], [np.inf, 0.0]]).lane.tolist() == [-1, -1]
    assert town.nearest(np.zeros((0, 2))).lane.shape == (0,)
    with pytest.raises(MapError, match="no lane of the types"):
        town.waypoint((0.0, 0.0), LaneType.SIDEWALK)


def test_u_and_s_are_inverse() -> None:
    lanes = worlds.arc().lanes
    for lane in range(len(lanes)):
        for u in np.linspace(0.0, lanes.length[lane], 17):
            assert lanes.u_of_s(lane, lanes.s_of_u(lane, float(u))) == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_bundled_towns_join_exactly(name: str) -> None:
    town = load_town(name)
    lanes = town.lanes
    driving = lanes.where(int(LaneType.DRIVING))
    assert gaps(lanes).max() < 1e-4
    assert kinks(lanes).max() < 1e-4
    assert (np.diff(lanes.succ_first)[driving] > 0).all()
    assert (np.diff(lanes.pred_first)[driving] > 0).all()
    steps = np.hypot(*np.diff(lanes.points[:, :2], axis=0).T)
    inside = np.ones(len(steps), np.bool_)
    inside[lanes.first[1:-1] - 1] = False
    even = np.repeat(lanes.step, np.diff(lanes.first))[:-1]
    assert np.allclose(steps[inside], even[inside], atol=5e-3)


@pytest.mark.parametrize("name", sorted(TOWNS))
def test_bundled_files_are_what_the_script_draws(name: str) -> None:
    from lavsim.map.write import write_network

    assert load_town(name).xodr.encode() == write_network(TOWNS[name]().network())


def test_eu_small_a_is_a_small_european_town() -> None:
    town = load_town("eu_small_a")
    lanes = town.lanes
    driving = (lanes.type & LaneType.DRIVING) > 0
    outside = driving & (lanes.junction < 0)
    assert lanes.length[outside].sum() / 2.0 >= 3000.0
    assert len({light.junction for light in town.lights}) >= 8
    assert np.abs(lanes.points[np.repeat(driving, np.diff(lanes.first)), 4]).max() <= 1.0 / 8.0
    assert set(np.rint(lanes.speed_limit[driving] * 3.6)) == {30.0, 50.0}
    assert town.geo_reference == (0.0, 0.0)


def test_the_bundled_towns_table_names_bundled_towns() -> None:
    import tomllib

    table = tomllib.loads((Path(worlds.__file__).parents[1] / "lavsim" / "towns" / "towns.toml").read_text())
    assert set(table) == set(TOWNS)


def test_turns_of_a_crossing() -> None:
    town = worlds.crossing()
    entry = eastbound(town)
    turns = {}
    for lane in town.lanes.successors(entry):
        x, y = town.lanes.centre_line(int(lane))[-1, :2]
        turns[RoadOption(int(town.lanes.turn[lane]))] = (round(float(x)), round(float(y)))
    assert turns == {RoadOption.LEFT: (2, -11), RoadOption.STRAIGHT: (11, 2), RoadOption.RIGHT: (-2, 11)}
    assert (town.lanes.turn[town.lanes.junction < 0] == RoadOption.LANEFOLLOW).all()


def test_crossing_ways_conflict_and_diverging_ones_do_not() -> None:
    town = worlds.crossing()
    lanes = town.lanes

    def way(start: tuple[float, float], turn: RoadOption) -> int:
        lane = town.waypoint(start).lane
        return next(int(k) for k in lanes.successors(lane) if lanes.turn[k] == turn)

    ahead = way((-40.0, 1.75), RoadOption.STRAIGHT)
    from_south = way((1.75, 40.0), RoadOption.STRAIGHT)
    oncoming_left = way((40.0, -1.75), RoadOption.LEFT)
    oncoming = way((40.0, -1.75), RoadOption.STRAIGHT)
    own_left = way((-40.0, 1.75), RoadOption.LEFT)
    north_right = way((-1.75, -40.0), RoadOption.LEFT)  # merges into the lane that `ahead` leaves by
    assert from_south in lanes.conflicts(ahead)
    assert oncoming_left in lanes.conflicts(ahead)
    assert north_right in lanes.conflicts(ahead)
    assert oncoming not in lanes.conflicts(ahead)
    assert own_left not in lanes.conflicts(ahead)
    row = lanes.conflict_first[ahead] + int(np.flatnonzero(lanes.conflicts(ahead) == from_south)[0])
    low, high = lanes.conflict_u[row]
    crossing = 11.0 + 1.75  # where the ways cross, from the junction's edge at x = -11
    assert low == pytest.approx(crossing - 2.4, abs=0.6)
    assert high == pytest.approx(crossing + 2.4, abs=0.6)


def test_conflicts_are_mutual() -> None:
    lanes = load_town("eu_small_a").lanes
    pairs = {(a, int(b)) for a in range(len(lanes)) for b in lanes.conflicts(a)}
    assert pairs == {(b, a) for a, b in pairs}


def test_a_light_governs_its_approach_and_looks_at_it() -> None:
    town = worlds.tee()
    assert len(town.lights) == 3
    assert [len(group.phases) for group in town.light_groups] == [3]
    for light in town.lights:
        (approach,) = light.approach
        (stop,) = light.stop_lines
        end = town.lanes.centre_line(approach)[-1]
        assert float(wrap_angle(light.yaw - end[3] - np.pi)) == pytest.approx(0.0, abs=1e-9)
        assert {int(town.lanes.light[k]) for k in light.lanes} == {light.index}
        assert set(light.lanes) == set(town.lanes.successors(approach).tolist())
        length = float(town.lanes.length[approach])
        assert length - 0.5 < stop.u <= length
        assert stop.paint_u == pytest.approx(length - 5.5, abs=0.5)
        x, y, _, half_length, half_width = light.trigger
        assert (half_length, half_width) == pytest.approx((1.5, 0.25 * 3.5))
        assert float(np.hypot(x - end[0], y - end[1])) == pytest.approx(2.9, abs=0.05)
        # The post stands beside the lane, on its right.
        aside = (np.array([light.x, light.y]) - end[:2]) @ right(end[3])
        assert aside > 3.5 / 2.0 + 0.3


def test_a_junction_without_lights_has_none() -> None:
    town = worlds.tee(lights=False)
    assert town.lights == ()
    assert town.light_groups == ()
    assert (town.lanes.light == -1).all()


def test_crosswalks_lie_between_stop_line_and_junction() -> None:
    town = worlds.tee()
    assert len(town.crosswalks) == 3
    west = min(town.crosswalks, key=lambda polygon: polygon[:, 0].mean())
    junction = -11.0
    assert west[:, 0].max() == pytest.approx(junction - 1.5)
    assert west[:, 0].min() == pytest.approx(junction - 4.5)
    stops = [mark for mark in town.marks if mark.kind == "stop"]
    assert len(stops) == 3
    nearest = min(stops, key=lambda mark: mark.points[:, 0].mean())
    assert nearest.points[:, 0] == pytest.approx([junction - 5.5] * 2)
    assert sorted(nearest.points[:, 1]) == pytest.approx([0.1, 3.4])


def test_marks_are_where_the_paint_is() -> None:
    town = worlds.straight()
    kinds = {(mark.kind, round(float(mark.points[:, 1].mean()), 2)) for mark in town.marks}
    assert ("curb", 3.8) in kinds
    assert ("curb", -3.8) in kinds
    assert any(kind == "broken" and y == 0.0 for kind, y in kinds)


def test_a_lane_polygon_has_the_lane_s_area() -> None:
    town = worlds.arc()
    for lane in range(len(town.lanes)):
        x, y = town.lane_polygon(lane).T
        area = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
        assert area == pytest.approx(3.5 * town.lanes.length[lane], rel=1e-3)


def test_speed_signs_hold_until_the_next_one_on_another_road() -> None:
    town = worlds.tee()
    lanes = town.lanes
    south = town.waypoint((1.75, 40.0)).lane  # towards the junction
    assert lanes.speed_limit[south] == pytest.approx(30.0 / 3.6)
    for lane in lanes.successors(south):
        assert lanes.speed_limit[lane] == pytest.approx(30.0 / 3.6)
        assert lanes.speed_limit[lanes.successors(int(lane))[0]] == pytest.approx(50.0 / 3.6)


def test_without_signs_the_road_s_own_limit_holds_and_30_without_either() -> None:
    assert worlds.arc().lanes.speed_limit == pytest.approx(np.full(2, 30.0 / 3.6))
    text = worlds.straight().xodr
    unsigned = build_town("t", text.replace('name="Speed_50"', 'name="Bin"').encode())
    assert unsigned.lanes.speed_limit == pytest.approx(np.full(len(unsigned.lanes), 50.0 / 3.6))
    mph = build_town(
        "t", text.replace("Speed_50", "Bin").replace('max="50" unit="km/h"', 'max="25" unit="mph"').encode()
    )
    assert mph.lanes.speed_limit == pytest.approx(np.full(len(mph.lanes), 25.0 * 0.44704))


def test_a_ring_closes() -> None:
    town = worlds.ring()
    assert gaps(town.lanes).max() < 1e-6
    start = town.waypoint((50.0, -36.0))
    around = start.next(2.0 * np.pi * 60.0)
    assert [place.lane for place in around] == [start.lane]
    assert float(np.hypot(around[0].x - start.x, around[0].y - start.y)) < 1e-3


def test_towns_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_town.xodr").write_text(worlds.straight().xodr)
    monkeypatch.delenv(TOWN_PATH, raising=False)
    assert "my_town" in town_names([tmp_path])
    assert load_town("my_town", [tmp_path]).digest == worlds.straight().digest
    with pytest.raises(UnknownName, match=r"no town 'eu_smal_a'\. Did you mean 'eu_small_a'\?"):
        load_town("eu_smal_a")
    monkeypatch.setenv(TOWN_PATH, str(tmp_path))
    assert load_town("my_town") is load_town("my_town")


def test_the_lane_table_can_not_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        worlds.straight().lanes.points[0, 0] = 1.0
