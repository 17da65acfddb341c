"""What `lavsim routes check` says about mistakes in a route file."""

from __future__ import annotations

from pathlib import Path

import pytest

from leaderboard.route_check import check_routes

FILE = """<routes traffic="lav"><route id="r" town="{town}">
  <weathers><weather route_percentage="{share}" cloudiness="{clouds}" sun_altitude_angle="45"/></weathers>
  <waypoints>{waypoints}</waypoints>
  <scenarios>{scenarios}</scenarios>
</route></routes>"""
# Along Harbour Wall in eu_small_a, its lane to the east, and the other one.
A, B, BACK = (-0.666, -20.737), (186.11, -33.908), (60.0, 1.0)
WALK = """<scenario name="{name}" type="{type}">
  <trigger_point x="{x}" y="{y}" z="0" yaw="{yaw}"/><distance value="{distance}"/>{more}
</scenario>"""
HERE = {"name": "w", "type": "DynamicObjectCrossing", "x": 38.5, "y": 6.893, "yaw": 1.54, "distance": 25, "more": ""}


def findings(tmp_path: Path, **changes: object) -> list[str]:
    points = changes.pop("points", (A, B))
    assert isinstance(points, tuple)
    values: dict[str, object] = {"town": "eu_small_a", "share": 0, "clouds": 20, "scenarios": ""} | changes
    values["waypoints"] = "".join(f'<position x="{x}" y="{y}" z="0"/>' for x, y in points)
    path = tmp_path / "mine.xml"
    path.write_text(FILE.format(**values))
    return check_routes(path)


def walk(**changes: object) -> str:
    return WALK.format(**(HERE | changes))


def test_a_good_file_has_no_findings(tmp_path: Path) -> None:
    assert findings(tmp_path, scenarios=walk()) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"town": "eu_smal_a"}, "no town 'eu_smal_a'. Did you mean 'eu_small_a'?"),
        ({"points": (A, (900.0, 900.0))}, "waypoint 1 (900.0, 900.0) is"),
        ({"points": (A, A)}, "the way is only 0.0 m long"),
        ({"clouds": 130}, "cloudiness of the weather must lie in 0 to 100, got 130"),
        ({"share": 101}, "route_percentage of a weather must lie in 0 to 100, got 101"),
        ({"scenarios": walk(type="DynamicObjectCrosing")}, "Did you mean"),
        ({"scenarios": walk(distance=-1)}, "distance must be positive [m], got -1"),
        ({"scenarios": walk(more='<side value="left"/>')}, "no parameter 'side'"),
        ({"scenarios": walk(y=60)}, "m off the route; it is ignored"),
        ({"scenarios": walk(yaw=181)}, "its trigger looks to 181 degrees, the route to 2; it is ignored"),
        ({"scenarios": walk(distance=140)}, "DynamicObjectCrossing does not fit at (38.5, 6.9): "),
        ({"scenarios": walk() + walk()}, "two scenarios are called w"),
    ],
)
def test_each_mistake_is_said_in_words(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    found = findings(tmp_path, **changes)
    assert found
    assert all(finding.startswith("mine.xml, route r: ") for finding in found)
    assert any(words in finding for finding in found), found


def test_a_key_point_in_the_opposite_lane_is_suspected(tmp_path: Path) -> None:
    from lavsim.map.town_files import load_town

    town = load_town("eu_small_a")
    here = town.waypoint((100.0, 8.0))
    opposite = here.left()
    assert opposite is not None
    found = findings(tmp_path, points=(A, (opposite.x, opposite.y)))
    assert any("is one of them in the opposite lane?" in finding for finding in found), found


def test_a_key_point_behind_the_one_before_is_named(tmp_path: Path) -> None:
    from lavsim.map.town_files import load_town

    start = load_town("eu_small_a").waypoint(A)
    ahead, between = start.ahead(40.0), start.ahead(20.0)
    found = findings(tmp_path, points=((ahead.x, ahead.y), (between.x, between.y), B))
    assert any("lies 20.0 m behind waypoint 0 in the same lane" in finding for finding in found), found


def test_a_key_point_inside_a_junction_is_named(tmp_path: Path) -> None:
    from lavsim.map.town_files import load_town

    town = load_town("eu_small_a")
    lane = next(k for k in town.lanes.where(2).tolist() if town.lanes.junction[k] >= 0)
    x, y = town.waypoint_at(lane, float(town.lanes.length[lane]) / 2.0).xy
    found = findings(tmp_path, points=(A, (x, y), B))
    assert any("lies inside a junction" in finding for finding in found), found
