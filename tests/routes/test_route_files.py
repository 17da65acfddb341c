"""The bundled route files: what they promise, and that the script draws them."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from importlib import resources

import pytest

from lavsim.map.planner import get_planner
from lavsim.map.route import Route
from lavsim.map.town_files import load_town
from lavsim.scenarios.base import make_scenario
from lavsim.scenarios.director import trigger_index
from lavsim.scenarios.place import Site
from lavsim.towns.facts import bundled_facts
from lavsim.types import RoadOption
from leaderboard.route_check import check_routes
from leaderboard.route_files import (
    FILES,
    LAV_EVALUATION,
    LAV_TRAINING,
    LAV_WEATHERS,
    TEST_TOWNS,
    TRAINING_TOWNS,
    draw_file,
)
from leaderboard.route_maker import stop_signs_on
from leaderboard.routes import RouteEntry, read_routes, route_files

ALL_COMMANDS = {option for option in RoadOption if option != RoadOption.VOID}


def traced(entry: RouteEntry) -> Route:
    return get_planner(load_town(entry.town)).trace(entry.keypoints)


def commands_of(name: str) -> set[RoadOption]:
    return {option for entry in read_routes(name) for option, _ in traced(entry).commands()}


def test_every_bundled_file_has_its_function() -> None:
    assert sorted([*FILES, "hazards"]) == route_files(), "hazards is drawn by driving: benchmarks/hazards.py"


@pytest.mark.parametrize("name", sorted(FILES))
def test_route_files_are_what_the_script_draws(name: str) -> None:
    assert (resources.files("routes") / f"{name}.xml").read_bytes() == draw_file(name)


@pytest.mark.parametrize("name", sorted(FILES))
def test_nothing_is_wrong_in_bundled_files(name: str) -> None:
    assert check_routes(name) == []


@pytest.mark.parametrize("name", sorted(FILES))
def test_routes_are_500_m_to_2_km_long_and_their_hazards_fit(name: str) -> None:
    for entry in read_routes(name):
        assert entry.traffic == "lav"
        route, town = traced(entry), load_town(entry.town)
        assert 500.0 <= route.length <= 2000.0, entry.source
        for spec in entry.scenarios:
            index = trigger_index(route, spec)
            assert index is not None
            assert make_scenario(spec).fits(Site(town, route, index)) is None


def test_the_first_routes_never_change() -> None:
    """Scores of the quick and devtest routes of eu_small_a stay comparable over time."""
    entries = [*read_routes("quick"), *read_routes("devtest")[:4]]
    text = json.dumps([entry.to_json() for entry in entries], sort_keys=True)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == "cae2c9c2923e93f1"


def test_training_and_validation_are_frozen() -> None:
    """Agents are trained and compared on them: whoever moves a byte ends the comparison with all scores before."""
    files = {name: resources.files("routes") / f"{name}.xml" for name in ("training", "validation")}
    digests = {name: hashlib.sha256(file.read_bytes()).hexdigest()[:16] for name, file in files.items()}
    assert digests == {"training": "e3e5cea644b45e41", "validation": "73b0a232b4453bd8"}
    facts = {name: (load_town(name).digest[:16], bundled_facts()[name]) for name in TEST_TOWNS}
    assert {name: (digest, f.vehicles, f.walkers, f.parked) for name, (digest, f) in facts.items()} == {
        "eu_small_b": ("993cf02cfd7dbeac", 140, 60, 0.5),
        "us_large_c": ("f8af377ada22cf80", 220, 140, 0.5),
    }


@pytest.mark.parametrize(("name", "types"), [("training", LAV_TRAINING), ("validation", LAV_EVALUATION)])
def test_training_and_validation_have_lav_s_hazards(name: str, types: tuple[str, ...]) -> None:
    specs = [spec for entry in read_routes(name) for spec in entry.scenarios]
    assert {(spec.generation, spec.type) for spec in specs} == {("1.0", kind) for kind in types}
    assert all(len(entry.scenarios) >= 3 for entry in read_routes(name))


def test_the_sizes_of_the_files_and_the_towns_they_go_through() -> None:
    towns = {name: Counter(entry.town for entry in read_routes(name)) for name in FILES}
    assert towns["quick"] == {"eu_small_a": 2}
    assert towns["devtest"] == {"eu_small_a": 4, "us_large_a": 2, "us_large_b": 1, "us_highway": 1}
    assert towns["training"] == dict.fromkeys(TRAINING_TOWNS, 12)
    assert towns["validation"] == dict.fromkeys(TEST_TOWNS, 8)
    for split, names in (("training", TRAINING_TOWNS), ("test", tuple(TEST_TOWNS))):
        assert {town for town, facts in bundled_facts().items() if facts.split == split} == set(names)


@pytest.mark.parametrize("name", ["training", "validation"])
def test_all_commands_are_met(name: str) -> None:
    assert commands_of(name) == ALL_COMMANDS


def test_validation_is_four_routes_in_lav_s_four_weathers() -> None:
    entries = read_routes("validation")
    assert [entry.id for entry in entries] == [str(k) for k in range(16)]
    for number in range(4):
        group = entries[4 * number : 4 * number + 4]
        assert [entry.weather[0].weather for entry in group] == list(LAV_WEATHERS.values())
        assert all(len(entry.weather) == 1 for entry in group)
        first = group[0]
        assert all((entry.keypoints == first.keypoints).all() and entry.scenarios == first.scenarios for entry in group)
        assert stop_signs_on(load_town(first.town), traced(first).lane.tolist()) <= 1


def test_training_drives_over_most_of_each_town() -> None:
    driven: dict[str, set[int]] = {}
    for entry in read_routes("training"):
        driven.setdefault(entry.town, set()).update(traced(entry).lane.tolist())
    for name, lanes in driven.items():
        table = load_town(name).lanes
        share = table.length[list(lanes)].sum() / table.length[table.where(2)].sum()
        assert share > 0.6, f"{name}: {share:.0%}"
