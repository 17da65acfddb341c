"""CARLA's own answers for its towns; skipped where the files are not at hand. Figures: docs/maps.md."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lavsim.map.lane import gaps
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.map.waypoint import Waypoint
from lavsim.types import LaneType
from tests.map.shared import MAPS, SHARED, needs_maps, needs_oracle, oracle

TYPES = {"Driving": 2, "Shoulder": 8, "Sidewalk": 32, "Parking": 256, "Any": -2}


def angle_between(a: float, b: float) -> float:
    return abs((a - b + 180.0) % 360.0 - 180.0)


@pytest.fixture(scope="module", params=["Town02", "Town10HD"])
def town(request: pytest.FixtureRequest) -> TownMap:
    return load_town(request.param, [MAPS])


@pytest.fixture(scope="module")
def answers(town: TownMap) -> Any:
    return oracle(town.name)


def at(town: TownMap, road: int, section: int, lane_id: int, s: float) -> Waypoint:
    lane = town.lane_index(road, section, lane_id)
    return town.waypoint_at(lane, town.lanes.u_of_s(lane, s))


@needs_oracle
def test_waypoints_are_those_of_carla(town: TownMap, answers: Any) -> None:
    for row in answers["waypoints"] + answers["lane_samples"]:
        x, y, z, yaw, road, section, lane_id, s, width, _, is_junction = row[:11]
        lane = town.lane_index(road, section, lane_id)
        for here in (town.exact(lane, s), town.exact(lane, s, carla_yaw=True)):
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
def test_lane_changes_are_those_of_carla(town: TownMap, answers: Any) -> None:
    names = {0: "NONE", 1: "Right", 2: "Left", 3: "Both"}
    for row in answers["waypoints"] + answers["lane_samples"]:
        assert names[at(town, *row[4:8]).lane_change] == row[14]


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
def test_projections_by_chords_are_those_of_carla(town: TownMap, answers: Any) -> None:
    for row in answers["projections"]:
        px, py, pz, kind, project, x, y, z, _, road, section, lane_id, s = row[:13]
        found = town.carla_waypoint((px, py, pz), bool(project), TYPES[kind])
        if road is None:
            assert found is None
            continue
        assert found is not None
        assert found.lane == town.lane_index(road, section, lane_id)
        assert abs(found.s - s) < 2e-3
        assert np.abs(found.xyz - (x, y, z)).max() < 2e-3


@needs_oracle
def test_the_nearest_lane_is_carla_s_or_nearer(town: TownMap, answers: Any) -> None:
    for row in answers["projections"]:
        px, py, pz, kind, project, x, y, z, _, road, section, lane_id, _ = row[:13]
        if road is None or not project:
            continue
        hit = town.nearest([[px, py, pz]], TYPES[kind])
        theirs = float(np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2))
        assert hit.distance[0] <= theirs + 1e-3
        if abs(hit.distance[0] - theirs) > 0.05:
            assert hit.lane[0] == town.lane_index(road, section, lane_id)


@needs_oracle
def test_steps_forward_and_back_are_those_of_carla(town: TownMap, answers: Any) -> None:
    for record in answers["next"]:
        here = at(town, *record["from"])
        for found, expected in ((here.next(10.0), record["next"]), (here.previous(10.0), record["previous"])):
            ours = sorted((w.road_id, w.section_id, w.lane_id, w.s, w.x, w.y) for w in found)
            theirs = sorted((*row[4:8], row[0], row[1]) for row in expected)
            assert [row[:3] for row in ours] == [row[:3] for row in theirs]
            assert np.allclose([row[3:] for row in ours], [row[3:] for row in theirs], atol=2e-3)


@needs_oracle
def test_lights_and_signs_stand_where_carla_s_landmarks_do(town: TownMap, answers: Any) -> None:
    lights = {str(light.signal_id): light for light in town.lights}
    signs = {str(sign.signal_id): sign for sign in town.signs}
    for landmark in answers["landmarks"]:
        found = lights[landmark["id"]] if landmark["type"] == "1000001" else signs[landmark["id"]]
        assert (found.x, found.y, found.z) == pytest.approx(landmark["xyz_yaw"][:3], abs=1e-3)


@needs_oracle
def test_landmarks_are_those_of_carla(town: TownMap, answers: Any) -> None:
    assert len(town.landmarks) == answers["landmarks_total"]
    numbers = ("s", "t", "value", "z_offset", "h_offset", "width", "height")
    words = ("type", "sub_type", "name", "text", "unit", "is_dynamic", "orientation")
    for expected in answers["landmarks"]:
        (found,) = (
            landmark
            for landmark in town.landmarks
            if (landmark.id, landmark.road_id) == (expected["id"], expected["road_id"])
            and abs(landmark.s - expected["s"]) < 1e-3
            and [list(pair) for pair in landmark.validities] == expected["lane_validities"]
        )
        assert [getattr(found, key) for key in numbers] == pytest.approx([expected[k] for k in numbers], abs=1e-3)
        assert [getattr(found, key) for key in words] == [expected[key] for key in words]
        assert (found.x, found.y, found.z) == pytest.approx(expected["xyz_yaw"][:3], abs=1e-3)
        assert angle_between(np.degrees(found.yaw), expected["xyz_yaw"][3]) < 0.01


@needs_oracle
def test_landmarks_ahead_are_those_of_carla(town: TownMap, answers: Any) -> None:
    for query in answers["landmarks_ahead"]:
        found = at(town, *query["from"]).landmarks(query["distance"], query["stop_at_junction"])
        ours = []
        for landmark in found:
            where = landmark.waypoint
            assert where is not None
            place = (where.road_id, where.section_id, where.lane_id)
            ours.append((landmark.id, landmark.type, landmark.road_id, place, landmark.distance, where.s))
        theirs = [(i, t, road, tuple(w[:3]), d, w[3]) for i, t, d, road, w in query["found"]]
        ours.sort()
        theirs.sort()
        assert [row[:4] for row in ours] == [row[:4] for row in theirs]
        assert np.allclose([row[4:] for row in ours], [row[4:] for row in theirs], atol=2e-3)


@needs_oracle
def test_crosswalks_are_those_of_carla(town: TownMap, answers: Any) -> None:
    assert sum(map(len, town.crosswalks)) == answers["crosswalk_points_total"]
    for expected in answers["crosswalks"]:
        corners = np.array(expected)[:, :2]
        assert any(
            len(polygon) == len(corners) and np.abs(polygon - corners).max() < 2e-3 for polygon in town.crosswalks
        )


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
    points = [[float(w.get(k) or 0.0) for k in "xyz"] for w in element.iter("waypoint")]
    route = get_planner(load_town("Town01", [MAPS])).trace(points)
    assert 700.0 < route.length < 800.0
    assert {option.name for option, _ in route.commands()} == {"LANEFOLLOW", "LEFT", "RIGHT"}
