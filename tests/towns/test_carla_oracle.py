"""The bundled towns in the official map library of CARLA, and in SUMO's importer."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lavsim.towns
from lavsim.map.town_files import load_town
from lavsim.map.town_map import TownMap
from lavsim.towns.draw import TOWNS
from lavsim.types import LaneType

FOLDER = Path(lavsim.towns.__file__).parent
SPACING = 2.0  # [m] between waypoints


@pytest.fixture(params=sorted(TOWNS), scope="module")
def pair(request: pytest.FixtureRequest) -> tuple[TownMap, Any]:
    carla = pytest.importorskip("carla", reason="needs the `carla` package (extra `dev`)")
    if not hasattr(carla, "Map"):
        pytest.skip("needs the `carla` package (extra `dev`), not a stand-in")
    town = load_town(request.param)
    return town, carla.Map(town.name, town.xodr)


def lane_of(town: TownMap, waypoint: Any) -> int:
    return town.lane_index(waypoint.road_id, waypoint.section_id, waypoint.lane_id)


def test_its_topology_is_ours(pair: tuple[TownMap, Any]) -> None:
    town, theirs = pair
    lanes = town.lanes
    ours = {(int(a), int(b)) for a in lanes.where(int(LaneType.DRIVING)) for b in lanes.successors(int(a))}
    found = [(lane_of(town, begin), lane_of(town, end)) for begin, end in theirs.get_topology()]
    assert len(found) == len(ours)
    assert set(found) == ours
    for begin, end in theirs.get_topology()[::7]:
        there = end.transform.location
        assert np.hypot(*(lanes.centre_line(lane_of(town, end))[0, :2] - (there.x, there.y))) < 1e-3
        assert begin.is_junction == (lanes.junction[lane_of(town, begin)] >= 0)


def test_its_waypoints_are_ours(pair: tuple[TownMap, Any]) -> None:
    town, theirs = pair
    lanes = town.lanes
    found: dict[int, list[Any]] = {}
    for waypoint in theirs.generate_waypoints(SPACING):
        found.setdefault(lane_of(town, waypoint), []).append(waypoint)
    assert set(found) == set(lanes.where(int(LaneType.DRIVING)).tolist())
    off = turned = 0.0
    for lane, waypoints in found.items():
        low, high = sorted((lanes.s_start[lane], lanes.s_end[lane]))
        s = np.array(sorted(w.s for w in waypoints))
        assert np.allclose(s, low + SPACING * np.arange(len(s)), atol=1e-3)
        assert 0.0 <= high - s[-1] <= SPACING + 1e-3
        for waypoint in waypoints[:: max(1, len(waypoints) // 8)]:
            x, y, z, yaw, width = town.exact(lane, waypoint.s, carla_yaw=True)
            place = waypoint.transform
            off = max(off, float(np.hypot(place.location.x - x, place.location.y - y)), abs(place.location.z - z))
            turned = max(turned, abs((place.rotation.yaw - np.degrees(yaw) + 180.0) % 360.0 - 180.0))
            assert waypoint.lane_width == pytest.approx(width, abs=1e-3)
            assert waypoint.is_junction == (lanes.junction[lane] >= 0)
    assert off < 2e-3
    assert turned < 0.05


def test_its_landmarks_and_lights_are_ours(pair: tuple[TownMap, Any]) -> None:
    town, theirs = pair

    def mark(landmark: Any, x: float, y: float) -> tuple[Any, ...]:
        place = (round(landmark.s, 2), round(x, 2) + 0.0, round(y, 2) + 0.0)
        return (str(landmark.id), str(landmark.type), int(landmark.road_id), *place)

    ours = sorted(mark(m, m.x, m.y) for m in town.landmarks)
    found = sorted(
        mark(m, m.transform.location.x, m.transform.location.y) for m in theirs.get_all_landmarks()
    )  # fmt: skip
    assert [m[:3] for m in found] == [m[:3] for m in ours]
    assert np.abs(np.array([m[3:] for m in found]) - np.array([m[3:] for m in ours])).max() < 0.03
    lights = {str(light.signal_id) for light in town.lights}
    assert {str(m.id) for m in theirs.get_all_landmarks_of_type("1000001")} == lights
    for kind, name in (("206", "stop"), ("205", "yield")):
        signs = {str(sign.signal_id) for sign in town.signs if sign.kind == name}
        assert {str(m.id) for m in theirs.get_all_landmarks_of_type(kind)} == signs


def test_its_lane_changes_and_crosswalks_are_ours(pair: tuple[TownMap, Any]) -> None:
    town, theirs = pair
    lanes = town.lanes
    theirs_by_five = np.array([(p.x, p.y) for p in theirs.get_crosswalks()]).reshape(-1, 5, 2)
    ours = np.array(town.crosswalks)
    assert theirs_by_five.shape == ours.shape
    nearest = np.abs(theirs_by_five[:, None] - ours[None]).max(axis=(2, 3)).min(axis=1)
    assert nearest.max() < 1e-2
    allowed = {"NONE": 0, "Right": 1, "Left": 2, "Both": 3}
    for waypoint in theirs.generate_waypoints(11.0):
        lane = lane_of(town, waypoint)
        row = lanes.first[lane] + round(lanes.u_of_s(lane, waypoint.s) / lanes.step[lane])
        beside = {
            int(lanes.change[k]) for k in range(max(row - 2, lanes.first[lane]), min(row + 3, lanes.first[lane + 1]))
        }
        assert allowed[str(waypoint.lane_change)] in beside


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TOWNS))
def test_sumo_reads_it_without_an_error(name: str, tmp_path: Path) -> None:
    sumo = pytest.importorskip("sumo", reason="needs the `eclipse-sumo` package (extra `oracles`)")
    done = subprocess.run(
        [
            Path(sumo.SUMO_HOME) / "bin" / "netconvert",
            "--opendrive",
            FOLDER / f"{name}.xodr",
            "-o",
            tmp_path / "x.net.xml",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stdout + done.stderr
    assert (tmp_path / "x.net.xml").stat().st_size > 50_000
