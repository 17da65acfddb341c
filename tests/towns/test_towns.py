"""What every bundled town keeps: lanes that join, places that can be reached, signals at the right approaches."""

from __future__ import annotations

import math
import tomllib
from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

import lavsim.towns
from lavsim.geometry import wrap_angle
from lavsim.map.lane import CHANGE_LEFT, CHANGE_RIGHT, DRIVABLE, gaps, kinks
from lavsim.map.signal import LIGHT_TYPES
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.map.write import write_network
from lavsim.towns.draw import TOWNS
from lavsim.types import LaneType, RoadOption

FOLDER = Path(lavsim.towns.__file__).parent
TABLE = tomllib.loads((FOLDER / "towns.toml").read_text())
SMALL = ("eu_small_a", "eu_small_b")
SPLITS = {
    "training": {"eu_small_a", "us_large_a", "us_large_b", "us_highway"},
    "test": {"eu_small_b", "us_large_c"},
    "full": {"us_rural", "us_center"},
}


@pytest.fixture(params=sorted(TOWNS), scope="module")
def town(request: pytest.FixtureRequest) -> TownMap:
    return load_town(request.param)


def streets(town: TownMap) -> np.ndarray:
    """Driving lanes outside junctions."""
    return np.flatnonzero((town.lanes.type == LaneType.DRIVING) & (town.lanes.junction < 0))


def road_km(town: TownMap) -> float:
    return sum(road.length for road in town.network.roads if road.junction < 0) / 1000.0


def crossings(town: TownMap) -> int:
    """Junctions, a roundabout counted once."""
    return len({junction.name.split(":")[0] for junction in town.network.junctions})


def test_there_are_eight_towns_in_their_splits() -> None:
    assert set(TABLE) == set(TOWNS) == {path.stem for path in FOLDER.glob("*.xodr")} == set.union(*SPLITS.values())
    for split, names in SPLITS.items():
        assert {name for name, facts in TABLE.items() if facts["split"] == split} == names


def test_it_is_as_large_as_its_name_says(town: TownMap) -> None:
    kilometres, junctions = (3.0, 8) if town.name in SMALL else (8.0, 20)
    assert road_km(town) >= kilometres
    assert crossings(town) >= junctions


def test_driving_lanes_join_without_a_gap_or_a_kink(town: TownMap) -> None:
    lanes = town.lanes
    driving = (lanes.type & DRIVABLE) > 0
    source = np.repeat(np.arange(len(lanes)), np.diff(lanes.succ_first))
    joined = driving[source] & driving[lanes.succ]
    assert gaps(lanes)[joined].max() < 1e-5
    assert kinks(lanes)[joined].max() < 1e-6
    for way in (lanes.succ_first, lanes.pred_first):
        assert (np.diff(way)[lanes.type == LaneType.DRIVING] > 0).all()


def test_every_driving_lane_can_be_reached_from_every_other(town: TownMap) -> None:
    lanes, graph = town.lanes, nx.DiGraph()
    for lane in lanes.where(int(LaneType.DRIVING)).tolist():
        graph.add_edges_from((lane, int(k)) for k in lanes.successors(lane))
        if lanes.junction[lane] < 0:
            for beside, bit in ((lanes.left[lane], CHANGE_LEFT), (lanes.right[lane], CHANGE_RIGHT)):
                if beside >= 0 and (lanes.change[lanes.rows(lane)] & bit).any():
                    graph.add_edge(lane, int(beside))
    assert nx.is_strongly_connected(graph)


def test_lanes_are_as_wide_as_real_ones_and_turns_not_too_tight(town: TownMap) -> None:
    lanes = town.lanes
    rows = np.repeat(lanes.type == LaneType.DRIVING, np.diff(lanes.first))
    inside = np.repeat(lanes.junction >= 0, np.diff(lanes.first))
    circle = np.repeat(circling(town), np.diff(lanes.first))
    assert lanes.width[rows & ~inside & ~circle].min() >= 3.3 - 1e-9
    assert lanes.width[rows & ~inside & ~circle].max() <= 3.7 + 1e-9
    radius = 1.0 / np.maximum(np.abs(lanes.points[:, 4]), 1e-6)
    assert radius[rows & inside].min() > 6.0
    assert radius[rows & ~inside].min() > 19.0
    # Whoever drives at the limit feels half of g at most, on the motorway a quarter.
    limit = np.repeat(lanes.speed_limit, np.diff(lanes.first))
    aside = limit**2 / radius * (rows & ~inside)
    assert aside[~circle].max() < 5.1
    assert aside[limit > 20.0].max(initial=0.0) < 2.5


def circling(town: TownMap) -> np.ndarray:
    """Lanes of roundabouts' circles."""
    lanes = town.lanes
    names = {road.id for road in town.network.roads if road.junction < 0 and road.name in circle_names(town)}
    return np.isin(lanes.road_id, list(names))


def circle_names(town: TownMap) -> set[str]:
    rounds = {j.name.split(":")[0] for j in town.network.junctions if ":" in j.name}
    return {road.name for road in town.network.roads if any(road.name.startswith(f"{name} ") for name in rounds)}


def test_a_left_turn_begins_in_the_left_lane_and_a_right_turn_in_the_right_one(town: TownMap) -> None:
    lanes = town.lanes
    for lane in streets(town).tolist():
        ways = [k for k in lanes.successors(lane) if lanes.junction[k] >= 0]
        turns = {int(lanes.turn[k]) for k in ways}
        ahead = {RoadOption.STRAIGHT, RoadOption.LANEFOLLOW}
        junction = town.junctions[lanes.junction[ways[0]]] if ways else None
        entries = {int(k) for way in (junction.lanes if junction else ()) for k in lanes.predecessors(way)}
        if not turns & ahead or len({int(lanes.road_id[k]) for k in entries if lanes.type[k] == 2}) == 1:
            continue  # the stem of a T, where each lane has to turn somewhere; or nobody else comes in
        if lanes.left[lane] >= 0:
            assert RoadOption.LEFT not in turns
        if lanes.right[lane] >= 0:
            assert RoadOption.RIGHT not in turns


def test_lanes_may_be_changed_in_the_open_and_not_at_the_lights(town: TownMap) -> None:
    lanes = town.lanes
    for lane in streets(town).tolist():
        rows = lanes.rows(lane)
        right = lanes.change[rows] & CHANGE_RIGHT > 0
        if lanes.right[lane] < 0:
            assert not right.any()
        elif lanes.length[lane] > 40.0:
            assert right.any()
            assert not right[-20:].any() or town.name == "us_highway"
        outer_left = lanes.left[lane] < 0
        assert not (outer_left and (lanes.change[rows] & CHANGE_LEFT).any())


def test_each_approach_to_lights_has_its_own_light_and_phase(town: TownMap) -> None:
    lanes = town.lanes
    for light in town.lights:
        assert light.lanes
        assert light.approach
        assert {int(lanes.light[k]) for k in light.lanes} == {light.index}
        assert {int(k) for lane in light.approach for k in lanes.successors(lane)} == set(light.lanes)
        assert len({int(lanes.road_id[k]) for k in light.approach}) == 1
        assert len(light.stop_lines) == len(light.approach)
        for stop in light.stop_lines:
            assert 2.5 < lanes.length[stop.lane] - stop.paint_u < 7.0
            assert abs(float(wrap_angle(stop.yaw + math.pi - light.yaw))) < 1e-6
    grouped = [light for group in town.light_groups for phase in group.phases for light in phase]
    assert sorted(grouped) == list(range(len(town.lights)))
    assert all(len(phase) == 1 for group in town.light_groups for phase in group.phases)
    assert all(len(group.phases) >= 2 for group in town.light_groups)


def test_american_lights_hang_beyond_the_crossing_and_european_ones_before_it(town: TownMap) -> None:
    for light in town.lights:
        stop = light.stop_lines[0]
        ahead = (light.x - stop.x) * math.cos(stop.yaw) + (light.y - stop.y) * math.sin(stop.yaw)
        if town.name.startswith("us_"):
            assert 8.0 < ahead < 60.0, (light.signal_id, ahead)
        else:
            assert -2.0 < ahead < 2.0


def test_stop_and_yield_signs_govern_ways_that_no_light_does(town: TownMap) -> None:
    signs = {s.id: s.kind for road in town.network.roads for s in road.signals if s.kind in ("205", "206")}
    governed: dict[int, int] = dict.fromkeys(signs, 0)
    for road in town.network.roads:
        kinds = [signs[r.id] for r in road.references if r.id in signs]
        assert len(kinds) <= 1
        for reference in road.references:
            if reference.id in signs:
                governed[reference.id] += 1
                assert road.junction >= 0
                assert not any(int(town.lanes.light[k]) >= 0 for k in np.flatnonzero(town.lanes.road_id == road.id))
    assert all(governed.values())
    kinds = set(signs.values())
    expected = {"eu_small_a": set(), "eu_small_b": {"205"}, "us_center": {"206"}}
    assert kinds == expected.get(town.name, {"205", "206"})


def test_signals_stand_on_their_road_and_off_the_lanes(town: TownMap) -> None:
    shapes, places = town.shapes, []
    for road in town.network.roads:
        for signal in road.signals:
            assert 0.0 <= signal.s <= road.length
            assert signal.kind in LIGHT_TYPES | {"205", "206"}
            places.append(shapes[road.id].place(signal.s, signal.t)[:2])
        for thing in road.objects:
            if thing.name.startswith("Speed_"):
                places.append(shapes[road.id].place(thing.s, thing.t)[:2])
    hits = town.nearest(np.array(places))
    assert (hits.distance > hits.width / 2.0 + 0.2).all()


def test_crosswalks_and_sidewalks_where_people_live(town: TownMap) -> None:
    sidewalks = town.lanes.where(int(LaneType.SIDEWALK))
    assert len(sidewalks) > 30
    assert len(town.crosswalks) > 20
    parking = town.lanes.where(int(LaneType.PARKING))
    assert (len(parking) > 0) == (town.name not in ("eu_small_a", "us_rural"))


def test_speed_limits_are_those_of_such_streets(town: TownMap) -> None:
    limits = set(np.rint(town.lanes.speed_limit[streets(town)] * 3.6).astype(int).tolist())
    assert limits <= {30, 40, 50, 60, 90}
    assert (90 in limits) == (town.name == "us_highway")
    if town.name == "us_rural":
        driven = town.lanes.length[streets(town)]
        fast = town.lanes.speed_limit[streets(town)] * 3.6 > 55.0
        assert driven[fast].sum() > 0.7 * driven.sum()


def test_no_two_towns_are_alike() -> None:
    """Neither in proportion nor in the directions of their streets nor in how far apart their junctions are."""
    prints = []
    for name in sorted(TOWNS):
        town = load_town(name)
        lanes = streets(town)
        rows = np.concatenate([np.arange(town.lanes.first[k], town.lanes.first[k + 1]) for k in lanes])
        yaw = np.mod(town.lanes.points[rows, 3], np.pi)
        turns = np.histogram(yaw, 12, (0.0, np.pi))[0] / len(rows)
        lengths = np.histogram(town.lanes.length[lanes], [0, 50, 80, 110, 150, 200, 300, 2000])[0] / len(lanes)
        prints.append(np.concatenate([turns, lengths]))
    for k, first in enumerate(prints):
        for second in prints[k + 1 :]:
            assert np.abs(first - second).sum() > 0.35


def test_the_file_is_what_the_script_draws(town: TownMap) -> None:
    assert town.xodr.encode() == write_network(TOWNS[town.name]().network())


def test_the_motorway_has_merges_and_exits() -> None:
    town = load_town("us_highway")
    lanes = town.lanes
    fast = [k for k in streets(town) if lanes.speed_limit[k] * 3.6 > 85.0]
    assert lanes.length[fast].sum() > 7500.0
    ramps = [road for road in town.network.roads if road.name.startswith(("Exit", "Entry"))]
    assert len(ramps) == 4
    forks = [k for k in fast if len(lanes.successors(k)) > 1 and (lanes.turn[lanes.successors(k)] == 3).all()]
    merges = [k for k in fast if len(lanes.predecessors(k)) > 1]
    assert forks
    assert merges
    counts = {len(list(run)) for run in sections(town)}
    assert {4, 5} <= counts


def sections(town: TownMap) -> list[list[int]]:
    """Driving lanes of each motorway road."""
    names = [road.id for road in town.network.roads if road.name.startswith("Motorway")]
    return [[k for k in streets(town) if town.lanes.road_id[k] == road] for road in names]


def test_a_roundabout_is_driven_one_way_round() -> None:
    for name in ("us_large_a", "us_large_b", "us_large_c", "us_rural"):
        town = load_town(name)
        members = [k for k in streets(town) if circling(town)[k]]
        assert len(members) >= 3
        start = members[0]
        way = [start]
        while True:
            onward = [int(k) for k in town.lanes.successors(way[-1])]
            ring = [k for k in onward if k in members or set(map(int, town.lanes.successors(k))) & set(members)]
            way.append(ring[0])
            if ring[0] == start:
                break
            assert len(way) < 40
        turned = sum(float(np.ptp(town.lanes.centre_line(k)[:, 3])) for k in way[:-1])
        assert turned == pytest.approx(2.0 * math.pi, abs=1e-3)
        assert all(town.lanes.centre_line(k)[1, 4] < 0.0 for k in way)  # to the left
        for a, b in pairwise(way):
            assert b in town.lanes.successors(a)
