"""The bundled file of hazards: every type in two towns, each where it can stand."""

import re
from collections import defaultdict
from pathlib import Path

import pytest

from lavsim.cli import main
from lavsim.errors import LavsimError
from lavsim.map.planner import get_planner
from lavsim.map.town_files import load_town
from lavsim.scenarios.skeleton import skeleton
from leaderboard.hazard_file import TRAFFIC, hazard_routes
from leaderboard.hazard_maker import hazard_types
from leaderboard.route_check import check_routes
from leaderboard.route_writer import write_routes
from leaderboard.routes import read_routes

THROUGH_TRAFFIC = {"Scenario7", "Scenario8", "Scenario9", "Scenario10", "HardBreakRoute"}
DOCS = Path(__file__).parents[2] / "docs" / "scenarios.md"


def test_every_type_has_two_routes_in_different_towns() -> None:
    towns: dict[tuple[str, str], set[str]] = defaultdict(set)
    for entry in read_routes("hazards"):
        assert len(entry.scenarios) == 1
        hazard = entry.scenarios[0]
        towns[hazard.generation, hazard.type].add(entry.town)
        kept_ahead = "leaderboard" if hazard.type == "HardBreakRoute" else "lav"
        assert entry.traffic == (kept_ahead if hazard.type in THROUGH_TRAFFIC else "empty")
    assert set(towns) == set(hazard_types())
    assert all(len(where) == 2 for where in towns.values())


@pytest.mark.slow
def test_routes_are_150_to_400_m_long() -> None:
    for entry in read_routes("hazards"):
        route = get_planner(load_town(entry.town)).trace(entry.keypoints)
        assert 150.0 <= route.length <= 400.0, entry.source


@pytest.mark.slow
def test_nothing_is_wrong_in_it() -> None:
    assert check_routes("hazards") == []


ROUTE = """<routes traffic="empty"><route id="0" town="eu_small_a"{route}>
<waypoints><position x="0" y="0" z="0"/><position x="50" y="0" z="0"/></waypoints>
<scenarios><scenario name="a" type="Scenario3"{scenario}><trigger_point x="0" y="0" z="0"/></scenario></scenarios>
</route></routes>"""


@pytest.mark.parametrize(
    ("route", "scenario", "message"),
    [
        ("", ' generation="3.0"', r"line 3: generation of a scenario must be 1.0 or 2.x, got '3.0'"),
        (' traffic="leaderbord"', "", r"no traffic profile 'leaderbord'. Did you mean 'leaderboard'\?"),
    ],
)
def test_a_generation_or_profile_that_is_none_is_told(tmp_path: Path, route: str, scenario: str, message: str) -> None:
    file = tmp_path / "r.xml"
    file.write_text(ROUTE.format(route=route, scenario=scenario))
    with pytest.raises(LavsimError, match=message):
        read_routes(file)


PLACED = """<routes><route id="7" town="eu_small_a">
<waypoints><position x="158.801" y="-362.748" z="0"/><position x="318.871" y="-372.016" z="0"/></waypoints>
<scenarios><scenario name="crash_2" type="{type}"><trigger_point x="218.103" y="-364.591" z="0" yaw="354.536"/>
{parameter}</scenario></scenarios></route></routes>"""


@pytest.mark.parametrize(
    ("kind", "parameter", "message"),
    [
        ("Acident", "", r"crash_2 \(Acident\): no scenario '2.x:Acident'. Did you mean '2.x:Accident'\?"),
        ("Accident", '<distanc value="3"/>', r"crash_2 \(Accident\): no parameter 'distanc'. Did you mean 'distance'"),
        ("Accident", '<distance value="far"/>', r"crash_2 \(Accident\): distance must be a float, got 'far'"),
        ("Accident", "", "scenario crash_2: Accident does not fit at .*: there is no lane to the left to pass it by"),
    ],
)
def test_a_mistake_is_told_with_file_route_and_scenario(
    kind: str, parameter: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before the run begins, in one line."""
    file, out = tmp_path / "mine.xml", tmp_path / "out"
    file.write_text(PLACED.format(type=kind, parameter=parameter))
    status = main(["score", "--agent", "agents.idle", "--routes", str(file), "--out", str(out), "--rules", "2.1"])
    text = capsys.readouterr().err
    assert status == 2
    assert re.search(rf"mine\.xml,? route 7.*{message}", text.replace("\n", " "))
    assert text.count("\n") == 1


def test_a_route_names_its_own_traffic_and_its_hazards_generation(tmp_path: Path) -> None:
    file = tmp_path / "r.xml"
    file.write_text(ROUTE.format(route=' traffic="lav"', scenario=' generation="1.0"'))
    entry = read_routes(file)[0]
    assert (entry.traffic, entry.scenarios[0].generation) == ("lav", "1.0")
    file.write_text(ROUTE.format(route="", scenario=""))
    entry = read_routes(file)[0]
    assert (entry.traffic, entry.scenarios[0].generation) == ("empty", "2.x")


@pytest.mark.slow
def test_a_hazard_survives_the_file(tmp_path: Path) -> None:
    entries = list(hazard_routes([("1.0", "Scenario3"), ("2.x", "DynamicObjectCrossing")]))
    file = tmp_path / "some.xml"
    file.write_bytes(write_routes(entries, TRAFFIC))
    again = read_routes(file)
    assert [e.scenarios[0].type for e in again] == [e.scenarios[0].type for e in entries]
    assert [e.town for e in again] == [e.town for e in entries]
    assert check_routes(file) == []


def test_the_tutorial_shows_the_file_that_the_command_writes() -> None:
    text = DOCS.read_text(encoding="utf-8")
    assert skeleton("RollingBin") in text
    for generation, kind in hazard_types("1.0"):
        assert kind in text or generation != "1.0" or kind in ("Scenario8", "Scenario9")
