"""Route files: what is read, and what a mistake is answered with."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from lavsim.errors import RouteError, UnknownName
from leaderboard.picture import draw_routes
from leaderboard.routes import RouteEntry, read_routes, route_files, select_routes

SHARED = Path(os.environ.get("LAVSIM_SHARED") or Path(__file__).parents[3] / "shared") / "routes"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no route files at {SHARED} (set LAVSIM_SHARED)")

TWO = """<?xml version="1.0"?>
<!-- ours -->
<routes traffic="lav">
  stray text
  <route id="a" town="eu_small_a">
    <weathers>
      <weather route_percentage="100" cloudiness="80" sun_altitude_angle="-10"/> more
      <weather route_percentage="0" wetness="20"/>
    </weathers>
    <waypoints>
      <position x="0" y="1" z="2"/> stray <!-- comment -->
      <position x="30" y="41" z="2"/>
    </waypoints>
    <scenarios>
      <scenario name="Cross_1" type="DynamicObjectCrossing">
        <trigger_point x="5" y="6" z="0" yaw="90"/>
        <distance value="12"/>
        <direction value="right"/>
        <frequency from="20" to="100"/>
        <start_actor_flow x="1" y="2" z="3"/>
        <other_actor x="7" y="8" z="9" yaw="180" model="vehicle.*"/>
      </scenario>
    </scenarios>
  </route>
  <route id="b" town="eu_small_a">
    <waypoints><position x="0" y="0"/><position x="1" y="0"/></waypoints>
  </route>
</routes>"""

ONE = """<routes><route id="{id}" town="Town01">
  <waypoint x="0" y="0" z="0" pitch="360.0" roll="0.0" yaw="90"/>
  {middle}
  <waypoint x="3" y="4" z="12" pitch="0" roll="0" yaw="90"/>
</route></routes>"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "some.xml"
    path.write_text(text)
    return path


def test_routes_of_2_x_with_hazards_and_weather(tmp_path: Path) -> None:
    first, second = read_routes(written(tmp_path, TWO))
    assert (first.id, first.town, first.generation, first.traffic) == ("a", "eu_small_a", "2.x", "lav")
    assert first.source == "some.xml, route a"
    assert first.keypoints.tolist() == [[0.0, 1.0, 2.0], [30.0, 41.0, 2.0]]
    assert first.length == 50.0
    assert [frame.percentage for frame in first.weather] == [0.0, 100.0]
    assert first.weather[0].weather.wetness == 20.0
    assert first.weather[0].weather.cloudiness == 50.0  # the base of 2.x
    assert first.weather[1].weather.is_night
    (hazard,) = first.scenarios
    assert (hazard.name, hazard.type, hazard.generation) == ("Cross_1", "DynamicObjectCrossing", "2.x")
    assert hazard.trigger == (5.0, 6.0, 0.0, pytest.approx(math.pi / 2))
    assert hazard.parameters == {
        "distance": 12.0,
        "direction": "right",
        "frequency": (20.0, 100.0),
        "start_actor_flow": (1.0, 2.0, 3.0),
        "other_actors": [{"position": (7.0, 8.0, 9.0), "yaw": pytest.approx(math.pi), "model": "vehicle.*"}],
    }
    assert second.weather[0].weather.cloudiness == 50.0
    assert second.scenarios == ()


def test_routes_of_1_0(tmp_path: Path) -> None:
    (entry,) = read_routes(written(tmp_path, ONE.format(id="7", middle="")))
    assert (entry.id, entry.generation, entry.traffic, entry.length) == ("7", "1.0", None, 13.0)
    assert entry.weather[0].weather.sun_altitude_angle == 70.0
    assert entry.weather[0].weather.cloudiness == 30.0
    middle = '<weather cloudiness="5" sun_altitude_angle="1"/>'
    (entry,) = read_routes(written(tmp_path, ONE.format(id="7", middle=middle)))
    assert entry.weather[0].weather.cloudiness == 5.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<routes>\n<route>\n</routes>", r"some\.xml, line 3: not well-formed XML: .*route"),
        ("", r"some\.xml, line 1: not well-formed XML"),
        ("<roads/>", r"some\.xml, line 1: expected <routes>, got <roads>"),
        ("<routes/>", r"some\.xml: no <route> in it"),
        ('<routes>\n<route id="0"/></routes>', r"some\.xml, line 2: <route> has no town"),
        ('<routes><route town="T"/></routes>', r"line 1: <route> has no id"),
        (
            '<routes>\n<route id="0" town="T"><waypoint x="0" y="0" z="0"/></route></routes>',
            r"line 2: route 0: two waypoints or more expected, got 1",
        ),
        (ONE.format(id="0", middle='<waypoint x="1" y="north"/>'), r"line 3: <waypoint> y='north' is not a number"),
        (ONE.format(id="0", middle='<waypoint x="1" y="nan"/>'), r"line 3: <waypoint> y='nan' is not a number"),
        (ONE.format(id="0", middle='<waypoint y="1"/>'), r"line 3: <waypoint> has no x"),
        (TWO.replace('id="b"', 'id="a"'), r"route id 'a' stands on line 5 too"),
        (TWO.replace("<trigger_point", "<trigger"), r"scenario 'Cross_1' has no <trigger_point>"),
    ],
)
def test_a_mistake_in_a_file_names_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RouteError, match=message):
        read_routes(written(tmp_path, text))


def test_entities_are_not_expanded(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("Town05")
    document = TWO.removeprefix('<?xml version="1.0"?>').replace("stray text", "&e;")
    text = f'<!DOCTYPE routes [<!ENTITY e SYSTEM "{secret}">]>{document}'
    assert len(read_routes(written(tmp_path, text))) == 2


def test_unknown_names_get_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match=r"no traffic profile 'lvv'\. Did you mean 'lav'"):
        read_routes(written(tmp_path, TWO.replace('"lav"', '"lvv"')))
    with pytest.raises(UnknownName, match="no route file 'devtets'"):
        read_routes("devtets")
    with pytest.raises(RouteError, match=r"no route file nowhere/devtest\.xml"):
        read_routes("nowhere/devtest.xml")


def entries(*ids: str) -> list[RouteEntry]:
    return [RouteEntry(i, "T", np.zeros((2, 3)), (), (), "1.0", None, "some.xml", 1) for i in ids]


@pytest.mark.parametrize(
    ("ids", "chosen"),
    [
        (None, ["0", "1", "2", "10", "3", "x-y"]),
        ("0,2-3", ["0", "2", "10", "3"]),
        ("3, 0", ["0", "3"]),
        ("x-y", ["x-y"]),
        ("1-1", ["1"]),
    ],
)
def test_ids_choose_routes_in_file_order(ids: str | None, chosen: list[str]) -> None:
    assert [e.id for e in select_routes(entries("0", "1", "2", "10", "3", "x-y"), ids)] == chosen


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        ("5", "no route '5' in some.xml: it has 0, 1, 2"),
        ("0,0", "route '0' is named twice"),
        ("0,0-1", "route '0' is named twice"),
        ("2-1", "1 comes before 2 in some.xml"),
        ("0-9", "no route '9'"),
        ("", "no route ''"),
    ],
)
def test_wrong_ids_are_refused(ids: str, message: str) -> None:
    with pytest.raises(RouteError, match=message):
        select_routes(entries("0", "1", "2"), ids)


@pytest.mark.parametrize("name", route_files())
def test_packaged_route_files_are_read(name: str) -> None:
    profiles = {entry.traffic for entry in read_routes(name)}
    assert profiles == ({"empty", "lav", "leaderboard"} if name == "hazards" else {"lav"})


@needs_shared
@pytest.mark.parametrize(
    ("name", "routes", "hazards", "generation"),
    [
        ("leaderboard_1.0_devtest.xml", 4, 0, "1.0"),
        ("leaderboard_1.0_training.xml", 50, 0, "1.0"),
        ("leaderboard_2.1_devtest.xml", 2, 119, "2.x"),
        ("bench2drive_sample.xml", 20, 20, "2.x"),
    ],
)
def test_public_route_files_are_read(name: str, routes: int, hazards: int, generation: str) -> None:
    found = read_routes(SHARED / name)
    assert len(found) == routes
    assert sum(len(e.scenarios) for e in found) == hazards
    assert {e.generation for e in found} == {generation}


def test_routes_are_drawn_on_their_towns(tmp_path: Path) -> None:
    pictures = draw_routes("quick", tmp_path / "pictures", "0")
    assert [p.name for p in pictures] == ["quick_000.png"]
    assert pictures[0].read_bytes().startswith(b"\x89PNG")
