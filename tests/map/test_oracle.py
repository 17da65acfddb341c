"""CARLA's own answers for its towns; skipped where the files are not at hand.

Known differences: projections in bends, where CARLA stays on chords of up to some metres and ours is the nearer point.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lavsim.map.lane import gaps
from lavsim.map.planner import get_planner
from lavsim.map.town_map import TownMap, load_town
from lavsim.types import LaneType
from tests.map.shared import MAPS, SHARED, needs_maps, needs_oracle, oracle

TYPES = {"Driving": 2, "Shoulder": 8, "Sidewalk": 32, "Parking": 256, "Any": -2}


def angle_between(a: float, b: float) -> float:
    return abs((a - b + 180.0) % 360.0 - 180.0)


@pytest.fixture(scope="module")
def town() -> TownMap:
    return load_town("Town02", [MAPS])


@pytest.fixture(scope="module")
def answers() -> Any:
    return oracle("Town02")


@needs_oracle
def test_waypoints_are_those_of_carla(town: TownMap, answers: Any) -> None:
    for row in answers["waypoints"] + answers["lane_samples"]:
        x, y, z, yaw, road, section, lane_id, s, width, _, is_junction = row[:11]
        lane = town.lane_index(road, section, lane_id)
        here = town.exact(lane, s)
        assert np.hypot(here[0] - x, here[1] - y) < 1e-3
        assert abs(here[2] - z) < 1e-3
        assert angle_between(np.degrees(here[3]), yaw) < 0.01
        assert abs(here[4] - width) < 1e-3
        assert (town.lanes.junction[lane] >= 0) == bool(is_junction)
        u = town.lanes.u_of_s(lane, s)
        on_table = town.centre(lane, u)[0]
        assert np.hypot(on_table[0] - x, on_table[1] - y) < 0.02
        waypoint = town.waypoint_at(lane, u)
        for beside, expected in ((waypoint.left(), row[15]), (waypoint.right(), row[16])):
            found = None if beside is None else [beside.road_id, beside.section_id, beside.lane_id]
            assert found == (None if expected is None else expected[:3])


@needs_oracle
def test_the_topology_is_that_of_carla(town: TownMap, answers: Any) -> None:
    lanes, columns = town.lanes, answers["topology_columns"]
    for row in answers["topology"]:
        pair = dict(zip(columns, row, strict=True))
        entry = town.lane_index(pair["entry_road"], pair["entry_section"], pair["entry_lane"])
        assert town.lane_index(pair["exit_road"], pair["exit_section"], pair["exit_lane"]) in lanes.successors(entry)
    total = sum(max(1, len(lanes.successors(int(k)))) for k in lanes.where(int(LaneType.DRIVING)))
    assert total == answers["topology_total"]


@needs_oracle
def test_projections_find_carla_s_lane_and_are_never_farther(town: TownMap, answers: Any) -> None:
    for row in answers["projections"]:
        px, py, pz, kind, project, x, y, z, _, road, section, lane_id, _ = row[:13]
        if road is None or not project:
            continue
        hit = town.nearest([[px, py, pz]], TYPES[kind])
        theirs = float(np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2))
        assert hit.distance[0] <= theirs + 1e-3
        if abs(hit.distance[0] - theirs) > 0.01:
            assert hit.lane[0] == town.lane_index(road, section, lane_id)


@needs_oracle
def test_steps_forward_and_back_are_those_of_carla(town: TownMap, answers: Any) -> None:
    for record in answers["next"]:
        road, section, lane_id, s = record["from"]
        lane = town.lane_index(road, section, lane_id)
        here = town.waypoint_at(lane, town.lanes.u_of_s(lane, s))
        for found, expected in ((here.next(10.0), record["next"]), (here.previous(10.0), record["previous"])):
            ours = sorted((w.road_id, w.section_id, w.lane_id, w.s) for w in found)
            theirs = sorted(tuple(row[4:8]) for row in expected)
            assert [row[:3] for row in ours] == [row[:3] for row in theirs]
            assert [row[3] for row in ours] == pytest.approx([row[3] for row in theirs], abs=0.02)


@needs_oracle
def test_lights_stand_where_carla_s_landmarks_do(town: TownMap, answers: Any) -> None:
    by_id = {str(light.signal_id): light for light in town.lights}
    for landmark in answers["landmarks"]:
        if landmark["type"] == "1000001":
            light = by_id[landmark["id"]]
            assert (light.x, light.y, light.z) == pytest.approx(landmark["xyz_yaw"][:3], abs=1e-3)


@needs_maps
@pytest.mark.parametrize("name", ["Town01", "Town02"])
def test_real_towns_join(name: str) -> None:
    loaded = load_town(name, [MAPS])
    lanes = loaded.lanes
    driving = lanes.where(int(LaneType.DRIVING))
    assert gaps(lanes).max() < 0.1
    assert (np.diff(lanes.succ_first)[driving] > 0).all()
    assert all(len(group.phases) == 3 for group in loaded.light_groups)
    assert all(light.stop_lines for light in loaded.lights)


@needs_maps
def test_the_dev_test_route_can_be_traced_on_town01() -> None:
    from lxml import etree

    path = SHARED / "routes" / "leaderboard_1.0_devtest.xml"
    if not path.exists():
        pytest.skip("needs routes/leaderboard_1.0_devtest.xml of LAVSIM_SHARED or ../shared")
    element = etree.parse(str(path)).getroot()[0]
    points = [[float(w.get(k)) for k in "xyz"] for w in element.iter("waypoint")]
    route = get_planner(load_town("Town01", [MAPS])).trace(points)
    assert 700.0 < route.length < 800.0
    assert {option.name for option, _ in route.commands()} == {"LANEFOLLOW", "LEFT", "RIGHT"}
