"""How many are in town, by profile, generation and town."""

from dataclasses import replace

import pytest

from lavsim.errors import ConfigError, UnknownName
from lavsim.map.town_files import load_town
from lavsim.towns.facts import facts_of
from lavsim.traffic.profiles import LEADERBOARD_VEHICLES, population_of
from tests.drives import TOWN, straight_drive


def test_the_first_leaderboard_counts_by_carlas_town_names_and_has_no_walkers() -> None:
    assert LEADERBOARD_VEHICLES["Town01"] == 120
    population = population_of("leaderboard", "1.0", load_town(TOWN))
    assert (population.vehicles, population.walkers, population.follows_ego) == (0, 0, False)


def test_the_second_leaderboards_traffic_follows_the_ego() -> None:
    assert population_of("leaderboard", "2.x", load_town(TOWN)).follows_ego


def test_our_profile_fills_a_town_as_its_facts_say() -> None:
    facts = facts_of(TOWN)
    assert facts is not None
    population = population_of("lav", "1.0", load_town(TOWN))
    assert (population.vehicles, population.walkers) == (facts.vehicles, facts.walkers)


def test_a_drive_may_set_its_own_numbers() -> None:
    spec = straight_drive(traffic="lav", vehicles=3, parked=0.0)
    population = spec.population(load_town(TOWN))
    assert (population.vehicles, population.parked) == (3, 0.0)
    assert population.walkers == population_of("lav", "1.0", load_town(TOWN)).walkers


def test_an_unknown_profile_is_named_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="lav"):
        population_of("laav", "1.0", load_town(TOWN))


@pytest.mark.parametrize(("field", "value"), [("vehicles", -1), ("walkers", -5), ("parked", 1.5), ("jaywalking", -0.1)])
def test_impossible_numbers_are_refused(field: str, value: float) -> None:
    with pytest.raises(ConfigError, match=field):
        replace(straight_drive(), **{field: value})
