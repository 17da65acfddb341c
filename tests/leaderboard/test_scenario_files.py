"""Scenario files of 1.0: what is met, and which of those that share a place is set up."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lavsim.errors import RouteError
from lavsim.types import RoadOption
from leaderboard.scenario_files import Candidate, choose, read_scenarios
from tests.leaderboard.test_routes import SHARED, needs_shared
from tests.leaderboard.worlds import straight_route


def route(way: RoadOption = RoadOption.LEFT, junction: float = 80.0) -> Any:
    """100 m along +x, its junction from `junction` on."""
    made = straight_route()
    made.command = np.where(made.distance < junction, RoadOption.LANEFOLLOW, way).astype(np.int8)
    return made


def at(x: float, kind: str = "Scenario3", y: float = 0.0, yaw: float = 0.0, **others: Any) -> Candidate:
    return Candidate(kind, (x, y, 0.0, yaw), others)


def types(candidates: list[Candidate], on: Any = None) -> list[str]:
    return [spec.type for spec in choose(candidates, on or route())]


def test_a_hazard_on_the_route_is_met_and_one_beside_or_against_it_is_not() -> None:
    assert types([at(30.0, y=1.9)]) == ["Scenario3"]
    assert types([at(30.0, y=2.1)]) == []
    assert types([at(30.0, yaw=math.radians(9.0))]) == ["Scenario3"]
    assert types([at(30.0, yaw=math.pi)]) == []


@pytest.mark.parametrize(
    ("kind", "valid"),
    [
        ("Scenario3", {RoadOption.LEFT: None, RoadOption.RIGHT: None, RoadOption.STRAIGHT: None}),
        ("Scenario4", {RoadOption.LEFT: "left", RoadOption.RIGHT: "right"}),
        ("Scenario7", {RoadOption.LEFT: "left", RoadOption.RIGHT: "right", RoadOption.STRAIGHT: "opposite"}),
        ("Scenario8", {RoadOption.LEFT: "left"}),
        ("Scenario9", {RoadOption.RIGHT: "right"}),
        ("Scenario10", {RoadOption.LEFT: None, RoadOption.RIGHT: None, RoadOption.STRAIGHT: None}),
    ],
)
def test_hazards_of_junctions_ask_for_their_turn(kind: str, valid: dict[RoadOption, str | None]) -> None:
    for way in (RoadOption.LEFT, RoadOption.RIGHT, RoadOption.STRAIGHT):
        specs = choose([at(30.0, kind)], route(way))
        assert [s.parameters.get("way") for s in specs] == ([valid[way]] if way in valid else [])


def test_a_turn_hazard_without_a_junction_ahead_is_dropped() -> None:
    assert types([at(30.0, "Scenario4")], route(junction=1000.0)) == []


def test_of_a_region_the_highest_number_is_set_up() -> None:
    region = [at(30.0, "Scenario3"), at(30.5, "Scenario10"), at(31.0, "Scenario4")]
    assert types(region) == ["Scenario10"]
    last = choose([at(30.0), at(30.5)], route())
    assert [spec.trigger[0] for spec in last] == [30.5], "the last among equals"


def test_regions_lie_two_metres_apart() -> None:
    assert types([at(30.0), at(32.1)]) == ["Scenario3", "Scenario3"]


def test_who_finds_his_place_taken_is_replaced_from_his_region() -> None:
    taken = {"front": ((60.0, 5.0, 0.0, 0.0),)}
    first, rival = at(30.0, "Scenario4", **taken), at(50.0, "Scenario4", **taken)
    assert types([first, rival]) == ["Scenario4"]
    assert types([first, rival, at(50.5, "Scenario1")]) == ["Scenario4", "Scenario1"]


def test_specs_carry_what_the_file_says() -> None:
    (spec,) = choose([at(30.0, "Scenario4", left=((10.0, 20.0, 0.0, 1.5),))], route())
    assert (spec.name, spec.generation) == ("Scenario4_0", "1.0")
    assert spec.parameters == {"way": "left", "other_actors": {"left": [[10.0, 20.0, 0.0, 1.5]]}}


def written(folder: Path, transform: Any) -> Path:
    kind = {"scenario_type": "Scenario3", "available_event_configurations": [{"transform": transform}]}
    path = folder / "scenarios.json"
    path.write_text(json.dumps({"available_scenarios": [{"Town01": [kind]}]}))
    return path


def test_a_file_is_read_with_its_numbers_as_texts(tmp_path: Path) -> None:
    path = written(tmp_path, {"x": "1.5", "y": "-2", "z": "0", "yaw": "90", "pitch": "0"})
    (candidate,) = read_scenarios(path)["Town01"]
    assert candidate.trigger == (1.5, -2.0, 0.0, pytest.approx(math.pi / 2.0))


@pytest.mark.parametrize(
    ("transform", "message"),
    [({"x": "1"}, "Town01, Scenario3 0: a transform needs"), ({"x": "nan", "y": 0, "z": 0, "yaw": 0}, "finite")],
)
def test_bad_places_are_named(tmp_path: Path, transform: Any, message: str) -> None:
    with pytest.raises(RouteError, match=message):
        read_scenarios(written(tmp_path, transform))


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    for text, message in (("{", "line 1"), ("[]", "no scenario file"), ('{"available_scenarios": [3]}', "no scenario")):
        path.write_text(text)
        with pytest.raises(RouteError, match=message):
            read_scenarios(path)
    with pytest.raises(RouteError, match="can't read"):
        read_scenarios(tmp_path / "nowhere.json")


def test_numpys_legacy_generator_is_the_originals() -> None:
    assert np.random.RandomState(0).randint(0, 7, size=5).tolist() == [4, 5, 0, 3, 3]


@needs_shared
def test_the_public_scenario_file_is_read() -> None:
    found = read_scenarios(SHARED / "leaderboard_1.0_scenarios.json")
    counts = Counter(candidate.type for candidates in found.values() for candidate in candidates)
    assert counts == {"Scenario1": 1538, "Scenario3": 414, "Scenario4": 489}
    assert sorted(found) == ["Town01", "Town02", "Town03", "Town04", "Town05", "Town06"]
